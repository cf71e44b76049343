"""The test views of a report: a table of all, and pictures of a few from best to worst."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from mi_dogsplat.run_folder import Run
from mi_dogsplat.wording import finite, fixed
from numpy.typing import NDArray
from PIL import Image

MAX_SHOWN = 6
MAX_SIDE = 900  # pixels; larger pictures are scaled down in the page, the files keep their size
ZOOM = 4  # the close-up is 1/4 of the picture in both directions

READ_TABLE = """Views that training never saw, best first. PSNR and SSIM: higher is better. FLIP (what the eye
notices when flipping between the two pictures) and L1: lower is better."""
READ_PICTURES = """Render, ground truth, and where they differ to the eye: FLIP error from 0<span
class=scale></span>to 1. The frame marks where the error is largest, the close-ups enlarge it. The files
themselves are in <code>test/</code>."""

ViewMetrics = Mapping[str, object]


@dataclass(frozen=True)
class RankedView:
    """A test view; ``place`` is best (highest PSNR), median, worst, or empty in between."""

    name: str
    place: str
    metrics: ViewMetrics


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
    title = f"{escape(view.name)}{f', {view.place} view' if view.place else ''}"
    head = f"<header><h3>{title}</h3>"
    if finite(m.get("psnr")) is not None:
        head += (
            f"<span>PSNR {fixed(m.get('psnr'), 2)} dB</span><span>SSIM {fixed(m.get('ssim'), 4)}</span>"
            f"<span>FLIP {fixed(m.get('flip'), 4)}</span>"
        )
    pictures: dict[str, Image.Image] = {}
    missing = []
    for what, suffix in (("Render", ""), ("Ground truth", "_gt"), ("FLIP error", "_error")):
        path = folder / f"{view.name}{suffix}.png"
        try:
            with Image.open(path) as image:
                pictures[what] = image.convert("RGB")
        except OSError:
            missing.append(f"<code>{escape(path.name)}</code>")
    words = f"<p class=read>Missing or not readable: {', '.join(missing)}.</p>" if missing else ""
    if not pictures:
        return f"<article class=view>{head}</header>{words}</article>"
    full, close_ups = [], []
    size = next(iter(pictures.values())).size
    box = None
    if "FLIP error" in pictures and all(p.size == size for p in pictures.values()):
        box = worst_box(np.asarray(pictures["FLIP error"].convert("L"), np.float64))
    for what, picture in pictures.items():
        full.append(_figure(what, _embedded_jpeg(picture), size, box))
        if box is not None:
            left, top, w, h = box
            crop = picture.crop((left, top, left + w, top + h))
            close_ups.append(_figure(f"{what}, close up", _embedded_png(crop), size, None))
    shape = "tall" if size[1] > size[0] else "wide"
    triples = f"<div class='triple full'>{''.join(full)}</div>"
    if close_ups:
        triples += f"<div class=triple>{''.join(close_ups)}</div>"
    return f"<article class=view>{head}</header><div class='sheet {shape}'>{triples}</div>{words}</article>"


def worst_box(error: NDArray[np.float64]) -> tuple[int, int, int, int]:
    """Left, top, width, height of the window of 1/`ZOOM` of the picture [H, W] that holds the most error."""
    height, width = error.shape
    h, w = max(1, height // ZOOM), max(1, width // ZOOM)
    sums = np.pad(error, ((1, 0), (1, 0))).cumsum(0).cumsum(1)  # [H + 1, W + 1]
    totals = sums[h:, w:] - sums[:-h, w:] - sums[h:, :-w] + sums[:-h, :-w]  # [H - h + 1, W - w + 1]
    top, left = np.unravel_index(int(np.argmax(totals)), totals.shape)
    return int(left), int(top), w, h


def _figure(what: str, source: str, size: tuple[int, int], box: tuple[int, int, int, int] | None) -> str:
    """``size`` gives the aspect ratio: a close-up, cut at whole pixels, takes its picture's to align."""
    width, height = size
    mark = ""
    if box is not None:
        left, top, w, h = (100 * v / s for v, s in zip(box, (width, height, width, height), strict=True))
        mark = f"<b style='left:{left:.2f}%;top:{top:.2f}%;width:{w:.2f}%;height:{h:.2f}%'></b>"
    ratio = f"aspect-ratio:{width}/{height}"
    frame = f"<span class=frame style='{ratio}'><img src='{source}' alt='{what}'>{mark}</span>"
    return f"<figure>{frame}<figcaption>{what}</figcaption></figure>"


def _embedded_jpeg(picture: Image.Image) -> str:
    small = picture.copy()
    small.thumbnail((MAX_SIDE, MAX_SIDE), Image.Resampling.LANCZOS)
    data = io.BytesIO()
    small.save(data, "JPEG", quality=90, subsampling=0, optimize=True)
    return "data:image/jpeg;base64," + base64.b64encode(data.getvalue()).decode()


def _embedded_png(picture: Image.Image) -> str:
    data = io.BytesIO()
    picture.save(data, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
