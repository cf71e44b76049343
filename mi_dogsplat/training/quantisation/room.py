"""What a file of a given size has room for beside its primitives: a larger palette.

Primitives that all fit leave bytes over. A palette that is fitted to fewer colours of each entry loses less
(docs/quantisation.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...formats.coded import STEPS
from ...formats.grids import MOST_ENTRIES
from ...formats.sizes import FileKind
from ...formats.sog import MAX_PALETTE
from ...scene.splats import Splats

FILLED = 0.95  # of the size: a palette that is trained may take more bytes than the first


@dataclass(frozen=True)
class Room:
    """A file of ``kind`` that may have ``size`` bytes."""

    size: int
    kind: FileKind

    def most_entries(self, splats: Splats) -> int:
        """How many entries of the palette each SH degree may have: the usual number, doubled as often as the file of
        the model keeps within its size and the primitives take up more."""
        counts = np.bincount(splats.sh_degrees, minlength=1)[1:]  # of degree 0 there is nothing to look up
        wanted, most = STEPS[self.kind.name].entries * counts.max(initial=0), MOST_ENTRIES
        while most < wanted and 2 * most * np.count_nonzero(counts) <= MAX_PALETTE and self._holds(splats, 2 * most):
            most *= 2
        return most

    def _holds(self, splats: Splats, most: int) -> bool:
        return self.kind.size(self.kind.foreseen(splats, most)) <= FILLED * self.size
