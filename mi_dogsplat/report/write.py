"""One self-contained page about a run: what came out, how training went, where the pictures differ.

`write_report` shows what a run folder holds (config.json, history.jsonl, metrics.json, test/) and says in
words what it does not hold.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..scene.kinds import COUNTED, kinds
from ..support.files import replacing
from ..support.wording import count, file_size, finite, fixed
from .appearance import appearance_plots, corner_losses
from .curves import curves
from .depth_maps import told_of_depth_maps
from .masked import masked
from .misfits import misfits
from .mixture import mixture
from .moved import moved
from .page import TEMPLATES
from .prunes import compares, prunes, refinements
from .run_folder import REPORT, Run, read_run
from .views import shares, sheet, shown, views


def write_report(run_dir: str | Path, metrics: dict[str, Any] | None = None) -> Path:
    """Writes ``report.html`` into a run folder and returns its path.

    Args:
        metrics: what the run has measured and is yet to write; None: what its folder holds.

    Raises ``DataError`` where the folder does not exist, or one of its .json files is not a JSON object.
    """
    run = read_run(run_dir)
    run = run if metrics is None else replace(run, metrics=metrics)
    path = run.path / REPORT
    with replacing(path) as part:
        part.write_text(report_page(run), encoding="utf-8")
    return path


def report_page(run: Run) -> str:
    """The HTML of a report. Where a run is not complete its last row tells what its metrics do not."""
    metrics, last = run.metrics or {}, run.history[-1] if run.history else {}
    found = views(run)
    return TEMPLATES.get_template("report/templates/report.html").render(
        title=" \u00b7 ".join(filter(None, (run.data_name, run.method))),
        run=run,
        last=last,
        test=metrics.get("test") or {},
        train=metrics.get("train") or {},
        n=metrics.get("n", last.get("n")),
        kinds=kinds({name: metrics.get(name, last.get(name)) for name in COUNTED}),
        size=file_size(metrics.get("bytes")).split(" "),
        seconds=metrics.get("train_seconds", last.get("seconds")),
        steps=metrics.get("steps", last.get("step")),
        others=_others(run, metrics),
        curves=curves(run),
        prunes=prunes(run),
        compares=compares(run),
        refinements=refinements(run),
        misfits=misfits(run),
        masked=masked(run),
        depth_maps=told_of_depth_maps(metrics),
        mixture=mixture(run),
        appearance=appearance_plots(run.appearance),
        corners=corner_losses(run.appearance),
        moved=moved(run),
        views=found,
        shares=shares(found),
        sheets=[sheet(view, run.path / "test") for view in shown(found)],
        settings=_flat(run.config),
    )


def _others(run: Run, metrics: dict[str, Any]) -> dict[str, Any]:
    """Facts about the run by name; those that are not known are left out."""
    render_ms, memory = (finite(metrics.get(name)) for name in ("render_ms", "peak_memory_mb"))
    test_l1 = finite((metrics.get("test") or {}).get("l1"))
    halves = finite((metrics.get("test") or {}).get("half_psnr"))
    facts = {
        "seed": metrics.get("seed", run.config.get("seed")),
        "variant": metrics.get("variant", run.config.get("variant")),
        f"{run.measured} L1": None if test_l1 is None else fixed(test_l1, 4),
        f"{run.measured} half_psnr": None if halves is None else f"{fixed(halves, 2)} dB",
        "render": None if render_ms is None else f"{render_ms:.1f} ms per view",
        "peak memory": None if memory is None else f"{count(memory)} MB",
        **(metrics.get("versions") or {}),
    }
    return {name: value for name, value in facts.items() if value is not None}


def _flat(config: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows = []
    for key, value in config.items():
        if isinstance(value, dict) and value:
            rows += _flat(value, f"{prefix}{key}.")
        else:
            rows.append((f"{prefix}{key}", value if isinstance(value, str) else json.dumps(value)))
    return rows
