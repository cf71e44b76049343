"""Arrays by name, with a row for each primitive or for some, and Adam on them with a step size for each array.

The update rule is the library's (``mi.ad.Adam``; ``adam_step.py``). What is ours: a learning rate per parameter
(``learning_rates.py``), and a gradient that is not finite, or whose square is not, counts as zero: Adam would keep it
in the second moment for ever, as a NaN in the parameter or an infinity that freezes it.

Of K views of a step (``LearningRates.batch_views``) gradients add up on the parameters; a step takes their mean. Adam
then remembers as many views as with one: β^K (Zhao et al. 2024), and ε / √K, as the mean is that much smaller.

Arrays that cross between host and device are always copied, to aligned memory. On the CPU Dr.Jit would share
memory with NumPy, and whether an array begins at a multiple of 64 bytes decides which kernel is compiled.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.parameters import device_array
from ..images.tone_curve import ToneCurve
from .adam import Entry, forget, to_host
from .adam_step import adam_step
from .color_steps import ColorSteps
from .learning_rates import LearningRates
from .preconditioning import Preconditioner
from .sh_rows import SH_INDEX

BETA_1, BETA_2 = 0.9, 0.999
EPSILON = 1e-15  # of Adam, as in 3DGS: gradients far below move nothing


class TrainedArrays:
    """Flat row-major arrays attached to the AD graph, ``row_size`` floats in a row of each."""

    def __init__(
        self,
        values: Mapping[str, np.ndarray],
        row_size: Mapping[str, int],
        learning_rates: LearningRates,
        curve: ToneCurve | None,
    ):
        """``curve``: through which the loss sees colours that are linear (``color_steps.py``)."""
        self.curve = curve
        self.learning_rates = learning_rates
        self.other_rates: dict[str, float] = {}
        self.rate_factors: dict[str, float] = {}  # of a strategy, on step sizes; it sets them before every step
        self.row_size = dict(row_size)
        rule = learning_rates.preconditioning
        self.preconditioner = Preconditioner(rule) if rule else None
        self.joint = False  # steps of a primitive's numbers, from the start of that rule on
        views, gain = learning_rates.batch_views, learning_rates.batch_gain
        adam: dict[str, Any] = {"beta_1": BETA_1**views, "beta_2": BETA_2**views, "epsilon": EPSILON / gain}
        self.adam = mi.ad.Adam(lr=0.0, params={name: device_array(v) for name, v in values.items()}, **adam)

    @property
    def n(self) -> int:
        """Number of primitives."""
        return dr.width(self.adam["logit_opacities"])

    @property
    def n_floats(self) -> int:
        """Of all arrays."""
        return sum(dr.width(values) for values in self.adam.values())

    @property
    def n_products(self) -> int:
        """Of preconditioned steps, of all primitives."""
        return sum(map(len, self.preconditioner.products)) if self.preconditioner else 0

    @property
    def params(self) -> dict:
        """The arrays, on which gradients accumulate."""
        return dict(self.adam.items())

    def schedule(self, step: int) -> None:
        """Set the step sizes for a step.

        They are Python numbers, which Adam makes opaque itself. An array here would cost two kernels per
        parameter and, if differentiable, be multiplied in place (Dr.Jit 1.5).
        """
        gain, rule = self.learning_rates.batch_gain, self.learning_rates.preconditioning
        self.joint = rule is not None and step >= rule.start
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
        used = {name: value for name, value in self.adam.items() if name not in unused}
        if views > 1:
            for value in used.values():
                dr.set_grad(value, dr.grad(value) * (1 / views))
        color_steps = ColorSteps(self.curve, used, self.row_size, self.params) if self.curve else None
        start = color_steps.before(self.adam) if color_steps else {}
        preconditioner = self.preconditioner if self.joint else None
        before = adam_step(self.adam, unused, preconditioner.names(self.adam) if preconditioner else ())
        if preconditioner:
            preconditioner.step(self.adam, before, self.row_size, self.params, views)
        if color_steps:
            color_steps.after(self.adam, start)

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
        if self.preconditioner:
            self.preconditioner = Preconditioner(self.preconditioner.rule)

    def reset_moments(self, name: str) -> None:
        """Forget both moments of a parameter, not its step count."""
        Entry.of(self.adam, name).without_moments().put(self.adam, name)
        if self.preconditioner:
            self.preconditioner.forget(name)
