"""Files of a comparison that are read again: what a broken disk or an editor has damaged is told in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..report.run_folder import CONFIG
from ..support.files import read_object

VIEWS = "views.json"  # in the folder of a data set: the names of those that are trained on and measured
REMEDY = "restore or delete it, then compare again"  # of a file in a run folder: what is missing is made anew


def settings_in(folder: Path) -> dict[str, Any]:
    """What all runs on a data set share. Raises ``DataError``."""
    return read_object(folder / CONFIG, "restore it, or name another folder")
