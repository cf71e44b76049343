"""The curves of a report: error, test PSNR and number of primitives, against run time and against step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..support.wording import time_unit
from ..training import events
from .plot import Lane, Series, line_plot
from .prunes import marks, with_drops
from .run_folder import Run
from .smoothing import running_mean

LANES_OF_ROWS = {"slopes": "slopes", "curvatures": "slopes", "cuts": "cuts", "second_cuts": "cuts", "shifts": "shifts"}
ROW_EVENTS = events.ROWS_ACTIVATED, events.ROWS_LEFT_OUT
EVENT_LANES = {  # the lane of an event by its kind
    events.Densified.kind: "densify",
    events.Pruned.kind: "prune",
    events.Refined.kind: "refine",
    events.OpacityReset.kind: "reset",
    events.ShDegree.kind: "SH up",
    events.DogActivated.kind: "DoG",
    **{of_kind[rows].kind: lane for rows, lane in LANES_OF_ROWS.items() for of_kind in ROW_EVENTS},
}


@dataclass
class Curves:
    """Plots of a run, two of each or none: against run time, and against step."""

    error: list[Markup] = field(default_factory=list)
    psnr: list[Markup] = field(default_factory=list)
    count: list[Markup] = field(default_factory=list)


def curves(run: Run) -> Curves:
    """What the history holds, drawn."""
    plots = Curves()
    l1, n, n_dog, train_l1 = (run.column(k) for k in ("l1", "n", "n_dog", "train_l1"))
    logged = np.nan_to_num(l1) > 0
    abscissas = [(label, x) for label, x in _abscissas(run) if np.isfinite(x[logged]).any()]
    if not abscissas:
        return plots
    test_psnr = run.measured_column("psnr")
    smooth, rows = running_mean(l1)
    psnr = f"{run.measured} PSNR, dB"
    for label, x in abscissas:
        if rows > 1:
            errors = [Series("per row", x, l1, "faint"), Series(f"mean of {rows} rows", x, smooth)]
        else:
            errors = [Series("per row", x, l1)]
        if (np.nan_to_num(train_l1) > 0).any():
            errors.append(Series("at a check", x, train_l1, "points", color=2))
        lines = marks(run, x)
        plots.error.append(line_plot(errors, label, "training L1", log_y=True, marks=lines))
        if np.count_nonzero(np.isfinite(test_psnr + x)) > 1:
            plots.psnr.append(line_plot([Series(run.measured, x, test_psnr, "points")], label, psnr, marks=lines))
        if np.isfinite(n + x).any():
            dog = [Series("DoG", x, n_dog, color=2)] if np.nansum(n_dog) > 0 else []
            counts = [Series("all", *with_drops(run, x, n)), *dog]
            plots.count.append(
                line_plot(counts, label, "primitives", from_zero=True, lanes=event_lanes(run, x), marks=lines)
            )
    return plots


def _abscissas(run: Run) -> list[tuple[str, NDArray[np.floating]]]:
    seconds = run.column("seconds")
    longest = float(np.max(np.nan_to_num(seconds), initial=0))
    unit, scale = time_unit(longest)
    return [(f"run time, {unit}", seconds / scale), ("step", run.column("step"))]


def event_lanes(run: Run, x: NDArray[np.floating]) -> list[Lane]:
    """One lane for every kind of event that occurs; ``x`` [rows] is where each history row stands."""
    places: dict[str, list[float]] = {name: [] for name in [*EVENT_LANES.values(), "other"]}
    for i, place in enumerate(x.tolist()):
        if run.history[i].get("event") and np.isfinite(place):
            kinds = [str(record.get("kind")) for record in run.happened(i)] or ["other"]
            for name in dict.fromkeys(EVENT_LANES.get(kind, "other") for kind in kinds):
                places[name].append(place)
    return [Lane(name, np.array(found)) for name, found in places.items() if found]
