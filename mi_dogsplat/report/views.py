"""The test views of a report: a table of all, and pictures of a few from best to worst."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..support.wording import finite
from .pictures import Figure, embedded_jpeg, embedded_png, frame, read_pictures, worst_box
from .run_folder import Run

MAX_SHOWN = 6

ViewMetrics = Mapping[str, object]


@dataclass(frozen=True)
class RankedView:
    """A test view; ``place`` is best (highest PSNR), median, worst, or empty in between."""

    name: str
    place: str
    metrics: ViewMetrics

    @property
    def title(self) -> str:
        """Name and place."""
        return self.name + (f", {self.place} view" if self.place else "")

    @property
    def psnr(self) -> float | None:
        return finite(self.metrics.get("psnr"))


@dataclass(frozen=True)
class Sheet:
    """A view in pictures: in ``full`` and, where they all fit together, a ``close_up`` of each."""

    view: RankedView
    full: Sequence[Figure]
    close_ups: Sequence[Figure]
    missing: Sequence[str]


def views(run: Run) -> list[RankedView]:
    """All that metrics.json names or, without one, test/ has pictures of; best first."""
    truths = sorted((run.path / "test").glob("*_gt.png"))
    return ranked((run.metrics or {}).get("views") or {path.stem.removesuffix("_gt"): {} for path in truths})


def ranked(views: Mapping[str, ViewMetrics]) -> list[RankedView]:
    """Best view first, by PSNR; views without a PSNR last."""
    names = sorted(views, key=lambda name: (-(finite(views[name].get("psnr")) or -1.0), name))
    places = {len(names) // 2: "median", len(names) - 1: "worst", 0: "best"} if len(names) > 2 else {}
    return [RankedView(name, places.get(i, ""), views[name]) for i, name in enumerate(names)]


def shown(views: list[RankedView]) -> list[RankedView]:
    """At most `MAX_SHOWN` of the ranked views: best, median, worst, and others evenly between."""
    if len(views) <= MAX_SHOWN:
        return views
    n = len(views)
    places = {0, n // 4, n // 2, (3 * n) // 4, n - 1}
    return [views[i] for i in sorted(places)]


def shares(views: Sequence[RankedView]) -> list[float]:
    """How long a bar is for each PSNR, in percent: from the worst one (short) to the best (full)."""
    values = [view.psnr for view in views if view.psnr is not None]
    low, span = min(values, default=0.0), max(values, default=0.0) - min(values, default=0.0)
    fractions = [None if view.psnr is None else (view.psnr - low) / span if span else 1.0 for view in views]
    return [0.0 if f is None else 15 + 85 * f for f in fractions]


def sheet(view: RankedView, folder: Path) -> Sheet:
    """Render, ground truth and FLIP map of one view, in full and enlarged where the error of what counts is largest."""
    suffixes = {"Render": "", "Ground truth": "_gt", "FLIP error": "_error"}
    pictures, missing = read_pictures({what: folder / f"{view.name}{end}.png" for what, end in suffixes.items()})
    full, close_ups = [], []
    size = next(iter(pictures.values())).size if pictures else (0, 0)
    box = None
    if "FLIP error" in pictures and all(p.size == size for p in pictures.values()):
        error = np.asarray(pictures["FLIP error"].convert("L"), np.float64)
        mask = read_pictures({"": folder / f"{view.name}_mask.png"})[0].get("")
        counts = mask is None or mask.size != size or np.asarray(mask.convert("L")) > 0
        box = worst_box(np.where(counts, error, 0))
    for what, picture in pictures.items():
        full.append(Figure(what, embedded_jpeg(picture), size, [frame(box, size)] if box else []))
        if box:
            left, top, w, h = box
            crop = picture.crop((left, top, left + w, top + h))
            close_ups.append(Figure(f"{what}, close up", embedded_png(crop), size))
    return Sheet(view, full, close_ups, missing)
