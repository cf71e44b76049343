"""Results as lines of text."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..formats.read import size_of
from ..support.wording import counted, file_size, printable
from .streams import discard, is_unread

if TYPE_CHECKING:
    from ..editing.clean import Cleaned
    from ..editing.simplify import Simplified
    from ..export.write import Exported
    from ..masking.make import Found

NAMED = 3  # photographs that a line names
METRICS = {
    "psnr": "PSNR {:.2f} dB", "cc_psnr": "colour-corrected {:.2f} dB", "half_psnr": "by halves {:.2f} dB",
    "aligned_psnr": "pose-aligned {:.2f} dB",
    "ssim": "SSIM {:.4f}", "flip": "FLIP {:.4f}", "l1": "L1 {:.5f}", "lpips": "LPIPS {:.4f}",
    "psnr_mu": "PSNR-μ {:.2f} dB", "hdr_flip": "HDR-FLIP {:.4f}",
}  # fmt: skip


def metrics_line(values: dict[str, float]) -> str:
    """The metrics that are there."""
    return "  ".join(text.format(values[name]) for name, text in METRICS.items() if name in values)


def loss_table(exported: Exported) -> list[str]:
    """What each stage of an export loses against the model, and against the photographs if there are any."""
    if not exported.losses:
        return []
    photographs = any(loss.of_photographs is not None for loss in exported.losses)
    lines = [f"PSNR over {counted(exported.n_views, 'view'):14s}of the model" + "   of photographs" * photographs]
    for loss in exported.losses:
        columns = [f"{'-':>6s}   " if loss.of_model is None else f"{loss.of_model:6.2f} dB"]
        if loss.of_photographs is not None:
            columns.append(f"{loss.of_photographs:6.2f} dB")
        lines.append(f"  {loss.stage:24s}" + "       ".join(columns).rstrip())
    return lines + ([] if exported.refine_seconds is None else [f"refining took {exported.refine_seconds:.0f} s"])


def cleaned_lines(cleaned: Cleaned) -> list[str]:
    """What was taken out, and what that did to the pictures if there is a data set."""
    lines = [f"  {reason}: {number:,}" for reason, number in cleaned.taken_out]
    lines += [f"  not needed, {line}" for line in cleaned.unneeded]
    first = f"{counted(cleaned.n_before, 'primitive')}, removed:" + ("" if lines else " nothing")
    if cleaned.psnr:
        before, after = cleaned.psnr
        lines.append(f"  PSNR {before:.2f} dB before, {after:.2f} dB after ({after - before:+.2f})")
    return [first, *lines, *cleaned.left_out]


def simplified_lines(simplified: Simplified) -> list[str]:
    """How near the smaller model is to the one that it was made of."""
    over = f"over {counted(simplified.n_views, 'view')} to which nothing was fitted"
    lines = [*simplified.left_out, f"PSNR of the model, {over}"]
    stages = {"merged": simplified.merged, "fitted": simplified.fitted}
    return lines + [f"  {stage:24s}{value:6.2f} dB" for stage, value in stages.items() if value is not None]


def masks_lines(out: Path, found: Found) -> list[str]:
    """How much is masked, and where most is."""
    from ..datasets.masks import MOSTLY

    n, most = len(found.shares), list(found.masked.items())
    if not most:
        return [f"{out}: nothing is masked in any of {counted(n, 'photograph')}"]
    of_all = sum(found.shares.values()) / n
    named = ", ".join(f"{printable(name)} ({100 * share:.0f} %)" for name, share in most[:NAMED])
    where = f"in {len(most)} of {counted(n, 'photograph')}; the most in {named}"
    lines = [f"{out}: {100 * of_all:.1f} % of all pixels are masked, {where}"]
    whole = [name for name, share in most if share > MOSTLY]
    if whole:
        named, masked = printable(whole[0]), counted(len(whole), "photograph")
        lines.append(f"more than half of {masked} is masked, such as {named}; poses may be wrong")
    return lines


def size_line(out: Path, n_splats: int, model: Path) -> str:
    """What was written, beside what it was made of."""
    size, before = file_size(out.stat().st_size), file_size(size_of(model))
    return f"{out}: {counted(n_splats, 'primitive')}, {size}; {model.name} has {before}"


def say(line: str) -> None:
    """Print it at once, also where a program reads it. Where nobody does any more, as after a terminal was closed, the
    work that it is about goes on without a word."""
    try:
        print(line, flush=True)
    except OSError as error:
        if not is_unread(error):
            raise
        discard(sys.stdout)
