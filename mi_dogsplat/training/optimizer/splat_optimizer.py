"""The model in training: its parameters with their Adam moments; the one place where the number of primitives changes.

What Adam does with arrays is in ``trained_arrays.py``. Here rows move: cloning, splitting and removing primitives must
carry both moments along, or training forgets. And here is which primitives have rows that others have not: of DoG,
of slopes and of cuts (``group_rows.py``), and those of their SH degrees (``sh_rows.py``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import mitsuba as mi
import numpy as np

from ...scene.row_groups import DOG, SH, RowGroup
from ...scene.splats import Splats
from ..images.tone_curve import ToneCurve
from .adam import Moved, gather
from .group_rows import SPARSE_ROW_SIZE, GroupRows, group_arrays
from .learning_rates import LearningRates
from .optimizer_state import restore_parameters, saved_parameters
from .sh_rows import SH_INDEX, ShRows, bands_of, row_sizes, sh_arrays
from .trained_arrays import TrainedArrays

ROW_SIZE = {"means": 3, "log_scales": 3, "quats": 4, "logit_opacities": 1, "sh_dc": 3}


class SplatOptimizer(TrainedArrays):
    """Parameters by name as flat row-major arrays attached to the AD graph, and Adam on them.

    ``sh_coeffs`` is held as ``sh_dc`` and ``sh_rest`` because their step sizes differ (see ``evaluate_sh``);
    ``sh_rest`` is absent at degree 0; else its rows hold all K coefficients, the first of them unused. In a mixed model
    groups of rows take its place (``sh_rows.py``).
    """

    def __init__(self, splats: Splats, learning_rates: LearningRates, curve: ToneCurve | None = None):
        """``curve``: through which the loss sees colours that are linear (``color_steps.py``)."""
        if splats.n_splats == 0:
            raise ValueError("SplatOptimizer: there is no primitive to start from")
        self.followers: list[Callable[[np.ndarray, np.ndarray], None]] = []  # called with what ``rearrange`` was
        values = {name: getattr(splats, name) for name in ("means", "log_scales", "quats", "logit_opacities")}
        values["sh_dc"] = splats.sh_coeffs[:, 0]
        bands = bands_of(splats)
        values |= bands
        sizes = ROW_SIZE | row_sizes(bands, splats.n_splats)
        self._groups = GroupRows.of(splats)
        for rows in self._groups.values():
            if len(rows.index):
                values |= {name: getattr(splats, name) for name in rows.group.names}
                sizes |= rows.row_size
        self._sh = ShRows.of(splats, chosen=False)
        super().__init__(values, sizes, learning_rates, curve)
        self.schedule(0)

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
    def largest_scales(self) -> np.ndarray:
        """[N] along the longest axis of each primitive, world units; within e^±80. Waits for the device."""
        x, y, z = self.numpy("log_scales").T
        longest = np.maximum(np.maximum(x, y), z)  # a twentieth of the time of ``max`` along rows of three
        return np.exp(np.clip(longest, -80, 80))

    @property
    def n_dog(self) -> int:
        """Number of primitives that are DoG. Waits for the device if some have been dropped."""
        self._sweep()
        return len(self.dog_index)

    @property
    def dog_index(self) -> np.ndarray:
        """[M] which primitives are DoG, those included that have been dropped since ``n_dog`` was asked for."""
        return self.index_of(DOG)

    def index_of(self, group: RowGroup) -> np.ndarray:
        """[M] which primitives have a row of a group: of DoG, of slopes and so on."""
        return self._groups[group.index].index

    @property
    def params(self) -> dict:
        """Arrays for ``rasterize``; gradients accumulate on them."""
        found = super().params
        for rows in self._groups.values():
            found |= rows.params
        return found | self._sh.params

    def set_dog(self, dog_index: np.ndarray, logit_opacities: np.ndarray, log_scales: np.ndarray) -> None:
        """Make exactly the primitives ``dog_index`` DoG; those that already were keep their moments.

        Args:
            dog_index: [M] strictly increasing; none makes all primitives plain Gaussians.
            logit_opacities: [M] logit of f_a.
            log_scales: [M, 3] log of F.
        """
        values = {"dog_logit_opacities": logit_opacities, "dog_log_scales": log_scales}
        self.set_rows(DOG, dog_index, values)

    def set_rows(self, group: RowGroup, index: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        """Give rows of a group to exactly the primitives ``index`` [M]; those that had one keep their moments.

        Args:
            values: of each array of the group, [M] or [M, …].
        """
        self._sweep()
        rows = self._groups[group.index]
        self.row_size |= rows.row_size
        self._groups[group.index] = rows.replaced(self.adam, index, values, self.learning_rates.at(0))

    def drop_dog(self, drop: mi.Bool) -> None:
        """Make plain Gaussians of the primitives ``drop`` [N] for all renders to come; waits for nothing.

        Their rows in the DoG arrays are given back by a sweep, as soon as somebody asks for ``n_dog`` or the model.
        """
        self._groups[DOG.index].drop(drop)

    def _sweep(self) -> None:
        self._groups = {name: rows.swept(self.adam) for name, rows in self._groups.items()}

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
            fresh: [N'] bool; a fresh row starts with zero moments, as a plain Gaussian that is whole, of one colour.
        """
        index, fresh = np.asarray(index), np.asarray(fresh)
        if len(index) == 0:
            raise ValueError("SplatOptimizer.rearrange: no primitive would be left")
        self._sweep()
        self._sh, rows_of_bands = self._sh.rearranged(index, self.n)
        of_all = Moved.of(index, fresh)
        for name in [name for name in self.adam if name not in SPARSE_ROW_SIZE]:
            of_bands = rows_of_bands.get(name)
            moved = of_all if of_bands is None else Moved.of(of_bands, fresh[self._sh.primitives(name)])
            gather(self.adam, name, moved, self.row_size[name])
        self._groups = {name: rows.rearranged(self.adam, index, fresh) for name, rows in self._groups.items()}
        if self.preconditioner:
            self.preconditioner.rearranged(index, fresh)
        for follow in self.followers:
            follow(index, fresh)

    def keep(self, rows: np.ndarray) -> None:
        """Forget all rows but these."""
        self.rearrange(rows, np.zeros(len(rows), bool))

    def to_splats(self) -> Splats:
        """The model on the host."""
        self._sweep()
        arrays = {name: self.numpy(name) for name in ("means", "log_scales", "quats", "logit_opacities")}
        arrays |= sh_arrays(self.numpy("sh_dc"), {name: self.numpy(name) for name in self.bands}, self._sh.indices)
        flat = {name: rows.index for name, rows in self._groups.items()}
        flat |= {name: self.numpy(name) for name in self.adam if name in SPARSE_ROW_SIZE}
        return Splats(**arrays, **group_arrays(flat))

    def state(self) -> dict[str, np.ndarray]:
        """What ``restore`` needs to go on with the same bits: values, both moments, step counts, rates."""
        self._sweep()
        saved: dict[str, np.ndarray] = {}
        for rows in self._groups.values():
            saved |= rows.state
        saved |= self.preconditioner.state() if self.preconditioner else {}
        return saved | self._sh.state() | saved_parameters(self.adam, self.other_rates)

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take over the ``state()`` of an optimizer, whatever its number of primitives.

        Raises ``ValueError`` when it is incomplete, of another SH degree, or has a value that is not finite.
        """
        self.other_rates = restore_parameters(self.adam, self.row_size, self.bands, saved)
        self._groups, self._sh = GroupRows.of_state(saved), ShRows.of_state(saved)
        if self.preconditioner:
            self.preconditioner.restore(saved, self.row_size, self.n)
