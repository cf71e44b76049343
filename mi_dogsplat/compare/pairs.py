"""What seeds say: differences to a reference from equal starts, their intervals, and the time to a quality."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit  # pyright: ignore[reportAttributeAccessIssue]

from ..report.run_folder import read_run

REFERENCES = ("ours", "ours_gaussian", "paper", "3dgs")  # the first of them that is there
LEVELS = ("paper", "released", "speedy_splat", "3dgs_capped", "3dgs")  # whose final quality the others shall reach
CONFIDENCE = 0.95


def first_of(names: tuple[str, ...], rows: dict[str, Any]) -> str | None:
    """The first of ``names`` that has a row; else the first row; None without rows."""
    return next((name for name in (*names, *rows) if name in rows), None)


def interval(differences: list[float]) -> tuple[float, float | None]:
    """Mean, and the half width of its 95 % interval by Student's t, which one difference does not have."""
    n = len(differences)
    if n < 2:
        return float(np.mean(differences)), None
    error = float(np.std(differences, ddof=1)) / np.sqrt(n)
    return float(np.mean(differences)), float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2)) * error


def paired(rows: dict[str, Any], reference: str) -> dict[str, tuple[float, float | None]]:
    """Of each method: test PSNR minus that of the reference with the same seed, as ``interval``; of shared seeds."""
    found = {}
    for name, row in rows.items():
        seeds = [seed for seed in row["runs"] if seed in rows[reference]["runs"]]
        if name != reference and seeds:
            found[name] = interval([row["runs"][s]["psnr"] - rows[reference]["runs"][s]["psnr"] for s in seeds])
    return found


def seconds_to(folder: Path, level: float) -> float | None:
    """Run time at which a run was first measured at ``level`` dB or above with no more primitives than at its end.

    None if it never was.
    """
    run = read_run(folder)
    n = run.column("n")
    final = n[np.isfinite(n)][-1:]
    reached = np.flatnonzero((run.measured_column("psnr") >= level) & (n <= final)) if len(final) else []
    return float(run.column("seconds")[reached[0]]) if len(reached) else None


def table_of_pairs(folder: Path, rows: dict[str, Any]) -> dict[str, Any] | None:
    """Words of the reference and of the level, and a line per method; None where there is nothing to compare."""
    reference, model = first_of(REFERENCES, rows), first_of(LEVELS, rows)
    if reference is None or model is None or len(rows) < 2:
        return None
    level = rows[model]["summary"]["psnr"]["value"]
    differences, lines = paired(rows, reference), []
    for name, row in rows.items():
        times = [seconds_to(folder / f"seed_{seed}" / name, level) for seed in row["runs"]]
        known = [seconds for seconds in times if seconds is not None]
        shown = f"{np.median(known):,.0f}" if len(known) == len(times) else f"{len(known)} of {len(times)} runs"
        words = ("", "the reference") if name == reference else _words(differences.get(name))
        lines.append([row["label"], *words, shown if known else "never"])
    return {
        "reference": rows[reference]["label"],
        "level": f"{level:.2f} dB",
        "of": rows[model]["label"],
        "rows": lines,
    }


PARTS = {  # of the margin over the paper's recipe: what it changes of that
    "ours": "all of it",
    "paper_equal": "the paper's score and DoG with our window and step sizes",
    "ours_published": "our score and start of DoG by the paper's schedule",
}


def margin(rows: dict[str, Any]) -> str:
    """What parts of ours are above the paper's recipe, in words; empty where a part has no row."""
    if any(name not in rows for name in ("paper", *PARTS)):
        return ""
    gains = {name: rows[name]["summary"]["psnr"]["value"] - rows["paper"]["summary"]["psnr"]["value"] for name in PARTS}
    return ", ".join(f"{words} {gains[name]:+.2f} dB" for name, words in PARTS.items())


def _words(difference: tuple[float, float | None] | None) -> tuple[str, str]:
    """The difference with its interval, and what it says."""
    if difference is None:
        return "", "no seed in common"
    mean, half = difference
    if half is None:
        return f"{mean:+.2f}", "one seed: no interval"
    return f"{mean:+.2f} ± {half:.2f}", "a tie" if abs(mean) <= half else "better" if mean > 0 else "worse"
