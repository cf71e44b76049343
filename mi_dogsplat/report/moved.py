"""How far the refined poses of the training views are from those of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ..support.wording import finite
from .plot import Series, line_plot
from .run_folder import Run

LISTED = 8  # views that moved most


@dataclass(frozen=True)
class MovedView:
    """A training view: ``shift`` in percent of the extent of the cameras, ``turn`` in degrees."""

    name: str
    shift: float
    turn: float


@dataclass(frozen=True)
class Moved:
    """Plots of all views, and the views that moved ``most``."""

    plots: Sequence[Markup]
    most: Sequence[MovedView]


def moved(run: Run) -> Moved | None:
    """What metrics.json says of the poses; None where none were refined."""
    views = []
    for name, motion in ((run.metrics or {}).get("poses") or {}).items():
        shift, turn = finite(motion.get("shift")), finite(motion.get("turn"))
        if shift is not None and turn is not None:
            views.append(MovedView(name, 100 * shift, turn))
    if not views:
        return None
    views.sort(key=lambda view: -view.shift)
    rank = np.arange(1.0, len(views) + 1)
    plots = []
    for label, values in (("shift, %", [v.shift for v in views]), ("turn, degrees", [v.turn for v in views])):
        far = np.array(sorted(values, reverse=True))
        plots.append(line_plot([Series(label, rank, far, "points")], "training view", label, from_zero=True))
    return Moved(plots, views[:LISTED])
