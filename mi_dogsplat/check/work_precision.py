"""Error against run time over the settings that trade one for the other: a work-precision diagram.

Each knob is turned alone, from the defaults. The truth is the formula itself in float64, without the cutoffs: every
kernel above 2^-30, to the last primitive. The twin of a setting is float64 with the setting's own cutoffs: what the
engine differs from it by is rounding (and decisions that rounding tips over: an α next to the cutoff is in or out).

Gradients are those of Σ a · image with one smooth noise a for all settings (``adjoint``); an error of a parameter is
‖g - g*‖ / ‖g*‖ over all primitives of the scene. Primitives that a setting leaves out have the gradient 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.arrays import backward
from ..engine.device_camera import DeviceCamera
from ..engine.parameters import device_array
from ..engine.rasterize import Frame, rasterize
from ..measure.timing import milliseconds_in_turn
from ..reference.gradients import gradients_tiled, render_tiled
from ..scene.kinds import COUNTED
from ..scene.splats import Splats
from ..support.wording import counted
from .curves import Point, Subset, points_of
from .rows import NAMES, rows_of
from .scenes import Scene

TRUTH: dict[str, Any] = {"min_alpha": 2.0**-30, "min_transmittance": 0.0}
WAVES, SHORTEST = 8, 8.0  # of the adjoint: plane waves per channel, and the least wavelength in pixels


def measure(scene: Scene, rounds: int, progress: Callable[[str], None] = lambda line: None) -> dict[str, Any]:
    """Errors and times of all settings on a scene.

    Args:
        rounds: how often each setting is timed; all take turns.
        progress: told in one line what is being done.

    Returns: ``name``, ``what``, ``width``, ``height``, ``n``, the numbers of ``COUNTED``, and ``rows``, one per
    setting: ``group``, ``setting``, ``default``; ``forward_ms`` and ``total_ms`` (with the backward pass), medians;
    ``mean_error``, ``max_error`` (absolute, colours 0..1) and ``psnr`` of the image; ``rounding_error``, the mean error
    against the twin, or None where there is none (``bound`` above 1); ``gradient_error`` by parameter and
    ``worst_gradient_error``, its largest; ``image_front`` and ``gradient_front``: no setting is at once faster and
    nearer to the truth.
    """
    progress(f"{scene.name}: the truth in float64")
    truth = _Truth(scene)
    points = points_of(scene)
    jobs = {point.key: Job(scene, point) for point in points}
    progress(f"{scene.name}: errors of {counted(len(jobs), 'setting')}")
    errors = {key: truth.errors(job) for key, job in jobs.items()}
    progress(f"{scene.name}: timing them {counted(rounds, 'time')}")
    forward = milliseconds_in_turn({key: job.forward for key, job in jobs.items()}, rounds)
    total = milliseconds_in_turn({key: job.gradients for key, job in jobs.items()}, rounds)

    image_front = pareto_front(list(forward.values()), [errors[key]["mean_error"] for key in jobs])
    gradient_front = pareto_front(list(total.values()), [errors[key]["worst_gradient_error"] for key in jobs])
    measured = {}
    for key, by_image, by_gradient in zip(jobs, image_front, gradient_front, strict=True):
        times = {"forward_ms": forward[key], "total_ms": total[key]}
        fronts = {"image_front": bool(by_image), "gradient_front": bool(by_gradient)}
        measured[key] = times | errors[key] | fronts
    default = points[0].key
    rows = [{"group": p.group, "setting": p.label, "default": p.key == default, **measured[p.key]} for p in points]
    size = {"width": scene.camera.width, "height": scene.camera.height}
    splats = scene.splats
    counts = {"n": splats.n_splats} | {name: getattr(splats, name) for name in COUNTED}
    return {"name": scene.name, "what": scene.what, **size, **counts, "rows": rows}


def pareto_front(cost: Sequence[float | None], error: Sequence[float | None]) -> np.ndarray:
    """[n] bool: no other point has both less or equal cost and error, and one of them less. Unknown is never on it."""
    c, e = (np.array([np.nan if v is None else v for v in values], np.float64) for values in (cost, error))
    known = np.isfinite(c) & np.isfinite(e)
    no_worse = (c[:, None] <= c) & (e[:, None] <= e)  # [i, j]: i is no worse than j
    better = no_worse & ((c[:, None] < c) | (e[:, None] < e))
    return known & ~(better & known[:, None]).any(0)


def adjoint(height: int, width: int) -> np.ndarray:
    """The weights a [H, W, 3] of Σ a · image: plane waves of random directions and phases, 8 pixels long or longer.

    Smooth, as the gradient of a loss is: white noise would cancel over every large primitive and leave only rounding.
    """
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    result = np.zeros((height, width, 3))
    for channel in range(3):
        for _ in range(WAVES):
            angle, phase, frequency = rng.uniform(0, 2 * np.pi, 2).tolist() + [rng.uniform(0, 1 / SHORTEST)]
            along = np.cos(angle) * x + np.sin(angle) * y
            result[..., channel] += np.cos(2 * np.pi * frequency * along + phase) / np.sqrt(WAVES / 2)
    return result


def on_all_rows(found: Mapping[str, np.ndarray], subset: Subset, splats: Splats) -> dict[str, np.ndarray]:
    """Flat gradients of a subset in the rows of ``splats``, the model of the scene; 0 for what is left out."""
    whole = {name: np.zeros(getattr(splats, name).shape) for name in NAMES}
    for name, values in found.items():
        rows = np.searchsorted(rows_of(splats, name), subset.kept[rows_of(subset.splats, name)])
        whole[name][rows] = values.reshape(len(rows), *whole[name].shape[1:])
    return whole


class Job:
    """A point of a curve, ready to run and to be timed."""

    def __init__(self, scene: Scene, point: Point):
        self.point, self.shape = point, (scene.camera.height, scene.camera.width)
        self.background, self.camera = scene.background, DeviceCamera.upload(scene.camera, scene.near_clip)
        weights = adjoint(*self.shape)
        self.δcolors = [device_array(weights[..., c]) for c in range(3)]
        self.δT = device_array(scene.background * weights.sum(-1))

    def forward(self) -> Frame:
        """The planes of the view; waits until they are there."""
        frame = rasterize(self.point.subset.params, self.camera, self.point.options)
        dr.eval(frame.colors, frame.T)
        dr.sync_thread()
        return frame

    def gradients(self) -> dict[str, mi.Float]:
        """Of Σ a · image by the parameters of its primitives; waits until they are there."""
        params = dict(self.point.subset.params)
        leaves = {name: mi.Float(params[name]) for name in NAMES if name in params}
        dr.enable_grad(leaves)
        frame = rasterize(params | leaves, self.camera, self.point.options)
        planes = [*frame.colors, frame.T]
        backward(planes, [*self.δcolors, self.δT])
        found = {name: dr.grad(leaf) for name, leaf in leaves.items()}
        dr.eval(found)
        dr.sync_thread()
        return found

    def image(self) -> np.ndarray:
        """[H, W, 3] over the background."""
        frame = self.forward()
        T = frame.T.numpy()
        return np.stack([plane.numpy() + self.background * T for plane in frame.colors], -1).reshape(*self.shape, 3)


class _Truth:
    """What a scene looks like without cutoffs and rounding, and how far a setting is from that."""

    def __init__(self, scene: Scene):
        self.scene, background = scene, (scene.background,) * 3
        self.options: dict[str, Any] = {"near_clip": scene.near_clip, "antialiased": scene.antialiased}
        weights = adjoint(scene.camera.height, scene.camera.width)
        self.image = render_tiled(scene.splats, scene.camera, background, **self.options, **TRUTH).image
        self.gradients = gradients_tiled(scene.splats, scene.camera, weights, background, **self.options, **TRUTH)
        self.twins: dict[tuple, np.ndarray] = {}

    def errors(self, job: Job) -> dict[str, Any]:
        """Fields of a row of ``measure``."""
        image = job.image()
        error = np.abs(image - self.image)
        mse = float(np.mean(error**2))
        found = {name: values.numpy() for name, values in job.gradients().items()}
        whole = on_all_rows(found, job.point.subset, self.scene.splats)
        distances = {name: float(np.linalg.norm(whole[name] - right)) for name, right in self.gradients.items()}
        lengths = {name: float(np.linalg.norm(right)) for name, right in self.gradients.items()}
        known = {name: distances[name] / length for name, length in lengths.items() if length}
        twin = self._twin(job.point)
        return {
            "mean_error": float(error.mean()),
            "max_error": float(error.max()),
            "psnr": -10 * float(np.log10(mse)) if mse > 0 else None,
            "rounding_error": None if twin is None else float(np.abs(image - twin).mean()),
            "gradient_error": known,
            "worst_gradient_error": max(known.values(), default=None),
        }

    def _twin(self, point: Point) -> np.ndarray | None:
        """[H, W, 3] with the point's own cutoffs; None for tile lists that leave out what should be drawn."""
        cutoffs, degree = point.options.cutoffs, point.options.sh_degree
        if cutoffs.bound > 1:
            return None
        key = (id(point.subset), cutoffs.alpha, cutoffs.transmittance, degree)
        if key not in self.twins:
            own = {"min_alpha": cutoffs.alpha, "min_transmittance": cutoffs.transmittance, "sh_degree": degree}
            arguments = point.subset.splats, self.scene.camera, (self.scene.background,) * 3
            self.twins[key] = render_tiled(*arguments, **self.options, **own).image
        return self.twins[key]
