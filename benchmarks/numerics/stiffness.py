"""How stiff training is: curvature of the loss in each raw parameter, and the steps that it bears.

A situation is a primitive that has reached its target: the image of it is the target, the loss is the mean squared
error, and one raw parameter is moved by x. So the loss is c x² / 2 for small x, with the curvature

    c = (loss(h) + loss(-h)) / h²,

central differences in which nothing cancels, since the loss at 0 is 0. All of it is evaluated with the float64
twin (``reference/``) without cutoffs: the engine's float32 would leave no digit of the second derivative of a pair
whose kernels agree to 1e-6. That the engine has the same derivatives is the business of ``dogsplat check``
(``check/stability.py``), and a test compares its gradient at x with c x.

Steps. Gradient descent with steps of η lowers a parabola for η < 2 / c and no further; so one η for all parameters must
be below 2 / (largest c), and needs c_max / c_min steps for the flattest. Adam's steps are as long as the step size,
whatever c is. There the question is whether they fit into the basin: the half-width over which the loss is within
a factor of 2 of its parabola.

``python -m benchmarks stiffness``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from mi_dogsplat.reference.forward import RAW_PARAMETERS, render
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.trained_arrays import EPSILON
from mi_dogsplat.training.presets import RECIPES

SIZE, FOCAL, DEPTH = 32, 40.0, 3.0  # pixels, pixels, world units: 13.3 pixels per world unit
EXTENT = 3.3  # of cameras around the origin at that distance
BACKGROUND = (0.2, 0.2, 0.2)
START = 0.1  # of the basin: where gradient descent starts
ADAM_START, ADAM_STEPS = 0.5, 100  # where Adam starts, of the basin; and how far it goes
HARDLY = 0.95  # of the loss at the start that is left in the end
WIDEST = 1e3  # basins are followed this far
CAMERA = Camera(np.eye(4), FOCAL, FOCAL, SIZE / 2, SIZE / 2, SIZE, SIZE)


@dataclass(frozen=True, eq=False)
class Situation:
    """A primitive at its optimum, and the raw parameters to move, by a name that says what they do."""

    case: str
    splats: Splats
    parameters: dict[str, tuple[str, int]]  # name: (field of ``Splats``, flat index)

    def loss(self, parameter: str) -> Callable[[float], float]:
        """Mean squared error as a function of the shift of a parameter."""
        field, index = self.parameters[parameter]
        raw = {name: np.array(getattr(self.splats, name), np.float64) for name in RAW_PARAMETERS}
        model = cast("Splats", SimpleNamespace(**raw, dog_index=self.splats.dog_index))
        target, optimum = render(model, CAMERA, BACKGROUND, smooth=True)[0], raw[field].flat[index]

        def loss(shift: float) -> float:
            raw[field].flat[index] = optimum + shift
            return float(np.mean((render(model, CAMERA, BACKGROUND, smooth=True)[0] - target) ** 2))

        return loss

    def drawn(self) -> bool:
        """Whether a pixel shows it, at the cutoffs of training."""
        return bool(np.any(render(self.splats, CAMERA, BACKGROUND)[1] != 1))


def primitive(
    scales: Any = 0.3, logit: float = 1.0, quat: Any = (0.0, 0.0, 0.0, 1.0), degree: int = 0, dog: tuple | None = None
) -> Splats:
    """One in front of ``CAMERA``, off the middle of a pixel; ``dog`` is (logit of f_a, log F)."""
    sh_coeffs = np.zeros((1, (degree + 1) ** 2, 3))
    sh_coeffs[:, 0] = 1.2, 0.3, -0.8
    pseudo = {"dog_index": [0], "dog_logit_opacities": [dog[0]], "dog_log_scales": [[dog[1]] * 3]} if dog else {}
    return Splats(
        means=np.array([[0.02, 0.03, DEPTH]]), log_scales=np.log(np.broadcast_to(scales, (1, 3))),
        quats=np.array([quat]), logit_opacities=np.array([logit]), sh_coeffs=sh_coeffs,
        **{name: np.array(values) for name, values in pseudo.items()},
    )  # fmt: skip


def situations() -> Iterator[Situation]:
    """All of them; needles lie along x and the camera looks along z."""
    opacity, across, color = ("logit_opacities", 0), ("means", 1), ("sh_coeffs", 0)
    for ratio in (1e1, 1e3, 1e5):
        axes = {"position along": ("means", 0), "position across": across, "position in depth": ("means", 2)}
        axes |= {"long log-scale": ("log_scales", 0), "short log-scale": ("log_scales", 1)}
        axes |= {"rotation": ("quats", 2), "logit opacity": opacity, "SH constant": color}
        yield Situation(f"needle 1:{ratio:g}", primitive((0.5, 0.5 / ratio, 0.5 / ratio)), axes)
    for length in (1e-3, 1e3):
        turned = {"rotation": ("quats", 2)}
        yield Situation(f"needle 1:10, quaternion of length {length:g}",
                        primitive((0.5, 0.05, 0.05), quat=(0, 0, 0, length)), turned)  # fmt: skip
    for logit in (0, 5, 10, 15):
        parameters = {"logit opacity": opacity, "log-scale": ("log_scales", 0), "position": across}
        yield Situation(f"opacity logit {logit}", primitive(logit=logit), parameters | {"SH constant": color})
    for gap in 10.0 ** -np.arange(1, 7):
        yield _pair(f"DoG, F and f_a at 1 - {gap:.0e}", 1 - gap, 1 - gap)
    for factor in (0.1, 10.0):
        yield _pair(f"DoG, F {factor:g}, f_a 0.5", 0.5, factor)
    harmonics = {"SH constant": color, "SH degree 1": ("sh_coeffs", 6), "SH degree 3": ("sh_coeffs", 36)}
    yield Situation("SH", primitive(degree=3), harmonics)


def _pair(case: str, f_a: float, factor: float) -> Situation:
    splats = primitive(dog=(np.log(f_a) - np.log1p(-f_a), np.log(factor)))
    parameters = {"DoG logit f_a": ("dog_logit_opacities", 0), "DoG log F": ("dog_log_scales", 0)}
    parameters |= {"logit opacity": ("logit_opacities", 0), "position": ("means", 1), "log-scale": ("log_scales", 0)}
    return Situation(case, splats, parameters)


def rows(situation: Situation) -> list[dict[str, Any]]:
    """A row per parameter.

    case, parameter; drawn: whether a pixel shows it at the cutoffs of training; curvature; stiffness: the largest
    curvature of the case over this one; two_over_curvature; gradient_descent_limit: the longest step that does not
    raise the loss; basin: None for a parabola as far as ``WIDEST``; adam_step: the longest of the recipe "ours";
    adam_over_basin; adam_peak: the largest loss on Adam's way from half a basin away, over that at its start;
    adam_end: the last one, likewise; verdict.
    """
    table = [measure(situation, parameter) for parameter in situation.parameters]
    largest = max(row["curvature"] for row in table)
    return [row | {"stiffness": largest / row["curvature"]} for row in table]


def measure(situation: Situation, parameter: str) -> dict[str, Any]:
    """The row of a parameter, but for its stiffness."""
    loss, rate = situation.loss(parameter), largest_rate(situation.parameters[parameter])
    drawn, (curvature, h) = situation.drawn(), curvature_of(loss)
    basin = basin_of(loss, curvature, h)
    reach = basin or 1.0
    losses = adam_losses(loss, rate, ADAM_START * reach)
    peak, end = max(losses), losses[-1]
    if not drawn:
        verdict = "never drawn: no gradient in training"
    else:
        verdict = "Adam overshoots" if peak > 1 else "Adam hardly moves" if end > HARDLY else "Adam follows"
    return {
        "case": situation.case, "parameter": parameter, "drawn": drawn, "curvature": curvature,
        "two_over_curvature": 2 / curvature, "gradient_descent_limit": descent_limit(loss, curvature, START * reach),
        "basin": basin, "adam_step": rate, "adam_over_basin": rate / basin if basin else None, "adam_peak": peak,
        "adam_end": end, "verdict": verdict,
    }  # fmt: skip


def largest_rate(parameter: tuple[str, int]) -> float:
    """Largest step size of Adam over a run with the recipe "ours", of few views and down to few primitives."""
    recipe, (field, index) = RECIPES["ours"], parameter
    rates = LearningRates(EXTENT, recipe.position_steps, refinement=recipe.refinement)
    name = ("sh_dc" if index < 3 else "sh_rest") if field == "sh_coeffs" else field
    return max(rates.at(step)[name] for step in range(0, recipe.reference_steps, 500))


def curvature_of(loss: Callable[[float], float]) -> tuple[float, float]:
    """(second derivative at 0, the shift it was measured with): the widest whose tenth agrees.

    Raises ``ArithmeticError`` where none does.
    """
    h = 1.0
    wide = (loss(h) + loss(-h)) / h**2
    while h > 1e-9:
        h /= 10
        narrow = (loss(h) + loss(-h)) / h**2
        if abs(narrow - wide) <= 1e-3 * narrow and narrow > 0:
            return narrow, h
        wide = narrow
    raise ArithmeticError("curvature_of: the loss has no second derivative at 0, or it is 0")


def basin_of(loss: Callable[[float], float], curvature: float, h: float) -> float | None:
    """Half-width over which the loss is within a factor of 2 of its parabola; None where that exceeds ``WIDEST``."""

    def inside(shift: float) -> bool:
        return all(0.5 <= loss(x) / (0.5 * curvature * x * x) <= 2 for x in (shift, -shift))

    low = h
    while inside(1.5 * low):
        low *= 1.5
        if low > WIDEST:
            return None
    return _bisect(inside, low, 1.5 * low)


def descent_limit(loss: Callable[[float], float], curvature: float, start: float) -> float:
    """The longest step of gradient descent from ``start`` that does not raise the loss."""
    gradient, before = _slope(loss, start), loss(start)

    def falls(η: float) -> bool:
        return loss(start - η * gradient) <= before

    low = 1 / curvature
    while falls(1.5 * low):  # ends: far away the loss is larger than so near to its zero
        low *= 1.5
    return _bisect(falls, low, 1.5 * low)


def adam_losses(loss: Callable[[float], float], rate: float, start: float) -> list[float]:
    """Losses on Adam's way from ``start``, over that at the start; the update rule of ``mi.ad.Adam``."""
    x, m, v, losses = start, 0.0, 0.0, []
    for step in range(1, ADAM_STEPS + 1):
        g = _slope(loss, x)
        m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g
        x -= rate * np.sqrt(1 - 0.999**step) / (1 - 0.9**step) * m / np.sqrt(v + EPSILON**2)
        losses.append(loss(x) / loss(start))
    return losses


def _slope(loss: Callable[[float], float], x: float) -> float:
    e = 1e-3 * max(abs(x), 1e-6)
    return (loss(x + e) - loss(x - e)) / (2 * e)


def _bisect(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Where ``holds`` ends between ``low`` and ``high``, to a ten-thousandth of their distance."""
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def main(flags: list[str]) -> None:
    how = {"description": __doc__, "formatter_class": argparse.RawDescriptionHelpFormatter}
    argparse.ArgumentParser(prog="python -m benchmarks stiffness", **how).parse_args(flags)
    print(f"{'':38s} curvature  stiffness  2 / curvature  limit    Adam / basin")
    for situation in situations():
        print(situation.case)
        for row in rows(situation):
            steps = f"{row['two_over_curvature']:9.2g}      {row['gradient_descent_limit']:9.2g}"
            basin = "no end" if row["adam_over_basin"] is None else f"{row['adam_over_basin']:.2g}"
            numbers = f"{row['curvature']:9.2g}  {row['stiffness']:9.2g}  {steps}  {basin:>8s}"
            print(f"  {row['parameter']:34s} {numbers}  {row['verdict']}")
