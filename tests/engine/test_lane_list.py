"""Lanes walk down the bits of their words, in order and without leaving one out, however they read the words."""

import drjit as dr
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types, while_loop
from mi_dogsplat.engine.tiles import WORD, TileLists
from mi_dogsplat.engine.walks.lane_list import AheadList, LaneList

TILES, LANES, STEPS = 8, 4, 4
ISECTS = 2000
BEGIN = np.array([0, 0, 31, 32, 500, 500, 1984, 1999])
END = np.array([0, 31, 32, 500, 500, 1984, 1999, 2000])


def bits_of(density: float) -> np.ndarray:
    """[isects, lanes]: whether an isect is one of the lane's. Whole words are empty in between."""
    rng = np.random.default_rng(7)
    mine = rng.random((ISECTS, LANES)) < density
    empty = np.repeat(rng.random((-(-ISECTS // WORD), LANES)) < 0.3, WORD, axis=0)[:ISECTS]
    return mine & ~empty


def lists_of(mine: np.ndarray) -> TileLists:
    n_words = -(-ISECTS // WORD)
    words = np.full((TILES + n_words, LANES), 0xFFFFFFFF, np.uint32)  # what no tile has is not written
    for tile in range(TILES):
        if BEGIN[tile] < END[tile]:
            words[tile + BEGIN[tile] // WORD : tile + (END[tile] - 1) // WORD + 1] = 0
        for isect in range(BEGIN[tile], END[tile]):
            words[tile + isect // WORD] |= mine[isect].astype(np.uint32) << np.uint32(isect % WORD)
    UInt = array_types().UInt
    nothing = dr.zeros(UInt, 1)
    begin, end = UInt(BEGIN.astype(np.uint32)), UInt(END.astype(np.uint32))
    return TileLists(nothing, begin, end, nothing, nothing, nothing, UInt(words.ravel()))


def folded(isects: np.ndarray) -> int:
    """A number that depends on each isect and on their order."""
    value = 0
    for isect in isects.tolist():
        value = (value * 31 + isect + 1) % 2**32
    return value


@pytest.mark.parametrize("kind", [LaneList, AheadList])
@pytest.mark.parametrize("density", [0.02, 0.5, 1.0])
def test_a_lane_meets_its_isects_in_order_and_each_once(kind, density):
    mine, UInt = bits_of(density), array_types().UInt
    tile = dr.arange(UInt, TILES * LANES) // LANES
    walked = tile != 3
    lane_list = kind(lists_of(mine), tile, LANES, walked)

    def body(place, met):
        for _ in range(STEPS):
            isect, active, place = lane_list.next(place)
            met = dr.select(active, met * 31 + isect + 1, met)
        return lane_list.look_ahead(place), met

    start = lane_list.start(), dr.zeros(UInt, TILES * LANES)
    _, met = while_loop(start, lambda place, met: lane_list.goes_on(place), body, "list", ("place", "met"))
    expected = [
        folded(np.flatnonzero(mine[BEGIN[t] : END[t], lane]) + BEGIN[t]) if t != 3 else 0
        for t in range(TILES) for lane in range(LANES)
    ]  # fmt: skip
    np.testing.assert_array_equal(met.numpy(), np.array(expected, np.uint32))
