"""Stage 3 once more: replay the walk of ``composite`` for what no sum Σ f α T can say about a pixel.

Notation as in ``composite.py``; w = α T is the weight of a primitive at a pixel, negative where its pseudo-Gaussian
exceeds its primary. Of the primitives that are blended there, in depth order:

    median_depth   depth of the first behind which T ≤ 1/2 (as in 2DGS, Huang et al. 2024); 0 where T stays above. It
                   may rise again further behind
    index          primitive of the largest w, the nearest of equals; -1 where no w is positive
    count          number of primitives
    dog_share      Σ |w| over the DoG primitives / Σ |w| over all; 0 where there is none

What is ignored (|α| < 1/255) and what lies behind the end of the walk is not blended. These are piecewise constant, or
ratios that nothing is trained by: they have no derivative here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr

from ..bands import PreparedView, WalkableView
from ..frozen import frozen
from .pixels import planes_of
from .walk import Meeting, Walk


@dataclass
class Passed:
    """A primitive that a walk has gone past, at a pixel."""

    weight: Any  # w; 0 behind the end of the walk
    behind: Any  # T behind it
    is_blended: Any
    depth: Any  # None where nobody asks for it
    index: Any
    is_dog: Any  # None in a model without DoG


def _median_depth(state: dict, passed: Passed) -> dict:
    so_far = state["median_depth"]  # depths are positive: 0 says that there is none yet
    is_it = passed.is_blended & (passed.behind <= 0.5) & (so_far == 0)
    return {"median_depth": dr.select(is_it, passed.depth, so_far)}


def _index(state: dict, passed: Passed) -> dict:
    larger = passed.weight > state["largest"]
    return {
        "index": dr.select(larger, passed.index, state["index"]),
        "largest": dr.select(larger, passed.weight, state["largest"]),
    }


def _count(state: dict, passed: Passed) -> dict:
    return {"count": dr.select(passed.is_blended, state["count"] + 1, state["count"])}


def _dog_share(state: dict, passed: Passed) -> dict:
    size = dr.abs(passed.weight)
    return {"all": state["all"] + size, "dog": dr.select(passed.is_dog, state["dog"] + size, state["dog"])}


class Aov(NamedTuple):
    """What a pixel carries along for it: at the start, and behind another primitive; in the end it is ``value``."""

    start: dict[str, float]
    behind: Callable[[dict, Passed], dict]
    value: Callable[[dict], Any]
    nothing: float  # value of a pixel that nothing reaches


AOVS = {
    "median_depth": Aov({"median_depth": 0}, _median_depth, lambda state: state["median_depth"], 0.0),
    "index": Aov({"index": -1, "largest": 0}, _index, lambda state: state["index"], -1.0),
    "count": Aov({"count": 0}, _count, lambda state: state["count"], 0.0),
    "dog_share": Aov(
        {"dog": 0, "all": 0}, _dog_share, lambda s: dr.select(s["all"] > 0, s["dog"] / s["all"], 0), 0.0
    ),
}
WALKED = tuple(AOVS)
NOTHING = {name: aov.nothing for name, aov in AOVS.items()}


def walked(names: Sequence[str], has_dog: bool) -> tuple[str, ...]:
    """Those AOVs that take a walk; without a DoG primitive none is needed to know its share."""
    return tuple(name for name in WALKED if name in names and (has_dog or name != "dog_share"))


def composite_aovs(view: WalkableView, names: tuple[str, ...], depths=None) -> list:
    """Planes [H*W] of the ``names``, in their order.

    Args:
        names: as ``walked`` gives them; the kernel holds nothing of the others.
        depths: [N], depth of each primitive; for ``median_depth`` alone, else None.

    An index is a float, as channels of a film are: exact up to 2^24.
    """
    planes = view.walked(lambda band, above: _composite_aovs(band, names, depths, above), [])
    return planes_of(planes, len(names))


@frozen
def _composite_aovs(view: PreparedView, names: tuple[str, ...], depths, above: list) -> list:
    walk = Walk(view)
    Float, asked = walk.types.Float, [AOVS[name] for name in names]

    def step(meeting: Meeting, T: list, pixels: list[dict]) -> None:
        alphas, index = walk.alphas(meeting), Float(meeting.splat)
        depth = None if depths is None else dr.gather(Float, depths, meeting.splat, meeting.active)
        for k, α in enumerate(alphas.values):
            weight, behind, goes_on = walk.advance(α, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            T[k] = behind
            passed = Passed(weight, behind, goes_on & (α != 0), depth, index, alphas.is_dog)
            for aov in asked:
                pixels[k].update(aov.behind(pixels[k], passed))

    start = {key: Float(value) for aov in asked for key, value in aov.start.items()}
    _, pixels = walk.run(step, [dict(start) for _ in range(walk.pixels.count)], "composite_aovs")
    return walk.pixels.write([[aov.value(pixel) for pixel in pixels] for aov in asked], above)
