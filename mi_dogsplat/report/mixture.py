"""The mixture in a report: its two kinds of primitives alone, and the error with and without DoG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..support.wording import count, finite
from .pictures import Figure, embedded_jpeg, frame, read_pictures, worst_box
from .plot import Series, line_plot
from .run_folder import Run
from .views import ranked

BAND = 16  # the frame around the marked part of the row is 1/16 of the picture high

@dataclass(frozen=True)
class Mixture:
    """What the section shows of the compared ``title``, by side: ``metrics`` with DoG, and ``without``."""

    title: str
    without: str
    metrics: Mapping[str, Mapping[str, Any]]
    pictures: Sequence[Figure]
    missing: Sequence[str]
    plots: Sequence[Markup]


def mixture(run: Run) -> Mixture | None:
    """Pictures, FLIP maps and error profile; None for a run that compared none."""
    profile = run.dog_profile
    if profile is None:
        return None
    name, row = str(profile.get("view")), finite(profile.get("row")) or 0.0
    sides = {"with DoG": profile.get("with_dog") or {}, "without": profile.get("without_dog") or {}}
    errors = [np.array(side.get("error") or [0.0], np.float64) for side in sides.values()]  # [W] each
    errors = [error[: min(map(len, errors))] for error in errors]
    left, _, width, _ = worst_box(np.abs(np.subtract(*errors))[None, :])
    views = ranked((run.metrics or {}).get("views") or {name: {}})
    return Mixture(
        next((view.title for view in views if view.name == name), name),
        str(profile.get("without")),
        {words: side.get("metrics") or {} for words, side in sides.items()},
        *_pictures(run, name, (left, row, width)),
        [_plot(list(sides), errors, row, *span) for span in ((0, len(errors[0])), (left, left + width))],
    )


def _plot(labels: list[str], errors: list[NDArray[np.float64]], row: float, start: int, stop: int) -> Markup:
    x = np.arange(start, stop, dtype=np.float64)
    pairs = enumerate(zip(labels, errors, strict=True))
    curves = [Series(label, x, error[start:stop], color=i + 1) for i, (label, error) in pairs]
    return line_plot(curves, f"pixel of row {row:.0f}", "absolute error", from_zero=True, x_start=float(start))


def _pictures(run: Run, name: str, segment: tuple[int, float, int]) -> tuple[list[Figure], list[str]]:
    """Of one size, and the names of the missing; ``segment`` is left end, image row and length of what is framed."""
    metrics = run.metrics or {}
    n, n_dog = finite(metrics.get("n")), finite(metrics.get("n_dog"))
    plain = None if n is None or n_dog is None else n - n_dog
    suffixes = {
        "Render": "",
        f"The {count(plain)} plain Gaussians only": "_gaussian",
        f"The {count(n_dog)} DoG only": "_dog",
        "Render without DoG": "_plain",
        "FLIP error with DoG": "_error",
        "FLIP error without DoG": "_plain_error",
    }
    folder = run.path / "test"
    pictures, missing = read_pictures({what: folder / f"{name}{end}.png" for what, end in suffixes.items()})
    if not pictures:
        return [], missing
    size = next(iter(pictures.values())).size
    left, row, width = segment
    middle, band = row + 0.5, size[1] / BAND
    top = min(max(middle - band / 2, 0), size[1] - band)
    marks = [frame((0, middle, size[0], 0), size), frame((left, top, width, band), size)]
    return [Figure(what, embedded_jpeg(picture), size, marks) for what, picture in pictures.items()], missing
