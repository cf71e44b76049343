"""Points of a plot that have names: a tooltip each, and words beside those that stand out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

POINT, RING = 5.0, 8.5  # user units: radii
CHARACTER, LINE, CLEAR = 7.2, 13.0, 10.0  # user units: of a label, and its distance from the point

Box = tuple[float, float, float, float]  # left, top, right, bottom


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


def labels(points: Sequence[tuple[float, float]], notes: Sequence[Note], frame: Box) -> list[Label]:
    """Words beside the points that have some: to the right, left, above or below, wherever is room; else left out.

    Args:
        points, notes: all points of the plot. None of them, and no ring, is covered.
        frame: what the words must stay inside of.
    """
    radii = [RING if note.label else POINT for note in notes]
    taken: list[Box] = [(x - r, y - r, x + r, y + r) for (x, y), r in zip(points, radii, strict=True)]
    found = []
    for place, words in dict.fromkeys((p, n.label) for p, n in zip(points, notes, strict=True) if n.label):
        for label in _candidates(words, *place):
            box = label.box
            inside = frame[0] <= box[0] and frame[1] <= box[1] and box[2] <= frame[2] and box[3] <= frame[3]
            if inside and not any(_meet(box, other) for other in taken):
                found.append(label)
                taken.append(box)
                break
    return found


def _candidates(words: str, x: float, y: float) -> list[Label]:
    """In the four places around a point."""
    around = [
        ("start", x + CLEAR, y + LINE / 3),
        ("end", x - CLEAR, y + LINE / 3),
        ("middle", x, y - CLEAR - 3),
        ("middle", x, y + CLEAR + LINE - 3),
    ]
    return [Label(words, anchor, round(x, 1), round(y, 1)) for anchor, x, y in around]


def _meet(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
