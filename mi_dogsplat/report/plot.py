"""Curves as inline SVG: crisp at any size, coloured by the style sheet of the page, no library."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np
from numpy.typing import NDArray

from .points import Note, labels, marker, rings, swatch

WIDTH, LEFT, RIGHT, TOP = 480, 62, 14, 30  # user units; one is about one CSS pixel in the two-column layout
PLOT_HEIGHT, LANE_HEIGHT, MARK_HEIGHT, BOTTOM = 190, 18, 14, 44
DIGIT, GAP, MAX_SHIFT = 9, 5, 24  # of the labels of marks: width of a character, space between, way off the line
MAX_POINTS = 2000


@dataclass(frozen=True)
class Series:
    """One curve: ``x`` and ``y`` [n]; ``kind`` is line, faint, dashed or points; ``color`` 1 to 7 of the page, or 0.

    ``notes`` are for points, one each: then they have the shape of their colour, and tooltips.
    """

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
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
        return self.start + (v - low) / (high - low) * (self.stop - self.start)

    def ticks(self, count: int) -> list[float]:
        return log_ticks(self.low, self.high) if self.log else nice_ticks(self.low, self.high, count)


@dataclass(frozen=True)
class Lane:
    """A row of ticks under the curves: when (``x`` [n]) something called ``label`` happened."""

    label: str
    x: NDArray[np.float64]


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
) -> str:
    """One figure as an ``<svg>`` element; values no scale can show (NaN; 0 on a logarithmic one) are left out.

    The horizontal axis begins at ``x_start``, or at the first value if that is less; with ``log_x`` a little before the
    first value. ``legend=False`` leaves the names of the series to a ``legend_list`` beside the figure; ``height`` is
    that of the curves alone, in user units.

    :raises ValueError: nothing is left to draw
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
    base = lanes_top + len(lanes) * LANE_HEIGHT
    # gaps too: plots of one run share their axis
    px = _Scale(*_x_range(drawn if log_x else series, log_x, x_start), log_x, LEFT, WIDTH - RIGHT)
    py = _Scale(*_padded(float(ys.min()), float(ys.max()), log_y, from_zero), log_y, bottom, top)

    parts = [f'<text class="label" x="4" y="16">{escape(y_label)}</text>', _legend(drawn) if legend else ""]
    for y in py.ticks(5):
        parts.append(f'<path class="grid" d="M{LEFT} {py(y):.1f}H{WIDTH - RIGHT}"/>')
        parts.append(f'<text class="tick" text-anchor="end" x="{LEFT - 7}" y="{py(y) + 4:.1f}">{number(y)}</text>')
    for x in px.ticks(6):
        parts.append(f'<path class="axis" d="M{px(x):.1f} {base}v4"/>')
        parts.append(f'<text class="tick" text-anchor="middle" x="{px(x):.1f}" y="{base + 18}">{number(x)}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(f'<text class="label" text-anchor="middle" x="{middle}" y="{base + 38}">{escape(x_label)}</text>')
    parts.append(f'<path class="axis" d="M{LEFT} {base}H{WIDTH - RIGHT}"/>')
    for row, lane in enumerate(lanes):
        parts.append(_lane(lane, lanes_top + row * LANE_HEIGHT, px))
    parts.append(_marks(marks, top, base, px))
    parts += [_curve(s, px, py) for s in drawn]
    parts.append(_notes(drawn, px, py, (LEFT, top, WIDTH, bottom)))
    name = escape(f"{y_label} against {x_label}", quote=True)
    size = f'viewBox="0 0 {WIDTH} {base + BOTTOM}"'
    return f'<svg {size} role="img" aria-label="{name}">{"".join(parts)}</svg>'


def legend_list(series: Sequence[tuple[str, int]]) -> str:
    """Names and colours of series as an HTML list with their shapes, for figures that share one legend."""
    return f"<ul class=legend>{''.join(f'<li>{swatch(color)}{escape(label)}' for label, color in series)}</ul>"


def nice_ticks(low: float, high: float, count: int) -> list[float]:
    """About ``count`` round values (1, 2 or 5 times a power of ten apart) within low..high."""
    raw = (high - low) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten; powers alone over many decades; `nice_ticks` if too few."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for multiples in ((1, 2, 5), (1,)):
        ticks = [m * 10.0**d for d in decades for m in multiples if low <= m * 10.0**d <= high]
        if len(ticks) <= 7:
            break
    return ticks if len(ticks) >= 3 else nice_ticks(low, high, 5)


def number(value: float) -> str:
    """A tick label: ``20k``, ``1.5M``, ``3e9``, ``2e-7``, else up to four digits; with a true minus sign."""
    if abs(value) >= 1e9:
        return f"{value:.4g}".replace("e+0", "e").replace("e+", "e").replace("-", "\u2212")
    for scale, unit in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= scale:
            return f"{value / scale:.4g}{unit}".replace("-", "\u2212")
    return f"{value:.4g}".replace("e-0", "e-").replace("-", "\u2212") if abs(value) > 1e-12 else "0"


def thinned(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most `MAX_POINTS` points: the lowest and highest of every run of neighbours, so no spike is lost."""
    if len(x) <= MAX_POINTS:
        return x, y
    runs = np.array_split(np.arange(len(x)), MAX_POINTS // 2)
    keep = np.unique([pick for run in runs for pick in (run[np.argmin(y[run])], run[np.argmax(y[run])])])
    return x[keep], y[keep]


def _drawable(series: Series, log_x: bool, log_y: bool) -> Series:
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
    xs = np.concatenate([s.x[np.isfinite(s.x)] for s in series])
    low, high = float(xs.min()), float(xs.max())
    if log:
        return _padded(low, high, True, False)
    low = min(start, low)
    return low, high if high > low else low + max(1.0, 1e-6 * abs(low))


def _padded(low: float, high: float, log_y: bool, from_zero: bool) -> tuple[float, float]:
    if log_y:
        margin = max((high / low) ** 0.05, 1.02)
        return low / margin, high * margin
    low = min(0.0, low) if from_zero else low
    margin = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    return (low if from_zero else low - margin), high + margin


def _legend(series: Sequence[Series]) -> str:
    """In the row above the plot; a single curve needs none, the axis says what it is."""
    if len(series) < 2:
        return ""
    entries = "".join(
        f'<tspan class="key k{s.color} {s.kind}" dx="{14 if i else 0}">\u2014</tspan>'
        f'<tspan dx="5">{escape(s.label)}</tspan>'
        for i, s in enumerate(series)
    )
    return f'<text class="tick" text-anchor="end" x="{WIDTH - RIGHT}" y="16">{entries}</text>'


def _lane(lane: Lane, y: float, px: Callable[[float], float]) -> str:
    places = sorted({round(px(x), 1) for x in lane.x if math.isfinite(x)})
    ticks = "".join(f"M{p} {y + 4}v{LANE_HEIGHT - 7}" for p in places)
    return (
        f'<text class="tick" text-anchor="end" x="{LEFT - 7}" y="{y + 13.5}">{escape(lane.label)}</text>'
        f'<path class="grid" d="M{LEFT} {y}H{WIDTH - RIGHT}"/><path class="event" d="{ticks}"/>'
    )


def _marks(marks: Sequence[Mark], top: float, base: float, px: Callable[[float], float]) -> str:
    """Lines from ``top`` to ``base`` for all; a label gives way to the one before, or is left out."""
    lines, labels, free_from = "", "", 0.0
    for place, label in ((round(px(mark.x), 1), mark.label) for mark in marks):
        lines += f"M{place} {top}V{base}"
        half = len(label) * DIGIT / 2
        middle = max(place, free_from + half)
        if middle - place <= MAX_SHIFT and middle + half <= WIDTH:
            labels += f'<text class="tick" text-anchor="middle" x="{middle}" y="{top - 3}">{escape(label)}</text>'
            free_from = middle + half + GAP
    return f'<path class="mark" d="{lines}"/>{labels}' if marks else ""


def _curve(series: Series, px: Callable[[float], float], py: Callable[[float], float]) -> str:
    points = [(px(x), py(y)) for x, y in zip(series.x.tolist(), series.y.tolist(), strict=True)]
    line = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    if series.kind != "points":
        return f'<path class="c{series.color} {series.kind}" d="{line}"/>'
    if series.notes:
        shapes = (marker(series.color, *at, note.title) for at, note in zip(points, series.notes, strict=True))
        return f'<path class="c{series.color} faint" d="{line}"/>{"".join(shapes)}'
    dots = "".join(
        f'<circle class="c{series.color} points" cx="{x:.1f}" cy="{y:.1f}" r="3.5"><title>{value:.4g}</title></circle>'
        for (x, y), value in zip(points, series.y.tolist(), strict=True)
    )
    return f'<path class="c{series.color} faint" d="{line}"/>{dots}'


def _notes(series: Sequence[Series], px: _Scale, py: _Scale, frame: tuple[float, float, float, float]) -> str:
    """Rings and words of the points that stand out, above all curves."""
    points = [(px(x), py(y)) for s in series if s.notes for x, y in zip(s.x.tolist(), s.y.tolist(), strict=True)]
    notes = [note for s in series for note in s.notes]
    return rings(points, notes) + labels(points, notes, frame)
