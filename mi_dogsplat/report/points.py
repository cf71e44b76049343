"""Points of a plot that have names: a tooltip each, and words beside those that stand out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

POINT, RING = 5.0, 8.5  # user units: radii
CHARACTER, LINE, CLEAR = 7.2, 13.0, 10.0  # user units: of a label, and its distance from the point
ROOM = CLEAR + LINE + 3.0  # user units: for a label above or below a point
SHIFT, FURTHER = 5.0, (0, 4, 8)  # user units: above and below, to a side and away, where curves are in the way

Box = tuple[float, float, float, float]  # left, top, right, bottom
Line = Sequence[tuple[float, float]]  # its corners


@dataclass(frozen=True)
class Note:
    """Of one point: the words of its tooltip and, if it is to stand out, those beside it. Then it has a ring, too."""

    title: str
    label: str = ""


@dataclass(frozen=True)
class Label:
    """Words with their baseline at (``x``, ``y``), which is their start, middle or end by ``anchor``."""

    words: str
    anchor: str
    x: float
    y: float

    @property
    def box(self) -> Box:
        width = len(self.words) * CHARACTER
        left = self.x - width * {"start": 0, "middle": 0.5, "end": 1}[self.anchor]
        return left, self.y - LINE + 3, left + width, self.y + 3


def labels(
    points: Sequence[tuple[float, float]], notes: Sequence[Note], frame: Box, lines: Sequence[Line] = ()
) -> list[Label]:
    """Words beside the points that have some: to the right, left, above or below, wherever is room and the fewest lines
    are crossed; else left out.

    Args:
        points, notes: all points of the plot. None of them, and no ring, is covered.
        frame: what the words must stay inside of.
        lines: curves that the words should leave free.
    """
    radii = [RING if note.label else POINT for note in notes]
    taken: list[Box] = [(x - r, y - r, x + r, y + r) for (x, y), r in zip(points, radii, strict=True)]
    found = []
    for place, words in dict.fromkeys((p, n.label) for p, n in zip(points, notes, strict=True) if n.label):
        free = [
            label
            for label in _candidates(words, *place)
            if _inside(label.box, frame) and not any(_meet(label.box, other) for other in taken)
        ]
        if free:
            label = min(free, key=lambda each: sum(_passes(line, each.box) for line in lines))
            found.append(label)
            taken.append(label.box)
    return found


def _candidates(words: str, x: float, y: float) -> list[Label]:
    """Around a point, the nearest first: of equally good places the first is taken."""
    around = [("start", x + CLEAR, y + LINE / 3), ("end", x - CLEAR, y + LINE / 3)]
    for further in FURTHER:
        rows = y - CLEAR - 3 - further, y + CLEAR + LINE - 3 + further
        around += [("middle", x, row) for row in rows]
        around += [(anchor, x + shift, row) for row in rows for anchor, shift in (("start", SHIFT), ("end", -SHIFT))]
    return [Label(words, anchor, round(x, 1), round(y, 1)) for anchor, x, y in around]


def _inside(box: Box, frame: Box) -> bool:
    return frame[0] <= box[0] and frame[1] <= box[1] and box[2] <= frame[2] and box[3] <= frame[3]


def _passes(line: Line, box: Box) -> bool:
    """Whether a line goes through a box."""
    return any(_share_inside(start, end, box) for start, end in pairwise(line))


def _share_inside(start: tuple[float, float], end: tuple[float, float], box: Box) -> bool:
    """Whether some of a straight line lies in a box (Liang and Barsky 1984)."""
    first, last = 0.0, 1.0  # shares of its length between which it is inside, as far as is known
    for axis in (0, 1):
        low, high, way = box[axis] - start[axis], box[axis + 2] - start[axis], end[axis] - start[axis]
        if way == 0:
            if low >= 0 or high <= 0:
                return False
            continue
        enters, leaves = sorted((low / way, high / way))
        first, last = max(first, enters), min(last, leaves)
    return first < last


def _meet(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
