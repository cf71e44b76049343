"""The training images of a report that do not fit the model: which, how badly, why, and what helps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..support.wording import finite
from .pictures import Figure, embedded_jpeg, read_pictures
from .run_folder import MISFITS, Run

MAX_SHOWN = 8  # with pictures
MASK = "mask it (by dogsplat masks, or by hand), or take more images of it"
CAUSES = {
    "exposure": ("exposure or white balance", "a change of its colours", "train with --appearance"),
    "pose": ("its pose is off", "a small motion of the render", "correct its pose, or leave the image out"),
    "blur": ("it is blurred", "a blur of the render", "leave the image out"),
    "region": ("something was in the way, moved, or is hardly seen elsewhere", "a part of the picture", MASK),
}  # fmt: skip
PICTURES = {"Photograph": "_gt", "Render": "", "Error": "_error"}


@dataclass(frozen=True)
class ShownMisfit:
    """An image that does not fit: its likely cause and the remedy in words, and pictures of it, of the worst ones."""

    name: str
    psnr: float | None
    below: float | None
    cause: str
    evidence: str
    remedy: str
    figures: Sequence[Figure]
    missing: Sequence[str]


@dataclass(frozen=True)
class Misfits:
    """``n_looked_at`` of ``n_views`` training views were looked at; ``shown`` are the worst first."""

    n_views: int
    n_looked_at: int
    shown: Sequence[ShownMisfit]


def misfits(run: Run) -> Misfits | None:
    """Those that the run has found; None where it has not looked for any, or at too few views to tell."""
    found = run.misfits
    if not found or len(found.get("psnr") or {}) < found.get("fewest", 0):
        return None
    entries = list((found.get("misfits") or {}).items())
    shown = [_shown(run, name, entry, i < MAX_SHOWN) for i, (name, entry) in enumerate(entries)]
    looked_at = len(found.get("psnr") or {})
    return Misfits(int(finite(found.get("n_views")) or looked_at), looked_at, shown)


def _shown(run: Run, name: str, entry: Mapping[str, Any], pictured: bool) -> ShownMisfit:
    folder = (run.path / MISFITS).parent
    files = {what: folder / f"{name}{end}.png" for what, end in PICTURES.items()} if pictured else {}
    pictures, missing = read_pictures(files)
    figures = [Figure(what, embedded_jpeg(picture), picture.size) for what, picture in pictures.items()]
    cause, by, remedy = CAUSES.get(str(entry.get("cause")), ("not clear", "", "look at it"))
    share = finite(entry.get("explained"))
    evidence = f"{by} explains {100 * share:.0f} % of its error, more than usual" if by and share else ""
    if by and not share:  # told by its lack of fine detail alone
        evidence = "compared with its render, it has far less fine detail than other images"
    return ShownMisfit(
        name, finite(entry.get("psnr")), finite(entry.get("below")), cause, evidence, remedy, figures, missing
    )
