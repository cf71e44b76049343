"""Metrics and pictures of a model on views with ground truth."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from .datasets.dataset import View
from .lpips import Lpips
from .metrics import evaluate, flip
from .pictures import heat_map, write_exr, write_png
from .render import Picture, over_background, premultiplied
from .timing import milliseconds_in_turn

TIMED_VIEWS = 8  # at most


def evaluate_views(
    picture: Callable[[View], Picture],
    views: Sequence[View],
    background: float,
    out: Path | None = None,
    lpips: Lpips | None = None,
) -> dict[str, dict[str, float]]:
    """Metrics per view, by view name.

    Args:
        picture: renders a view (with depth if it is to be stored).
        background: grey level behind images with alpha.
        out: folder for ``<name>.png``, ``<name>_gt.png``, ``<name>_error.png`` (FLIP) and ``<name>.exr``
            (linear colour and alpha, depth, FLIP error); None writes nothing.
        lpips: adds the metric ``lpips``, which takes seconds per view.
    """
    results = {}
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    for view in views:
        rendered, truth = picture(view), over_background(view.image, background)
        results[view.name] = evaluate(rendered.color, truth, view.name)
        if lpips is not None:
            results[view.name]["lpips"] = lpips(np.clip(rendered.color, 0, 1), truth)
        if out is not None:
            _, error = flip(rendered.color, truth)
            write_png(out / f"{view.name}.png", rendered.color)
            write_png(out / f"{view.name}_gt.png", truth)
            write_png(out / f"{view.name}_error.png", heat_map(error))
            layers = {"color": premultiplied(rendered, background), "error": error}
            if rendered.depth is not None:
                layers["depth"] = rendered.depth
            write_exr(out / f"{view.name}.exr", layers)
    return results


def mean_metrics(results: dict[str, dict[str, float]]) -> dict[str, float]:
    """Mean of each metric over the views; empty without views."""
    if not results:
        return {}
    return {name: float(np.mean([r[name] for r in results.values()])) for name in next(iter(results.values()))}


def render_milliseconds(picture: Callable[[View], Picture], views: Sequence[View], repeats: int = 3) -> float:
    """Median wall time of ``repeats`` renders of each of a few views, with their pictures on the host, in ms."""
    return render_milliseconds_in_turn({"": picture}, views, repeats)[""]


def render_milliseconds_in_turn(
    pictures: Mapping[str, Callable[[View], Picture]], views: Sequence[View], repeats: int = 3
) -> dict[str, float]:
    """``render_milliseconds`` of several models that take turns: what else the machine does slows all alike."""
    some = views[:TIMED_VIEWS]

    def job(picture: Callable[[View], Picture]) -> Callable[[], Picture]:
        order = itertools.cycle(some)
        return lambda: picture(next(order))

    return milliseconds_in_turn({name: job(picture) for name, picture in pictures.items()}, repeats * len(some))
