"""Points of a plot that have names: a shape per colour, a tooltip each, and words beside those that stand out.

Colours alone do not tell seven series apart for everybody; shape and colour together do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

# Around (0, 0), as tall as the text is high; the first is for colour 0, the ink of the page.
SHAPES = (
    "M0 -7L7 0L0 7L-7 0Z",  # large diamond
    "M-4 0A4 4 0 1 0 4 0A4 4 0 1 0 -4 0Z",  # circle
    "M-3.7 -3.7H3.7V3.7H-3.7Z",  # square
    "M0 -5L4.8 3.6H-4.8Z",  # triangle
    "M0 5L4.8 -3.6H-4.8Z",  # triangle upside down
    "M-1.6 -5H1.6V-1.6H5V1.6H1.6V5H-1.6V1.6H-5V-1.6H-1.6Z",  # plus
    "M0 -4.6L4.4 -1.4L2.7 3.7H-2.7L-4.4 -1.4Z",  # pentagon
    "M-4.2 -4.6H4.2L0 0L4.2 4.6H-4.2L0 0Z",  # hourglass
)
POINT, RING = 5.0, 8.5  # user units: radii
CHARACTER, LINE, CLEAR = 7.2, 13.0, 10.0  # user units: of a label, and its distance from the point

Box = tuple[float, float, float, float]  # left, top, right, bottom


@dataclass(frozen=True)
class Note:
    """Of one point: the words of its tooltip and, if it is to stand out, those beside it. Then it has a ring, too."""

    title: str
    label: str = ""


def marker(color: int, x: float, y: float, title: str) -> str:
    """The shape of a colour with its tooltip."""
    place = f'transform="translate({x:.1f} {y:.1f})"'
    return f'<path class="c{color} points" {place} d="{SHAPES[color]}"><title>{escape(title)}</title></path>'


def swatch(color: int) -> str:
    """The shape of a colour for a legend in HTML."""
    return f'<svg class="swatch" viewBox="-8 -8 16 16" aria-hidden="true">{marker(color, 0, 0, "")}</svg>'


def rings(points: Sequence[tuple[float, float]], notes: Sequence[Note]) -> str:
    """A ring around each point whose note has a label."""
    return "".join(
        f'<circle class="ring" cx="{x:.1f}" cy="{y:.1f}" r="{RING}"/>'
        for (x, y), note in zip(points, notes, strict=True)
        if note.label
    )


def labels(points: Sequence[tuple[float, float]], notes: Sequence[Note], frame: Box) -> str:
    """Words beside the points that have some: to the right, left, above or below, wherever is room; else left out.

    Args:
        points, notes: all points of the plot. None of them, and no ring, is covered.
        frame: what the words must stay inside of.
    """
    radii = [RING if note.label else POINT for note in notes]
    taken: list[Box] = [(x - r, y - r, x + r, y + r) for (x, y), r in zip(points, radii, strict=True)]
    texts = ""
    for place, label in dict.fromkeys((p, n.label) for p, n in zip(points, notes, strict=True) if n.label):
        for anchor, x, y in _candidates(*place):
            box = _box(anchor, x, y, len(label) * CHARACTER)
            inside = frame[0] <= box[0] and frame[1] <= box[1] and box[2] <= frame[2] and box[3] <= frame[3]
            if inside and not any(_meet(box, other) for other in taken):
                texts += f'<text class="note" text-anchor="{anchor}" x="{x:.1f}" y="{y:.1f}">{escape(label)}</text>'
                taken.append(box)
                break
    return texts


def _candidates(x: float, y: float) -> list[tuple[str, float, float]]:
    """(text-anchor, x, y of the baseline) of the four places around a point."""
    middle = y + LINE / 3
    return [
        ("start", x + CLEAR, middle),
        ("end", x - CLEAR, middle),
        ("middle", x, y - CLEAR - 3),
        ("middle", x, y + CLEAR + LINE - 3),
    ]


def _box(anchor: str, x: float, y: float, width: float) -> Box:
    left = x - width * {"start": 0, "middle": 0.5, "end": 1}[anchor]
    return left, y - LINE + 3, left + width, y + 3


def _meet(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
