"""The test views of a report: a table of all, and pictures of a few from best to worst."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from ..support.wording import finite, fixed
from .pictures import embedded_jpeg, embedded_png, figure, placed, read_pictures, worst_box
from .run_folder import Run

MAX_SHOWN = 6

READ_TABLE = """Views that training never saw, best first. PSNR and SSIM: higher is better. FLIP (what the eye
notices when flipping between the two pictures) and L1: lower is better."""
READ_PICTURES = """Render, ground truth, and where they differ to the eye: FLIP error from
<span class=range>0<span class=scale></span>to 1.</span> The frame marks where the error is largest, the close-ups
enlarge it. The files themselves are in <code>test/</code>."""

ViewMetrics = Mapping[str, object]


@dataclass(frozen=True)
class RankedView:
    """A test view; ``place`` is best (highest PSNR), median, worst, or empty in between."""

    name: str
    place: str
    metrics: ViewMetrics

    @property
    def title(self) -> str:
        """Name and place, as HTML."""
        return escape(self.name) + (f", {self.place} view" if self.place else "")


def views_section(run: Run) -> str:
    """The table and the pictures, as HTML; a run without test views is named as such."""
    folder = run.path / "test"
    found: dict[str, ViewMetrics] = {p.stem.removesuffix("_gt"): {} for p in sorted(folder.glob("*_gt.png"))}
    views = ranked((run.metrics or {}).get("views") or found)
    head = "<h2>Test views</h2>"
    if not views:
        return f"{head}<p>There are no test views: metrics.json names none, and test/ holds no pictures.</p>"
    if any(view.metrics for view in views):
        head += f"<p class=read>{READ_TABLE}</p>{views_table(views)}<h2>Pictures</h2>"
    pictures = "".join(view_pictures(view, folder) for view in shown(views))
    return f"{head}<p class=read>{READ_PICTURES}</p>{pictures}"


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


def views_table(views: list[RankedView]) -> str:
    """All test views with their metrics; the bar spans from the worst PSNR (short) to the best (full)."""
    values = [v for v in (finite(view.metrics.get("psnr")) for view in views) if v is not None]
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    rows = []
    for view in views:
        m, psnr = view.metrics, finite(view.metrics.get("psnr"))
        share = 0.0 if psnr is None else 0.15 + 0.85 * ((psnr - low) / (high - low) if high > low else 1.0)
        rows.append(
            f"<tr><td>{escape(view.name)}</td><td class=n>{fixed(psnr, 2)}</td>"
            f'<td><span class=bar><i style="width:{100 * share:.0f}%"></i></span></td>'
            f"<td class=n>{fixed(m.get('ssim'), 4)}</td><td class=n>{fixed(m.get('flip'), 4)}</td>"
            f"<td class=n>{fixed(m.get('l1'), 4)}</td><td>{view.place}</td></tr>"
        )
    return (
        "<div class=scroll><table class=views><thead><tr><th>view<th class=n>PSNR, dB<th><th class=n>SSIM"
        f"<th class=n>FLIP<th class=n>L1<th></tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def view_pictures(view: RankedView, folder: Path) -> str:
    """Render, ground truth and FLIP map of one view, in full and enlarged where the error is largest."""
    m = view.metrics
    head = f"<header><h3>{view.title}</h3>"
    if finite(m.get("psnr")) is not None:
        head += (
            f"<span>PSNR {fixed(m.get('psnr'), 2)} dB</span><span>SSIM {fixed(m.get('ssim'), 4)}</span>"
            f"<span>FLIP {fixed(m.get('flip'), 4)}</span>"
        )
    suffixes = {"Render": "", "Ground truth": "_gt", "FLIP error": "_error"}
    pictures, words = read_pictures({what: folder / f"{view.name}{end}.png" for what, end in suffixes.items()})
    if not pictures:
        return f"<article class=view>{head}</header>{words}</article>"
    full, close_ups = [], []
    size = next(iter(pictures.values())).size
    box = None
    if "FLIP error" in pictures and all(p.size == size for p in pictures.values()):
        box = worst_box(np.asarray(pictures["FLIP error"].convert("L"), np.float64))
    mark = "" if box is None else placed("b", box, size)
    for what, picture in pictures.items():
        full.append(figure(what, embedded_jpeg(picture), size, mark))
        if box is not None:
            left, top, w, h = box
            crop = picture.crop((left, top, left + w, top + h))
            close_ups.append(figure(f"{what}, close up", embedded_png(crop), size))
    shape = "tall" if size[1] > size[0] else "wide"
    triples = f"<div class='triple full'>{''.join(full)}</div>"
    if close_ups:
        triples += f"<div class=triple>{''.join(close_ups)}</div>"
    return f"<article class=view>{head}</header><div class='sheet {shape}'>{triples}</div>{words}</article>"
