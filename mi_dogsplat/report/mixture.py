"""The mixture in a report: its two kinds of primitives alone, and the error with and without DoG."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..support.wording import count, finite, fixed
from .pictures import embedded_jpeg, figure, placed, read_pictures, worst_box
from .plot import Series, line_plot
from .run_folder import Run
from .views import ranked

BAND = 16  # the frame around the marked part of the row is 1/16 of the picture high

READ_PARTS = """The model is a mixture of plain Gaussians and Differences of Gaussians (DoG), here each kind alone as
well, over the same background. The render is not their sum: they stand in front of one another. Both FLIP errors go
from <span class=range>0<span class=scale></span>to 1.</span>"""
READ_PROFILE = """Absolute error along the marked row, pixel by pixel, mean of the three channels: lower is better.
The second plot is the framed quarter, where the two errors differ most. The row is the one where the two renders
differ most, which need not be where DoG helps most."""


def mixture_section(run: Run) -> str:
    """Pictures, FLIP maps and error profile, as HTML; nothing for a run that compared none."""
    profile = run.dog_profile
    if profile is None:
        return ""
    name, row = str(profile.get("view")), finite(profile.get("row")) or 0.0
    sides = {"with DoG": profile.get("with_dog") or {}, "without": profile.get("without_dog") or {}}
    errors = [np.array(side.get("error") or [0.0], np.float64) for side in sides.values()]  # [W] each
    errors = [error[: min(map(len, errors))] for error in errors]
    left, _, width, _ = worst_box(np.abs(np.subtract(*errors))[None, :])
    views = ranked((run.metrics or {}).get("views") or {name: {}})
    title = next((view.title for view in views if view.name == name), escape(name))
    facts = "".join(f"<span>{words}: {_metrics(side.get('metrics') or {})}</span>" for words, side in sides.items())
    without = f"Without DoG: {escape(str(profile.get('without')))}."
    plots = [_plot(list(sides), errors, row, *span) for span in ((0, len(errors[0])), (left, left + width))]
    return (
        f"<h2>With and without DoG</h2><p class=read>{READ_PARTS} {without}</p>"
        f"<article class=view><header><h3>{title}</h3>{facts}</header>{_sheet(run, name, (left, row, width))}</article>"
        f"<div class=plots>{''.join(plots)}</div><p class=read>{READ_PROFILE}</p>"
    )


def _plot(labels: list[str], errors: list[NDArray[np.float64]], row: float, start: int, stop: int) -> str:
    x = np.arange(start, stop, dtype=np.float64)
    pairs = enumerate(zip(labels, errors, strict=True))
    curves = [Series(label, x, error[start:stop], color=i + 1) for i, (label, error) in pairs]
    return line_plot(curves, f"pixel of row {row:.0f}", "absolute error", from_zero=True, x_start=float(start))


def _sheet(run: Run, name: str, segment: tuple[int, float, int]) -> str:
    """Two rows of pictures of one size; ``segment`` is left end, image row and length of what is framed."""
    metrics = run.metrics or {}
    n, n_dog = finite(metrics.get("n")), finite(metrics.get("n_dog"))
    plain = None if n is None or n_dog is None else n - n_dog
    suffixes = {
        "Render": "",
        f"The {count(plain)} plain Gaussians alone": "_gaussian",
        f"The {count(n_dog)} DoG alone": "_dog",
        "Render without DoG": "_plain",
        "FLIP error with DoG": "_error",
        "FLIP error without DoG": "_plain_error",
    }
    folder = run.path / "test"
    pictures, words = read_pictures({what: folder / f"{name}{end}.png" for what, end in suffixes.items()})
    if not pictures:
        return words
    size = next(iter(pictures.values())).size
    left, row, width = segment
    middle, band = row + 0.5, size[1] / BAND
    top = min(max(middle - band / 2, 0), size[1] - band)
    mark = placed("i", (0, middle, size[0], 0), size) + placed("b", (left, top, width, band), size)
    figures = [figure(what, embedded_jpeg(picture), size, mark) for what, picture in pictures.items()]
    triples = "".join(f"<div class='triple full'>{''.join(figures[k : k + 3])}</div>" for k in (0, 3))
    return f"<div class='sheet {'tall' if size[1] > size[0] else 'wide'}'>{triples}</div>{words}"


def _metrics(values: dict[str, Any]) -> str:
    return f"PSNR {fixed(values.get('psnr'), 2)} dB, FLIP {fixed(values.get('flip'), 4)}"
