"""A lane's own list: the isects of its tile that touch its block, as bits of words (``tiles.py``)."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..arrays import array_types
from ..tiles import WORD, TileLists


class LaneList:
    """Trace-time helper: a lane reads a word when it needs it, in the same step; an empty word costs one.

    A place in the list is (bits of the isects of the present word that are still to come, number of the next word).
    """

    def __init__(self, lists: TileLists, tile: Any, lanes_per_tile: int, walked: Any = True):
        """``walked``: false in the lanes whose lists are left out."""
        UInt = array_types().UInt
        begin, end = (dr.gather(UInt, ends, tile) for ends in (lists.begin, lists.end))
        self.words, self.lanes_per_tile = lists.words, lanes_per_tile
        self.begin, self.tile = begin, tile
        self.end = dr.select((begin < end) & walked, end, 0)
        self.end_group = (self.end + (WORD - 1)) // WORD
        self.lane = dr.arange(UInt, dr.width(tile)) % lanes_per_tile

    def start(self) -> tuple:
        return array_types().UInt(0), self.begin // WORD

    def goes_on(self, place: tuple) -> Any:
        bits, group = place
        return (bits != 0) | (group < self.end_group)

    def next(self, place: tuple) -> tuple:
        """(Isect, whether there is one, where the lane then is)"""
        bits, group = place
        refill = (bits == 0) & (group < self.end_group)
        word = self._word(group, refill)
        bits, group = dr.select(refill, word, bits), dr.select(refill, group + 1, group)
        return dr.fma(group - 1, WORD, dr.tzcnt(bits)), bits != 0, (bits & (bits - 1), group)

    def look_ahead(self, place: tuple) -> tuple:
        """Called after the steps of an iteration."""
        return place

    def _word(self, group: Any, active: Any) -> Any:
        at = (self.tile + group) * self.lanes_per_tile + self.lane
        return dr.gather(array_types().UInt, self.words, at, active)


class AheadList(LaneList):
    """The same isects, but each word is read an iteration before it is needed.

    Otherwise the steps of an iteration wait for a word one after the other. Lanes meet an isect in another order than
    with ``LaneList``: sums over lanes would have other bits.

    A place is (bits, isect of their lowest place, the next word or 0 once it is taken, first isect behind that).
    """

    def start(self) -> tuple:
        group = self.begin // WORD
        present, first = self._word(group, group < self.end_group), group * WORD
        return self.look_ahead((present, first, array_types().UInt(0), first + WORD))

    def goes_on(self, place: tuple) -> Any:
        bits, _, ahead, following = place
        return ((bits | ahead) != 0) | (following < self.end)

    def next(self, place: tuple) -> tuple:
        bits, base, ahead, following = place
        empty = bits == 0
        bits = dr.select(empty, ahead, bits)
        base = dr.select(empty, following - WORD, base)
        return base + dr.tzcnt(bits), bits != 0, (bits & (bits - 1), base, dr.select(empty, 0, ahead), following)

    def look_ahead(self, place: tuple) -> tuple:
        bits, base, ahead, following = place
        taken = (ahead == 0) & (following < self.end)
        word = self._word(following // WORD, taken)
        return bits, base, dr.select(taken, word, ahead), dr.select(taken, following + WORD, following)
