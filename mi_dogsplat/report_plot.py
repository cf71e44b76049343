"""Curves as inline SVG: crisp at any size, coloured by the style sheet of the page, no library."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

WIDTH, LEFT, RIGHT, TOP = 480, 62, 14, 30  # user units; one is about one CSS pixel in the two-column layout
PLOT_HEIGHT, LANE_HEIGHT, MARK_HEIGHT, BOTTOM = 190, 18, 14, 44
DIGIT, GAP, MAX_SHIFT = 9, 5, 24  # of the labels of marks: width of a character, space between, way off the line
MAX_POINTS = 2000


@dataclass(frozen=True)
class Series:
    """One curve: ``x`` and ``y`` [n]; ``kind`` is line, faint or points; ``color`` 1 or 2 of the page."""

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    kind: str = "line"
    color: int = 1


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
    log_y: bool = False,
    from_zero: bool = False,
    lanes: Sequence[Lane] = (),
    marks: Sequence[Mark] = (),
    x_start: float = 0.0,
) -> str:
    """One figure as an ``<svg>`` element; values no scale can show (NaN; 0 with ``log_y``) are left out.

    The horizontal axis begins at ``x_start``, or at the first value if that is less.

    :raises ValueError: nothing is left to draw
    """
    drawn = [_drawable(s, log_y) for s in series]
    drawn = [s for s in drawn if len(s.x)]
    if not drawn:
        raise ValueError(f'"{y_label}" has no finite value to draw')
    xs = np.concatenate([s.x[np.isfinite(s.x)] for s in series])  # gaps too: plots of one run share their axis
    ys = np.concatenate([s.y for s in drawn])
    x_low, x_high = min(x_start, float(xs.min())), float(xs.max())
    x_high = x_high if x_high > x_low else x_low + 1
    y_low, y_high = _padded(float(ys.min()), float(ys.max()), log_y, from_zero)
    marks = sorted((m for m in marks if math.isfinite(m.x)), key=lambda m: m.x)
    top = TOP + (MARK_HEIGHT if marks else 0)
    bottom = top + PLOT_HEIGHT
    lanes_top = bottom + (10 if lanes else 0)
    base = lanes_top + len(lanes) * LANE_HEIGHT

    def px(x: float) -> float:
        return LEFT + (x - x_low) / (x_high - x_low) * (WIDTH - LEFT - RIGHT)

    def py(y: float) -> float:
        low, high, value = (math.log(v) for v in (y_low, y_high, y)) if log_y else (y_low, y_high, y)
        return bottom - (value - low) / (high - low) * PLOT_HEIGHT

    parts = [f'<text class="label" x="4" y="16">{escape(y_label)}</text>', _legend(drawn)]
    for y in log_ticks(y_low, y_high) if log_y else nice_ticks(y_low, y_high, 5):
        parts.append(f'<path class="grid" d="M{LEFT} {py(y):.1f}H{WIDTH - RIGHT}"/>')
        parts.append(f'<text class="tick" text-anchor="end" x="{LEFT - 7}" y="{py(y) + 4:.1f}">{number(y)}</text>')
    for x in nice_ticks(x_low, x_high, 6):
        parts.append(f'<path class="axis" d="M{px(x):.1f} {base}v4"/>')
        parts.append(f'<text class="tick" text-anchor="middle" x="{px(x):.1f}" y="{base + 18}">{number(x)}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(f'<text class="label" text-anchor="middle" x="{middle}" y="{base + 38}">{escape(x_label)}</text>')
    parts.append(f'<path class="axis" d="M{LEFT} {base}H{WIDTH - RIGHT}"/>')
    for row, lane in enumerate(lanes):
        parts.append(_lane(lane, lanes_top + row * LANE_HEIGHT, px))
    parts.append(_marks(marks, top, base, px))
    parts += [_curve(s, px, py) for s in drawn]
    name = escape(f"{y_label} against {x_label}", quote=True)
    size = f'viewBox="0 0 {WIDTH} {base + BOTTOM}"'
    return f'<svg {size} role="img" aria-label="{name}">{"".join(parts)}</svg>'


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
    """A tick label: thousands as ``20k``, millions as ``1.5M``, else up to four digits; a true minus sign."""
    for scale, unit in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= scale:
            return f"{value / scale:.4g}{unit}".replace("-", "\u2212")
    return f"{value:.4g}".replace("-", "\u2212") if abs(value) > 1e-12 else "0"


def thinned(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most `MAX_POINTS` points: the lowest and highest of every run of neighbours, so no spike is lost."""
    if len(x) <= MAX_POINTS:
        return x, y
    runs = np.array_split(np.arange(len(x)), MAX_POINTS // 2)
    keep = np.unique([pick for run in runs for pick in (run[np.argmin(y[run])], run[np.argmax(y[run])])])
    return x[keep], y[keep]


def _drawable(series: Series, log_y: bool) -> Series:
    ok = np.isfinite(series.x) & np.isfinite(series.y)
    if log_y:
        ok &= np.where(np.isfinite(series.y), series.y, 0) > 0
    x, y = thinned(series.x[ok], series.y[ok])
    return Series(series.label, x, y, series.kind, series.color)


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
    dots = "".join(
        f'<circle class="c{series.color} points" cx="{x:.1f}" cy="{y:.1f}" r="3.5"><title>{value:.4g}</title></circle>'
        for (x, y), value in zip(points, series.y.tolist(), strict=True)
    )
    return f'<path class="c{series.color} faint" d="{line}"/>{dots}'
