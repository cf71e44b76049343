"""The lists of ``tiles`` as NumPy arrays."""

import numpy as np
from mi_dogsplat.engine.geometry import Grid
from mi_dogsplat.engine.tiles import WORD, TileLists


def lanes_of_isects(lists: TileLists, grid: Grid) -> np.ndarray:
    """[isects, lanes per tile] which lanes look at which isect, read from the words as a lane does."""
    words = lists.words.numpy().reshape(-1, grid.blocks.lanes_per_tile)
    found = np.zeros((len(lists.splat_from_isect), grid.blocks.lanes_per_tile), bool)
    for tile, (begin, end) in enumerate(zip(lists.begin.numpy(), lists.end.numpy(), strict=True)):
        groups = range(int(begin) // WORD, (int(end) - 1) // WORD + 1) if begin < end else ()
        for group in groups:
            bits = words[tile + group] >> np.arange(WORD, dtype=np.uint32)[:, None] & 1
            inside = np.arange(group * WORD, (group + 1) * WORD)
            own = (inside >= begin) & (inside < end)
            assert not bits[~own].any(), "a lane would walk into the list of another tile"
            found[inside[own]] = bits[own]
    return found
