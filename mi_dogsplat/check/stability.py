"""The stability table: every case of ``cases.py`` through the engine and its float64 twin.

An image is compared pixel by pixel, each relative to the sum of magnitudes of what the twin blends there, where that is
above 1. It may be off by ``IMAGE_TOLERANCE`` of that and by what float32 rounds away (``reference/rounding.py``).

On which side of a cutoff a number falls that lies on it, no rounding can promise. So the twin is rendered twice more,
with cutoffs that are stricter and more lenient by ``DECISION`` and by that rounding: those at 1/255 and 1e-4, and that
at 2^30, where walks end behind negative lobes. A pixel counts as the nearest of the three.

Gradients are compared once over the primitives that make the case and once over their neighbours: the distance of the
gradients by a parameter over the length of the right one, which counts as at least 1e-4 of that by all primitives: what
is smaller drowns in its rounding. Their loss is a fixed weighting of the pixels, between 0.2 and 0.8.

They are compared without cutoffs, and with those that are the default. There the image is smooth but for jumps where
an α or a T crosses its cutoff, and so is float64's. Away from the jumps both have one derivative; on a jump none is
right. So pixels have no weight in the loss where the stricter twin and the more lenient one differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.device_camera import DeviceCamera
from ..engine.geometry import SMOOTH, Cutoffs
from ..engine.options import RasterOptions
from ..engine.parameters import device_array, upload
from ..engine.rasterize import rasterize
from ..reference.forward import MAX_T
from ..reference.gradients import Rendered, gradients_tiled, render_tiled
from ..reference.rounding import rounding_tiled
from .cases import Case, cases
from .rows import NAMES, rows_of

IMAGE_TOLERANCE = 1e-4  # a fortieth of an 8-bit step
GRADIENT_TOLERANCE = 1e-2
DECISION = 1e-5  # relative, of a comparison with a cutoff
UNCHANGED = 1e-12  # relative, of a pixel of the twin
LEAST_SHARE = 1e-4  # of a group of primitives in the length of a gradient


@dataclass(frozen=True)
class Answer:
    """What the engine makes of a case."""

    image: np.ndarray  # [H, W, 3]
    T: np.ndarray  # [H, W]
    gradients: dict[str, np.ndarray]  # as in ``Splats``


def run(progress: Callable[[str], None] = lambda line: None) -> list[dict[str, Any]]:
    """A row per case: group, name, finite, image_error, gradient_error, worst_gradient, max_T, verdict, note.

    ``tolerance_used`` is the largest error of a pixel as a share of what it may be. ``gradient_error`` is without
    cutoffs; ``default_gradient_error`` with them, over the pixels that no cutoff leaves undecided, and ``undecided``
    the share of the others. ``verdict`` is "right" where all errors are within tolerance, "defined" where that holds
    and the answer follows a documented rule instead of the formula, else "wrong".
    """
    table = []
    for case in cases():
        progress(f"{case.group}: {case.name}")
        table.append(measure(case))
    return table


def measure(case: Case) -> dict[str, Any]:
    """The row of a case."""
    weights = adjoint(case.camera.height, case.camera.width)
    twins = [_twin(case, Cutoffs(), moved) for moved in (0, -DECISION, DECISION)]
    decided = weights * _alike(*twins[1:])[..., None]
    hard = answer(case, Cutoffs(), decided)
    smoothly = weights
    if case.splats.n_dog >= math.log2(MAX_T):  # each lobe makes T at most 1.99 times as large
        smoothly = weights * _alike(*(_twin(case, SMOOTH, moved) for moved in (-DECISION, DECISION)))[..., None]
    smooth = answer(case, SMOOTH, smoothly)
    values = [hard.image, hard.T, smooth.image, smooth.T, *hard.gradients.values(), *smooth.gradients.values()]
    finite = all(np.isfinite(value).all() for value in values)
    image_error, tolerance_used = _image_errors(case, hard, twins)
    default = _gradient_errors(case, hard, Cutoffs(), decided)
    errors = default if case.hidden else _gradient_errors(case, smooth, SMOOTH, smoothly)
    worst = max(errors, key=lambda name: errors[name])
    largest = max(errors[worst], *default.values())
    right = finite and tolerance_used <= 1 and largest <= GRADIENT_TOLERANCE
    return {
        "group": case.group, "name": case.name, "finite": finite, "image_error": image_error,
        "tolerance_used": tolerance_used, "gradient_error": errors[worst], "worst_gradient": worst,
        "default_gradient_error": max(default.values()),
        "undecided": float(np.mean(decided == 0)), "max_T": max(twin.max_T for twin in twins),
        "verdict": ("defined" if case.defined else "right") if right else "wrong", "note": case.defined,
    }  # fmt: skip


def answer(case: Case, cutoffs: Cutoffs, weights: np.ndarray | None = None) -> Answer:
    """Image and gradients from the engine; ``weights`` [H, W, 3] of the loss are ``adjoint`` if not given."""
    splats, height, width = case.splats, case.camera.height, case.camera.width
    params = upload(splats)
    trained = {name: params[name] for name in NAMES if name in params}
    for value in trained.values():
        dr.enable_grad(value)
    options = RasterOptions(sh_degree=splats.sh_degree, cutoffs=cutoffs)
    frame = rasterize(params, DeviceCamera.upload(case.camera, case.near_clip), options)
    planes = [dr.fma(frame.T, b, color) for color, b in zip(frame.colors, case.background, strict=True)]
    by_plane = np.moveaxis(adjoint(height, width) if weights is None else weights, -1, 0)
    loss: Any = sum(dr.dot(plane, device_array(weight)) for plane, weight in zip(planes, by_plane, strict=True))
    dr.backward(loss)
    dr.eval([dr.grad(value) for value in trained.values()])  # together: one by one each repeats the projection
    gradients = {name: _host(dr.grad(value)).reshape(getattr(splats, name).shape) for name, value in trained.items()}
    image = np.stack([_host(plane).reshape(height, width) for plane in planes], -1)
    return Answer(image, _host(frame.T).reshape(height, width), gradients)


def adjoint(height: int, width: int) -> np.ndarray:
    """[H, W, 3] derivative of the loss by the image."""
    return 0.5 + 0.3 * np.cos(0.37 * np.arange(height * width * 3)).reshape(height, width, 3)


def _host(value: mi.Float) -> np.ndarray:
    return np.array(dr.detach(value).numpy(), np.float64)


def _twin(case: Case, cutoffs: Cutoffs, moved: float) -> Rendered:
    """In float64, with cutoffs that are stricter by a share and by what float32 may have rounded."""
    return render_tiled(
        case.splats, case.camera, case.background, near_clip=case.near_clip,
        min_alpha=cutoffs.alpha, min_transmittance=cutoffs.transmittance, moved=moved,
    )  # fmt: skip


def _alike(lenient: Rendered, strict: Rendered) -> np.ndarray:
    """[H, W] whether a pixel of the two twins is the same."""
    size = np.maximum(1, np.abs(lenient.image).max(-1))
    return np.abs(lenient.image - strict.image).max(-1) <= UNCHANGED * size


def _image_errors(case: Case, ours: Answer, twins: list[Rendered]) -> tuple[float, float]:
    """(Largest error of a pixel relative to its sum of magnitudes, largest share of what it may be), each pixel against
    the nearest of the twins."""
    rounding = rounding_tiled(case.splats, case.camera, case.background, near_clip=case.near_clip)
    size = np.maximum(1, rounding.magnitude)
    distances = np.min([np.abs(ours.image - twin.image) for twin in twins], axis=0)
    return float((distances / size).max()), float((distances / (IMAGE_TOLERANCE * size + rounding.error)).max())


def _gradient_errors(case: Case, ours: Answer, cutoffs: Cutoffs, weights: np.ndarray) -> dict[str, float]:
    """Error per parameter, the larger of that of the extreme primitives and that of their neighbours."""
    right = gradients_tiled(
        case.splats, case.camera, weights, case.background, near_clip=case.near_clip,
        min_alpha=cutoffs.alpha, min_transmittance=cutoffs.transmittance,
    )  # fmt: skip
    errors = {}
    for name, got in ours.gradients.items():
        extreme = np.isin(rows_of(case.splats, name), case.extreme)
        least = max(LEAST_SHARE * np.linalg.norm(right[name]), 1e-30)
        distances = [
            np.linalg.norm(got[group] - right[name][group]) / max(np.linalg.norm(right[name][group]), least)
            for group in (extreme, ~extreme)
        ]
        errors[name] = float(max(distances))
    return errors
