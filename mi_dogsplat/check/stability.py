"""The stability table: every case of ``cases.py`` through the engine and its float64 twin.

Errors are relative to the largest value of the right answer, where that is above 1. An image is compared at the twin's
cutoffs and at cutoffs 1e-5 lower and higher, pixel by pixel, whichever is nearest: on which side of a threshold a
number falls that lies on it, no rounding can promise. Gradients are compared without cutoffs, once over the
primitives that make the case and once over their neighbours: the distance of the gradients by a parameter over the
length of the right one, which counts as at least 1e-4 of that by all primitives: what is smaller drowns in its
rounding. Their loss is a fixed weighting of the pixels, between 0.2 and 0.8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.geometry import SMOOTH, Cutoffs
from ..engine.parameters import RAW, RAW_DOG, device_array, upload
from ..engine.project import DeviceCamera
from ..engine.rasterize import RasterOptions, rasterize
from ..reference.gradients import gradients_tiled, render_tiled
from .cases import Case, cases

IMAGE_TOLERANCE = 1e-4  # a fortieth of an 8-bit step
GRADIENT_TOLERANCE = 1e-2
DECISION = 1e-5  # relative, of a comparison with a cutoff
LEAST_SHARE = 1e-4  # of a group of primitives in the length of a gradient


@dataclass(frozen=True)
class Answer:
    """What the engine makes of a case."""

    image: np.ndarray  # [H, W, 3]
    T: np.ndarray  # [H, W]
    gradients: dict[str, np.ndarray]  # as in ``Splats``


def run(progress: Callable[[str], None] = lambda line: None) -> list[dict[str, Any]]:
    """A row per case: group, name, finite, image_error, gradient_error, worst_gradient, max_T, verdict, note.

    ``verdict`` is "right" where both errors are within tolerance, "defined" where that holds and the answer follows a
    documented rule instead of the formula, else "wrong".
    """
    table = []
    for case in cases():
        progress(f"{case.group}: {case.name}")
        table.append(measure(case))
    return table


def measure(case: Case) -> dict[str, Any]:
    """The row of a case."""
    hard, smooth = answer(case, Cutoffs()), answer(case, SMOOTH)
    values = [hard.image, hard.T, smooth.image, smooth.T, *hard.gradients.values(), *smooth.gradients.values()]
    finite = all(np.isfinite(value).all() for value in values)
    image_error, max_T = _image_error(case, hard)
    errors = _gradient_errors(case, hard if case.hidden else smooth)
    worst = max(errors, key=lambda name: errors[name])
    right = finite and image_error <= IMAGE_TOLERANCE + 1e-7 * case.roundings and errors[worst] <= GRADIENT_TOLERANCE
    return {
        "group": case.group, "name": case.name, "finite": finite, "image_error": image_error,
        "gradient_error": errors[worst], "worst_gradient": worst, "max_T": max_T,
        "verdict": ("defined" if case.defined else "right") if right else "wrong", "note": case.defined,
    }  # fmt: skip


def answer(case: Case, cutoffs: Cutoffs) -> Answer:
    """Image and gradients from the engine."""
    splats, height, width = case.splats, case.camera.height, case.camera.width
    params = upload(splats)
    trained = {name: params[name] for name in (RAW + RAW_DOG if splats.n_dog else RAW)}
    for value in trained.values():
        dr.enable_grad(value)
    options = RasterOptions(sh_degree=splats.sh_degree, cutoffs=cutoffs)
    frame = rasterize(params, DeviceCamera.upload(case.camera, case.near_clip), options)
    planes = [dr.fma(frame.T, b, color) for color, b in zip(frame.colors, case.background, strict=True)]
    weights = np.moveaxis(adjoint(height, width), -1, 0)
    loss: Any = sum(dr.dot(plane, device_array(weight)) for plane, weight in zip(planes, weights, strict=True))
    dr.backward(loss)
    gradients = {name: _host(dr.grad(value)).reshape(getattr(splats, name).shape) for name, value in trained.items()}
    image = np.stack([_host(plane).reshape(height, width) for plane in planes], -1)
    return Answer(image, _host(frame.T).reshape(height, width), gradients)


def adjoint(height: int, width: int) -> np.ndarray:
    """[H, W, 3] derivative of the loss by the image."""
    return 0.5 + 0.3 * np.cos(0.37 * np.arange(height * width * 3)).reshape(height, width, 3)


def _host(value: mi.Float) -> np.ndarray:
    return np.array(dr.detach(value).numpy(), np.float64)


def _image_error(case: Case, ours: Answer) -> tuple[float, float]:
    """(largest error of a pixel, largest transmittance on the way)."""
    errors, max_T = [], 1.0
    for factor in (1, 1 - DECISION, 1 + DECISION):
        right = render_tiled(
            case.splats, case.camera, case.background, near_clip=case.near_clip,
            min_alpha=factor * Cutoffs().alpha, min_transmittance=factor * Cutoffs().transmittance,
        )  # fmt: skip
        errors.append(np.abs(ours.image - right.image) / max(1, np.abs(right.image).max()))
        max_T = max(max_T, right.max_T)
    return float(np.min(errors, axis=0).max()), max_T


def _gradient_errors(case: Case, ours: Answer) -> dict[str, float]:
    """Error per parameter, the larger of that of the extreme primitives and that of their neighbours."""
    cutoffs = Cutoffs() if case.hidden else SMOOTH
    right = gradients_tiled(
        case.splats, case.camera, adjoint(case.camera.height, case.camera.width), case.background,
        near_clip=case.near_clip, min_alpha=cutoffs.alpha, min_transmittance=cutoffs.transmittance,
    )  # fmt: skip
    errors = {}
    for name, got in ours.gradients.items():
        rows = case.splats.dog_index if name in RAW_DOG else np.arange(case.splats.n_splats)
        extreme = np.isin(rows, case.extreme)
        least = max(LEAST_SHARE * np.linalg.norm(right[name]), 1e-30)
        distances = [
            np.linalg.norm(got[group] - right[name][group]) / max(np.linalg.norm(right[name][group]), least)
            for group in (extreme, ~extreme)
        ]
        errors[name] = float(max(distances))
    return errors
