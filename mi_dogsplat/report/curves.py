"""The curves of a report: error, test PSNR and number of primitives, against run time and against step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.wording import finite
from ..training.events import Densified, DogActivated, OpacityReset, Pruned, Refined, ShDegree
from .plot import Lane, Series, line_plot
from .prunes import marks, prune_table, with_drops
from .run_folder import Run

EVENT_LANES = {  # the lane of an event by its kind
    Densified.kind: "densify",
    Pruned.kind: "prune",
    Refined.kind: "refine",
    OpacityReset.kind: "reset",
    ShDegree.kind: "SH up",
    DogActivated.kind: "DoG",
}

READ_ERROR = """Mean error of the training views since the row before (thin) and its running mean (thick), on a
logarithmic axis: lower is better; while it still falls at the right end, more steps would help. Dots, where there
are any: mean over the whole training set, measured to decide on pruning. Methods are compared by error against run
time, not against step."""
READ_PSNR = """Mean PSNR over the test views, higher is better. Where it falls while the training error falls
too, the model learns the training views by heart."""
READ_COUNT = """Number of primitives. The marks below the curve show when something happened to them: densify
adds, prune removes, refine is a check that did not prune, reset lowers all opacities (the error jumps and
recovers), SH up adds a degree of view-dependent colour, DoG changes the Difference-of-Gaussians primitives."""

SMOOTHED_FROM = 40  # rows; below, every row is visible by itself


def curves_section(run: Run) -> str:
    """Three pairs of plots, as HTML; what the history does not hold is left out, an empty one named."""
    head = "<h2>How training went</h2>"
    l1, n, n_dog, test_psnr, train_l1 = (run.column(k) for k in ("l1", "n", "n_dog", "test_psnr", "train_l1"))
    logged = np.nan_to_num(l1) > 0
    abscissas = [(label, x) for label, x in _abscissas(run) if np.isfinite(x[logged]).any()]
    if not abscissas:
        return f"{head}<p>There are no curves: history.jsonl is missing or holds no logged step.</p>"
    final = finite(((run.metrics or {}).get("test") or {}).get("psnr"))
    if final is not None and not np.isfinite(test_psnr[-1]):
        test_psnr[-1] = final
    smooth, rows = running_mean(l1)
    error_plots, psnr_plots, count_plots = [], [], []
    for label, x in abscissas:
        if rows > 1:
            errors = [Series("per row", x, l1, "faint"), Series(f"mean of {rows} rows", x, smooth)]
        else:
            errors = [Series("per row", x, l1)]
        if (np.nan_to_num(train_l1) > 0).any():
            errors.append(Series("at a check", x, train_l1, "points", color=2))
        lines = marks(run, x)
        error_plots.append(line_plot(errors, label, "training L1", log_y=True, marks=lines))
        if np.count_nonzero(np.isfinite(test_psnr + x)) > 1:
            psnr_plots.append(line_plot([Series("test", x, test_psnr, "points")], label, "test PSNR, dB", marks=lines))
        if np.isfinite(n + x).any():
            dog = [Series("DoG", x, n_dog, color=2)] if np.nansum(n_dog) > 0 else []
            counts = [Series("all", *with_drops(run, x, n)), *dog]
            count_plots.append(
                line_plot(counts, label, "primitives", from_zero=True, lanes=event_lanes(run, x), marks=lines)
            )
    blocks = [(error_plots, READ_ERROR), (psnr_plots, READ_PSNR), (count_plots, READ_COUNT)]
    figures = "".join(
        f"<div class=plots>{''.join(plots)}</div><p class=read>{words}</p>" for plots, words in blocks if plots
    )
    return head + figures + prune_table(run)


def _abscissas(run: Run) -> list[tuple[str, NDArray[np.float64]]]:
    seconds = run.column("seconds")
    longest = float(np.max(np.nan_to_num(seconds), initial=0))
    unit, scale = ("s", 1) if longest < 180 else ("min", 60) if longest < 3 * 3600 else ("h", 3600)
    return [(f"run time, {unit}", seconds / scale), ("step", run.column("step"))]


def running_mean(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """Centred mean over about 1/40 of the rows, gaps left out; and the number of rows it spans (1: none)."""
    rows = max(3, len(values) // 40 | 1) if len(values) >= SMOOTHED_FROM else 1
    present = np.isfinite(values)
    window = np.ones(rows)
    total = np.convolve(np.where(present, values, 0), window, "same")
    return total / np.maximum(np.convolve(present, window, "same"), 1), rows


def event_lanes(run: Run, x: NDArray[np.float64]) -> list[Lane]:
    """One lane for every kind of event that occurs; ``x`` [rows] is where each history row stands."""
    places: dict[str, list[float]] = {name: [] for name in [*EVENT_LANES.values(), "other"]}
    for i, place in enumerate(x.tolist()):
        if run.history[i].get("event") and np.isfinite(place):
            kinds = [str(record.get("kind")) for record in run.happened(i)] or ["other"]
            for name in dict.fromkeys(EVENT_LANES.get(kind, "other") for kind in kinds):
                places[name].append(place)
    return [Lane(name, np.array(found)) for name, found in places.items() if found]
