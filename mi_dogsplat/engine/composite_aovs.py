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

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from collections.abc import Sequence

import drjit as dr

from .frozen import frozen
from .geometry import Grid
from .tables import Tables
from .tiles import Lists
from .walk import Settings, Walk, planes_of

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


def composite_aovs(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings, depths, names: tuple
) -> list:
    """Planes [H*W] of the ``names``, in their order.

    Args:
        depths: [N], depth of each primitive; for ``median_depth`` alone, else None.
        names: as ``walked`` gives them; the kernel holds nothing of the others.

    An index is a float, as channels of a film are: exact up to 2^24.
    """
    return planes_of(_composite_aovs(grid, lanes, tables, lists, settings, depths, names), len(names))


@frozen
def _composite_aovs(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings, depths, names: tuple
) -> list:
    walk = Walk(grid, lanes, tables, lists, settings)
    start = {key: value for name in names for key, value in STATE[name].items()}

    def body(at, T, state):
        T, state = list(T), {key: list(values) for key, values in state.items()}
        for _ in range(walk.blocks.unroll):
            isect, active, at = walk.next(at)
            splat, row, dx, dy = walk.fetch(isect, active)
            alpha, _, _, _, is_dog = walk.alphas(splat, row, active, dx, dy)
            index = walk.Float(splat)
            depth = None if depths is None else dr.gather(walk.Float, depths, splat, active)
            for k in range(walk.pixels):
                weight, behind, go = walk.advance(alpha[k], T[k], row, k)
                weight = dr.select(go, weight, 0)
                blended = go & (alpha[k] != 0)
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
                    update("dog", state["dog"][k] + size, is_dog)
        return at, T, state

    _, _, state = dr.while_loop(
        (walk.start(), walk.start_T(), {key: [walk.Float(value)] * walk.pixels for key, value in start.items()}),
        lambda at, T, state: walk.more(at) & walk.alive(T),
        body,
        labels=("at", "T", "state"),
        label="composite_aovs",
    )
    if "all" in start:
        pairs = zip(state["dog"], state["all"], strict=True)
        state["dog_share"] = [dr.select(whole > 0, part / whole, 0) for part, whole in pairs]
    return walk.write([state[name] for name in names])
