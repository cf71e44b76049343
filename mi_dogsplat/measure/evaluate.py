"""Metrics and pictures of a model on views with ground truth."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..datasets.dataset import View
from ..datasets.masks import Masks
from ..render.picture import Picture, light_seen_as, photograph, premultiplied, radiance_of, seen_as
from ..scene.appearance import Appearance, photographed, radii_squared
from ..scene.cameras import Camera
from ..support.pictures import heat_map, write_exr, write_png
from ..support.pipeline import pipelined
from .align import aligned
from .half_fit import half_psnr
from .hdr import evaluate_radiance
from .lpips import Lpips
from .metrics import color_corrected, evaluate, flip, masked, psnr
from .timing import milliseconds_in_turn

TIMED_VIEWS = 8  # at most
REPEATS = 3  # renders of each
BYTES_PER_PIXEL = 700  # of a view that is measured: in float64, and what the allocator keeps for its thread


@dataclass(frozen=True)
class Measure:
    """What is measured besides PSNR, SSIM, FLIP and L1, and on which pixels.

    Args:
        masks: pixels that they paint black do not count; views that are black everywhere are left out.
        color_correct: adds ``cc_psnr``, after the best affine map of colours: the exposure of a test view is unknown.
        align_extent: adds ``aligned_psnr``, from the pose near that of the view that fits best (``align.py``), in units
            of this extent of the cameras; None does not.
        lpips: adds the metric of this name, which takes seconds per view.
        appearance: adds ``cc_psnr`` and ``half_psnr`` (``half_fit.py``), both with the vignetting of the view's device.
    """

    masks: Masks | None = None
    color_correct: bool = False
    align_extent: float | None = None
    lpips: Lpips | None = None
    appearance: Appearance | None = None


def evaluate_views(
    picture: Callable[[View], Picture],
    views: Sequence[View],
    background: float,
    out: Path | None = None,
    measure: Measure = Measure(),  # noqa: B008, it is immutable
) -> dict[str, dict[str, float]]:
    """Metrics per view, by view name: those of ``metrics.py``, and of linear images those of ``hdr.py`` too.

    Args:
        picture: renders a view (with depth if it is to be stored).
        background: grey level behind images with alpha.
        out: folder for ``<name>.png``, ``<name>_gt.png``, ``<name>_error.png`` (FLIP, of all pixels),
            ``<name>_mask.png`` (white where pixels count) if the view has a mask, and ``<name>.exr`` (linear colour and
            alpha, depth, FLIP error); None writes nothing.
        measure: what else is measured.
    """
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)

    def each_seen() -> Iterator[_Seen]:
        for view in views:
            mask = measure.masks.of(view) if measure.masks else None
            if mask is None or mask.any():
                yield _see(picture, view, background, mask, measure, out is not None)

    def measured(seen: _Seen) -> tuple[str, dict[str, float]]:
        metrics = _metrics(seen, measure)
        if out is not None:
            _write(seen, background, out)
        return seen.view.name, metrics

    return dict(pipelined(measured, each_seen(), measuring_bytes(views)))


def measuring_bytes(views: Sequence[View]) -> int:
    """Memory that it takes to measure the largest of some views."""
    return BYTES_PER_PIXEL * max((view.camera.width * view.camera.height for view in views), default=0)


@dataclass(frozen=True)
class _Seen:
    """A view with all of it that belongs in the thread which renders: renders, and what has threads of its own.

    ``color``, ``truth``: display-referred, [H, W, 3]; ``color`` of ``aligned`` too. ``error``: the map of FLIP, [H, W],
    of all pixels where it is written.
    """

    view: View
    picture: Picture
    color: np.ndarray
    truth: np.ndarray
    mask: np.ndarray | None
    mean_flip: float
    error: np.ndarray
    radiance: dict[str, float]  # metrics of ``hdr.py``
    aligned: np.ndarray | None
    lpips: dict[str, float]


def _see(
    picture: Callable[[View], Picture],
    view: View,
    background: float,
    mask: np.ndarray | None,
    measure: Measure,
    writes: bool,
) -> _Seen:
    """Render a view and measure what takes renders or all cores; ``writes``: the map of FLIP will be a file."""
    view = view.in_memory()
    rendered, truth = picture(view), photograph(view, background)
    color = seen_as(rendered, view)
    mean_flip, error = flip(color, truth, mask, view.name)
    if writes and mask is not None:
        _, error = flip(color, truth, name=view.name)
    radiance, aligned_color, lpips = {}, None, {}
    if view.white is not None:
        radiance = evaluate_radiance(light_seen_as(rendered, view), radiance_of(view, background), mask)
    if measure.align_extent is not None:
        best = aligned(picture, view, background, measure.align_extent, mask)
        aligned_color = seen_as(picture(best), view)
    if measure.lpips is not None:
        lpips = {"lpips": measure.lpips(np.clip(masked(color, truth, mask), 0, 1), truth, mask)}
    return _Seen(view, rendered, color, truth, mask, mean_flip, error, radiance, aligned_color, lpips)


def _metrics(seen: _Seen, measure: Measure) -> dict[str, float]:
    """All metrics of a view: those that are there, and what one core finds."""
    color, truth, mask = seen.color, seen.truth, seen.mask
    metrics = evaluate(color, truth, seen.view.name, mask, seen.mean_flip) | seen.radiance
    if measure.appearance is not None:
        metrics |= _after_fits(color, truth, seen.view.camera, measure.appearance, mask)
    elif measure.color_correct:
        metrics["cc_psnr"] = psnr(color_corrected(color, truth, mask), truth, mask)
    if seen.aligned is not None:
        metrics["aligned_psnr"] = psnr(seen.aligned, truth, mask)
    return metrics | seen.lpips


def _write(seen: _Seen, background: float, out: Path) -> None:
    shown, original, errors, mask, channels = view_files(out, seen.view.name)
    write_png(shown, seen.color)
    write_png(original, seen.truth)
    write_png(errors, heat_map(seen.error))
    if seen.mask is not None:
        write_png(mask, seen.mask)
    layers = {"color": premultiplied(seen.picture, background), "error": seen.error}
    if seen.picture.depth is not None:
        layers["depth"] = seen.picture.depth
    write_exr(channels, layers)


def view_files(folder: Path, name: str) -> list[Path]:
    """Where ``evaluate_views`` writes a view: the render, its photograph, the map of FLIP, the mask of those that have
    one, and OpenEXR channels."""
    return [folder / f"{name}{end}" for end in (".png", "_gt.png", "_error.png", "_mask.png", ".exr")]


def _after_fits(
    image: np.ndarray, truth: np.ndarray, camera: Camera, appearance: Appearance, mask: np.ndarray | None
) -> dict[str, float]:
    """Metrics after colours were fitted to the photograph: of a view whose camera has learned vignetting."""
    r_sq = radii_squared(camera)
    taken = photographed(image, r_sq, appearance.numbers(camera))
    return {
        "cc_psnr": psnr(color_corrected(taken, truth, mask), truth, mask),
        "half_psnr": half_psnr(image, truth, r_sq, appearance.of_device(camera), mask),
    }


def mean_metrics(results: dict[str, dict[str, float]]) -> dict[str, float]:
    """Mean of each metric over the views; empty without views."""
    if not results:
        return {}
    return {name: float(np.mean([r[name] for r in results.values()])) for name in next(iter(results.values()))}


def render_milliseconds(picture: Callable[[View], Picture], views: Sequence[View]) -> float:
    """Median wall time of ``REPEATS`` renders of each of a few views, with their pictures on the host, in ms."""
    return render_milliseconds_in_turn({"": picture}, views)[""]


def render_milliseconds_in_turn(
    pictures: Mapping[str, Callable[[View], Picture]], views: Sequence[View]
) -> dict[str, float]:
    """``render_milliseconds`` of several models that take turns: what else the machine does slows all alike."""
    some = views[:TIMED_VIEWS]

    def job(picture: Callable[[View], Picture]) -> Callable[[], Picture]:
        order = itertools.cycle(some)
        return lambda: picture(next(order))

    return milliseconds_in_turn({name: job(picture) for name, picture in pictures.items()}, REPEATS * len(some))
