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

from collections.abc import Sequence

import drjit as dr

from ..bands import PreparedView, WalkableView
from ..frozen import frozen
from .pixels import planes_of
from .walk import Meeting, Walk

WALKED = ("median_depth", "index", "count", "dog_share")
# What a pixel carries along for each, and what it starts with
STATE = {
    "median_depth": {"median_depth": 0},
    "index": {"index": -1, "largest": 0},
    "count": {"count": 0},
    "dog_share": {"dog": 0, "all": 0},
}
NOTHING = {"median_depth": 0.0, "index": -1.0, "count": 0.0, "dog_share": 0.0}  # of a pixel that nothing reaches


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
    Float = walk.types.Float
    start = {key: value for name in names for key, value in STATE[name].items()}

    def step(meeting: Meeting, T: list, state: dict) -> None:
        alphas, index = walk.alphas(meeting), Float(meeting.splat)
        depth = None if depths is None else dr.gather(Float, depths, meeting.splat, meeting.active)
        for k, a in enumerate(alphas.values):
            weight, behind, goes_on = walk.advance(a, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            blended = goes_on & (a != 0)
            T[k] = behind

            def update(key, value, where, k=k):
                state[key][k] = dr.select(where, value, state[key][k])

            if "median_depth" in start:  # depths are positive: 0 says that there is none yet
                update("median_depth", depth, blended & (behind <= 0.5) & (state["median_depth"][k] == 0))
            if "index" in start:
                larger = weight > state["largest"][k]
                update("index", index, larger)
                update("largest", weight, larger)
            if "count" in start:
                update("count", state["count"][k] + 1, blended)
            if "all" in start:
                size = dr.abs(weight)
                state["all"][k] = state["all"][k] + size  # not +=: pixels share their first value
                update("dog", state["dog"][k] + size, alphas.is_dog)

    state = {key: [Float(value)] * walk.pixels.count for key, value in start.items()}
    _, state = walk.run(step, state, "composite_aovs")
    if "all" in start:
        pairs = zip(state["dog"], state["all"], strict=True)
        state["dog_share"] = [dr.select(whole > 0, part / whole, 0) for part, whole in pairs]
    return walk.pixels.write([state[name] for name in names], above)
