"""The trained parameters and their Adam moments; the one place where the number of primitives changes.

The update rule is the library's (``mi.ad.Adam``). What is ours: a learning rate per parameter
(``learning_rates.py``), and moving rows: cloning, splitting and removing primitives must carry both moments along, or
training forgets. And a gradient that is not finite, or whose square is not, counts as zero: Adam would keep it in the
second moment for ever, as a NaN in the parameter or an infinity that freezes it.

Of K views of a step (``LearningRates.batch_views``) gradients add up on the parameters; a step takes their mean. Adam
then remembers as many views as with one: β^K (Zhao et al. 2024), and ε / √K, as the mean is that much smaller.

Arrays that cross between host and device are always copied, to aligned memory. On the CPU Dr.Jit would share
memory with NumPy, and whether an array begins at a multiple of 64 bytes decides which kernel is compiled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.parameters import RAW_DOG, device_array
from ..scene.row_groups import SH
from ..scene.splats import Splats
from .adam import Entry, forget, gather, step_without, to_host
from .color_steps import ColorSteps
from .dog_rows import DOG_ROW_SIZE, DogRows
from .learning_rates import LearningRates
from .optimizer_state import restore_parameters, saved_parameters
from .sh_rows import SH_INDEX, ShRows, bands_of, row_sizes, sh_arrays
from .tone_curve import ToneCurve

ROW_SIZE = {"means": 3, "log_scales": 3, "quats": 4, "logit_opacities": 1, "sh_dc": 3}
MAX_GRADIENT = 1e18  # its square is a float32
BETA_1, BETA_2 = 0.9, 0.999
EPSILON = 1e-15  # of Adam, as in 3DGS: gradients far below move nothing


class SplatOptimizer:
    """Parameters by name as flat row-major arrays attached to the AD graph, and Adam on them.

    ``sh_coeffs`` is held as ``sh_dc`` and ``sh_rest`` because their step sizes differ (see ``evaluate_sh``);
    ``sh_rest`` is absent at degree 0; else its rows hold all K coefficients, the first of them unused. In a mixed model
    groups of rows take its place (``sh_rows.py``).
    """

    def __init__(self, splats: Splats, learning_rates: LearningRates, curve: ToneCurve | None = None):
        """``curve``: through which the loss sees colours that are linear (``color_steps.py``)."""
        self.curve = curve
        if splats.n_splats == 0:
            raise ValueError("SplatOptimizer: there is no primitive to start from")
        self.learning_rates = learning_rates
        self.other_rates: dict[str, float] = {}
        self.rate_factors: dict[str, float] = {}  # of a strategy, on step sizes; it sets them before every step
        self.followers: list[Callable[[np.ndarray, np.ndarray], None]] = []  # called with what ``rearrange`` was
        self.row_size = dict(ROW_SIZE)
        values = {name: getattr(splats, name) for name in ("means", "log_scales", "quats", "logit_opacities")}
        values["sh_dc"] = splats.sh_coeffs[:, 0]
        bands = bands_of(splats)
        values |= bands
        self.row_size |= row_sizes(bands, splats.n_splats)
        if splats.n_dog:
            values |= {name: getattr(splats, name) for name in RAW_DOG}
            self.row_size |= DOG_ROW_SIZE
        views, gain = learning_rates.batch_views, learning_rates.batch_gain
        adam: dict[str, Any] = {"beta_1": BETA_1**views, "beta_2": BETA_2**views, "epsilon": EPSILON / gain}
        self.adam = mi.ad.Adam(lr=0.0, params={name: device_array(v) for name, v in values.items()}, **adam)
        self._dog = DogRows(splats.dog_index, splats.n_splats)
        self._sh = ShRows.of(splats, chosen=False)
        self.schedule(0)

    @property
    def n(self) -> int:
        """Number of primitives."""
        return dr.width(self.adam["logit_opacities"])

    @property
    def sh_degree(self) -> int:
        """Highest degree of the view-dependent colour."""
        return math.isqrt(self.row_size["sh_rest"] // 3) - 1 if "sh_rest" in self.row_size else self._sh.degree

    @property
    def bands(self) -> tuple[str, ...]:
        """Names of the parameters that hold view-dependent colour."""
        return tuple(name for name in self.adam if name == "sh_rest" or name in SH_INDEX)

    @property
    def sh_degrees(self) -> np.ndarray:
        """[N] int, the degree of each primitive."""
        degrees = np.full(self.n, 0 if self._sh.indices else self.sh_degree)
        for degree, group in SH.items():
            degrees[self._sh.indices.get(group.index, [])] = degree
        return degrees

    @property
    def n_dog(self) -> int:
        """Number of primitives that are DoG. Waits for the device if some have been dropped."""
        self._sweep()
        return len(self._dog.index)

    @property
    def dog_index(self) -> np.ndarray:
        """[M] which primitives are DoG, those included that have been dropped since ``n_dog`` was asked for."""
        return self._dog.index

    @property
    def params(self) -> dict:
        """Arrays for ``rasterize``; gradients accumulate on them."""
        return dict(self.adam.items()) | self._dog.params | self._sh.params

    def schedule(self, step: int) -> None:
        """Set the step sizes for a step.

        They are Python numbers, which Adam makes opaque itself. An array here would cost two kernels per
        parameter and, if differentiable, be multiplied in place (Dr.Jit 1.5).
        """
        gain = self.learning_rates.batch_gain
        rates = self.learning_rates.at(step, self.n) | {name: rate * gain for name, rate in self.other_rates.items()}
        factors = self.rate_factors
        if "sh_rest" in factors:
            factors = dict.fromkeys(SH_INDEX, factors["sh_rest"]) | factors
        self.adam.set_learning_rate({name: rates[name] * factors.get(name, 1.0) for name in self.adam})

    def learn(self, name: str, values: np.ndarray, rate: float) -> None:
        """Train one more number per primitive, which moves along with it; renders know nothing of it.

        Args:
            values: [N].
            rate: step size for a view, the same all along; 0 holds a number that somebody else sets.
        """
        self.row_size[name], self.other_rates[name] = 1, rate
        self.adam[name] = device_array(values)
        self.adam.set_learning_rate({name: rate * self.learning_rates.batch_gain})

    def forget(self, name: str) -> None:
        """Drop what ``learn`` added."""
        del self.row_size[name], self.other_rates[name]
        forget(self.adam, name)

    @property
    def learned(self) -> set[str]:
        """Names of what ``learn`` has added."""
        return set(self.other_rates)

    def step(self, unused: Collection[str] = ()) -> None:
        """One Adam step with the gradients on the parameters, sums over the views of a step, which are then cleared.

        Args:
            unused: parameters that no render has read so far. Their gradients and moments are 0, so that Adam would
                write back what it read: that is left out. The step counts all the same, for the bias correction.
        """
        unused, views = set(unused), self.learning_rates.batch_views
        for value in [value for name, value in self.adam.items() if name not in unused]:
            gradient = dr.grad(value) if views == 1 else dr.grad(value) * (1 / views)
            dr.set_grad(value, dr.select(dr.abs(gradient) < MAX_GRADIENT, gradient, 0))  # false for NaN
        if self.curve:
            used = {name: value for name, value in self.adam.items() if name not in unused}
            color_steps = ColorSteps(self.curve, used, self.row_size, self._sh.params)
            start = color_steps.before(self.adam)
            step_without(self.adam, unused)
            color_steps.after(self.adam, start)
        else:
            step_without(self.adam, unused)

    def numpy(self, name: str) -> np.ndarray:
        """Copy of a parameter on the host, [N] or [N, row size]."""
        flat = to_host(self.adam[name])
        return flat if self.row_size[name] == 1 else flat.reshape(-1, self.row_size[name])

    def assign(self, name: str, values: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Overwrite a parameter, or some rows of it, and keep its moments."""
        new = self.numpy(name)
        new[slice(None) if rows is None else rows] = values
        self.adam[name] = device_array(new)

    def add(self, name: str, change: Any) -> None:
        """Add an array of the device to a parameter, row-major, and keep its moments; waits for nothing."""
        self.adam[name] = dr.detach(self.adam[name]) + change

    def restart(self) -> None:
        """Forget the moments and step counts of all parameters, as a new optimizer."""
        self.adam.reset()

    def reset_moments(self, name: str) -> None:
        """Forget both moments of a parameter, not its step count."""
        Entry.of(self.adam, name).without_moments().put(self.adam, name)

    def set_dog(self, dog_index: np.ndarray, logit_opacities: np.ndarray, log_scales: np.ndarray) -> None:
        """Make exactly the primitives ``dog_index`` DoG; those that already were keep their moments.

        Args:
            dog_index: [M] strictly increasing; none makes all primitives plain Gaussians.
            logit_opacities: [M] logit of f_a.
            log_scales: [M, 3] log of F.
        """
        new = {"dog_logit_opacities": logit_opacities, "dog_log_scales": log_scales} if len(dog_index) else {}
        if not new:
            self._gather_dog(np.zeros(0, int))
        self._sweep()
        old_row = self._dog.of_splats()[np.asarray(dog_index, np.int64)]  # [M] or -1
        self.row_size |= DOG_ROW_SIZE
        rates = self.learning_rates.at(0)
        for name, values in new.items():
            if name in self.adam:
                self._gather(name, np.maximum(old_row, 0), old_row < 0)
                self.assign(name, values)
            else:
                self.adam[name] = device_array(values)
                self.adam.set_learning_rate({name: rates[name]})
        self._dog = DogRows(dog_index, self.n)

    def drop_dog(self, drop: mi.Bool) -> None:
        """Make plain Gaussians of the primitives ``drop`` [N] for all renders to come; waits for nothing.

        Their rows in the DoG arrays are given back by a sweep, as soon as somebody asks for ``n_dog`` or the model.
        """
        self._dog.drop(drop)

    def _sweep(self) -> None:
        keep = self._dog.left()
        if len(keep) < len(self._dog.index):
            self._gather_dog(keep)
            self._dog = DogRows(self._dog.index[keep], self.n)

    def set_sh_degrees(self, degrees: np.ndarray) -> None:
        """Give each primitive an SH degree; bands that it keeps keep their moments, bands that are new are zero.

        Args:
            degrees: [N] 0..3. If they are all equal the model is uniform from then on, else it is mixed.

        Raises ``ValueError`` for another number of degrees, or for what is no degree.
        """
        rate, before = self.learning_rates.at(0)["sh_rest"], self.bands
        self._sh, sizes = self._sh.regrouped(self.adam, before, self.n, degrees, rate)
        for name in before:
            del self.row_size[name]
        self.row_size |= sizes

    def rearrange(self, index: np.ndarray, fresh: np.ndarray) -> None:
        """Make row r a copy of the old row ``index[r]``: the one place where the number of rows changes.

        Args:
            index: [N'] old row of each new row. N' must not be 0.
            fresh: [N'] bool; a fresh row starts with zero moments and as a plain Gaussian.
        """
        index, fresh = np.asarray(index), np.asarray(fresh)
        if len(index) == 0:
            raise ValueError("SplatOptimizer.rearrange: no primitive would be left")
        self._sweep()
        dog_row_of_new = np.where(fresh, -1, self._dog.of_splats()[index])
        self._sh, rows = self._sh.rearranged(index, self.n)
        for name in [name for name in self.adam if name not in DOG_ROW_SIZE]:
            if name in rows:
                self._gather(name, rows[name], fresh[self._sh.primitives(name)])
            else:
                self._gather(name, index, fresh)
        self._gather_dog(dog_row_of_new[dog_row_of_new >= 0])
        self._dog = DogRows(np.flatnonzero(dog_row_of_new >= 0), len(index))
        for follow in self.followers:
            follow(index, fresh)

    def keep(self, rows: np.ndarray) -> None:
        """Forget all rows but these."""
        self.rearrange(rows, np.zeros(len(rows), bool))

    def _gather_dog(self, rows: np.ndarray) -> None:
        for name in [name for name in self.adam if name in DOG_ROW_SIZE]:
            self._gather(name, rows, np.zeros(len(rows), bool))

    def _gather(self, name: str, rows: np.ndarray, fresh: np.ndarray) -> None:
        gather(self.adam, name, rows, fresh, self.row_size[name])

    def to_splats(self) -> Splats:
        """The model on the host."""
        arrays = {name: self.numpy(name) for name in ("means", "log_scales", "quats", "logit_opacities")}
        arrays |= sh_arrays(self.numpy("sh_dc"), {name: self.numpy(name) for name in self.bands}, self._sh.indices)
        if self.n_dog:
            arrays |= {"dog_index": self.dog_index} | {name: self.numpy(name) for name in RAW_DOG}
        return Splats(**arrays)

    def state(self) -> dict[str, np.ndarray]:
        """What ``restore`` needs to go on with the same bits: values, both moments, step counts, rates."""
        self._sweep()
        rows = {"dog_index": self.dog_index.copy()} | self._sh.state()
        return rows | saved_parameters(self.adam, self.other_rates)

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take over the ``state()`` of an optimizer, whatever its number of primitives.

        Raises ``ValueError`` when it is incomplete, of another SH degree, or has a value that is not finite.
        """
        self.other_rates = restore_parameters(self.adam, self.row_size, self.bands, saved)
        self._dog, self._sh = DogRows(saved["dog_index"], self.n), ShRows.of_state(saved)
