"""Curves as inline SVG: crisp at any size, coloured by the style sheet of the page.

No library: the eight plots of a report are 22 kB here, 113 kB to 4.8 MB by those that were tried, and none of these has
tooltips without a script (docs/experiments/plots.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from .page import TEMPLATES
from .points import RING, ROOM, Note, labels
from .smoothing import thinned
from .ticks import log_ticks, nice_ticks, numbers

WIDTH, LEFT, RIGHT, TOP = 480, 62, 14, 30  # user units; one is about one CSS pixel in the two-column layout
PLOT_HEIGHT, LANE_HEIGHT, MARK_HEIGHT = 190, 18, 14
MARGIN = 0.06  # of the range of the values, above and below them
DIGIT, GAP, MAX_SHIFT = 9, 5, 24  # of the labels of marks: width of a character, space between, way off the line


@dataclass(frozen=True)
class Series:
    """One curve: ``x`` and ``y`` [n]; ``kind`` is line, faint, dashed or points.

    ``color`` is one of the page, 1 to 12 (``style.css``), or its ink, 0. ``notes`` are for points, one each:
    then they have the shape of their colour, and tooltips.
    """

    label: str
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    kind: str = "line"
    color: int = 1
    notes: Sequence[Note] = ()


@dataclass(frozen=True)
class _Scale:
    """Values ``low`` to ``high`` on the way from ``start`` to ``stop`` in user units, linear or logarithmic."""

    low: float
    high: float
    log: bool
    start: float
    stop: float

    def __call__(self, value: float) -> float:
        low, high, v = (math.log(x) if self.log else x for x in (self.low, self.high, value))
        return round(self.start + (v - low) / (high - low) * (self.stop - self.start), 1)

    def ticks(self, count: int) -> list[tuple[float, str]]:
        """Where they are, and their labels."""
        values = log_ticks(self.low, self.high) if self.log else nice_ticks(self.low, self.high, count)
        return [(self(value), words) for value, words in zip(values, numbers(values), strict=True)]


@dataclass(frozen=True)
class Lane:
    """A row of ticks under the curves: when (``x`` [n]) something called ``label`` happened."""

    label: str
    x: NDArray[np.floating]


@dataclass(frozen=True)
class Mark:
    """A dashed line through the curves at ``x``, its label above it or a little to the right if there is room."""

    label: str
    x: float


def line_plot(
    series: Sequence[Series],
    x_label: str,
    y_label: str,
    *,
    log_x: bool = False,
    log_y: bool = False,
    from_zero: bool = False,
    lanes: Sequence[Lane] = (),
    marks: Sequence[Mark] = (),
    x_start: float = 0.0,
    legend: bool = True,
    height: float = PLOT_HEIGHT,
) -> Markup:
    """One figure as an ``<svg>`` element; values no scale can show (NaN; 0 on a logarithmic one) are left out.

    The horizontal axis begins at ``x_start``, or at the first value if that is less; with ``log_x`` a little before the
    first value. ``legend=False`` leaves the names of the series to a legend beside the figure; ``height`` is that of
    the curves alone, in user units.

    Raises ``ValueError`` where nothing is left to draw.
    """
    drawn = [_drawable(s, log_x, log_y) for s in series]
    drawn = [s for s in drawn if len(s.x)]
    if not drawn:
        raise ValueError(f'"{y_label}" has no finite value to draw')
    ys = np.concatenate([s.y for s in drawn])
    marks = sorted((m for m in marks if math.isfinite(m.x)), key=lambda m: m.x)
    top = TOP + (MARK_HEIGHT if marks else 0)
    bottom = top + height
    lanes_top = bottom + (10 if lanes else 0)
    # gaps too: plots of one run share their axis
    px = _Scale(*_x_range(drawn if log_x else series, log_x, x_start), log_x, LEFT, WIDTH - RIGHT)
    named = any(note.label for s in drawn for note in s.notes)
    margin = ROOM / (height - 2 * ROOM) if named else MARGIN
    py = _Scale(*_padded(float(ys.min()), float(ys.max()), log_y, from_zero, margin), log_y, bottom, top)
    curves = [_curve(s, px, py) for s in drawn]
    points = [point for curve in curves if curve["notes"] for point in curve["points"]]
    lines = [curve["points"] for curve in curves if not curve["notes"]]
    notes = [note for s in drawn for note in s.notes]
    svg = TEMPLATES.get_template("report/templates/plot.svg").render(
        width=WIDTH,
        left=LEFT,
        right=WIDTH - RIGHT,
        top=top,
        base=lanes_top + len(lanes) * LANE_HEIGHT,
        x_label=x_label,
        y_label=y_label,
        x_ticks=px.ticks(6),
        y_ticks=py.ticks(5),
        legend=legend and len(drawn) > 1,  # a single curve needs none, the axis says what it is
        lanes=[_lane(lane, lanes_top + row * LANE_HEIGHT, px) for row, lane in enumerate(lanes)],
        marks=_marks(marks, px),
        curves=curves,
        rings=[point for point, note in zip(points, notes, strict=True) if note.label],
        ring=RING,
        labels=labels(points, notes, (LEFT, top, WIDTH, bottom), lines),
    )
    return Markup(svg)


def _drawable(series: Series, log_x: bool, log_y: bool) -> Series:
    """What the scales can show of a series; of a long curve without notes, fewer points of the same outline."""
    ok = np.isfinite(series.x) & np.isfinite(series.y)
    for values, log in ((series.x, log_x), (series.y, log_y)):
        if log:
            ok &= np.where(np.isfinite(values), values, 0) > 0
    if series.notes:
        notes = [note for note, keep in zip(series.notes, ok, strict=True) if keep]
        return replace(series, x=series.x[ok], y=series.y[ok], notes=notes)
    x, y = thinned(series.x[ok], series.y[ok])
    return replace(series, x=x, y=y)


def _x_range(series: Sequence[Series], log: bool, start: float) -> tuple[float, float]:
    """From ``start``, or the first value if that is less, to the last one; never of length 0."""
    xs = np.concatenate([s.x[np.isfinite(s.x)] for s in series])
    low, high = float(xs.min()), float(xs.max())
    if log:
        return _padded(low, high, True, False)
    low = min(start, low)
    return low, high if high > low else low + max(1.0, 1e-6 * abs(low))


def _padded(low: float, high: float, log: bool, from_zero: bool, share: float = MARGIN) -> tuple[float, float]:
    """The range of an axis: that of its values, and a margin (``share`` of it, of a linear one) on either side."""
    if log:
        margin = max((high / low) ** 0.05, 1.02)
        return low / margin, high * margin
    low = min(0.0, low) if from_zero else low
    margin = share * (high - low) or 0.5 * abs(high) or 1.0
    return (low if from_zero else low - margin), high + margin


def _lane(lane: Lane, y: float, px: _Scale) -> dict[str, Any]:
    return {"label": lane.label, "y": y, "places": sorted({px(x) for x in lane.x if math.isfinite(x)})}


def _marks(marks: Sequence[Mark], px: _Scale) -> list[dict[str, Any]]:
    """Where the lines are, and their labels: one gives way to the one before, or is left out."""
    found, free_from = [], 0.0
    for mark in marks:
        place, half = px(mark.x), len(mark.label) * DIGIT / 2
        middle = round(max(place, free_from + half), 1)
        fits = middle - place <= MAX_SHIFT and middle + half <= WIDTH
        found.append({"x": place, "label": mark.label if fits else "", "label_x": middle})
        free_from = middle + half + GAP if fits else free_from
    return found


def _curve(series: Series, px: _Scale, py: _Scale) -> dict[str, Any]:
    points = [(px(x), py(y)) for x, y in zip(series.x.tolist(), series.y.tolist(), strict=True)]
    tooltips = [note.title for note in series.notes] or [f"{y:.4g}" for y in series.y.tolist()]
    return {
        "label": series.label,
        "kind": series.kind,
        "color": series.color,
        "points": points,
        "notes": bool(series.notes),
        "tooltips": list(zip(points, tooltips, strict=True)) if series.kind == "points" else [],
    }
