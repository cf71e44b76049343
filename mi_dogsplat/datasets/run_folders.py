"""Run folders that are taken for captures: their pictures are renders, not photographs."""

from __future__ import annotations

import os
from pathlib import Path

from ..support.errors import DataError
from ..support.run_files import are_of_run


def refuse_run(path: Path) -> None:
    """Raise ``DataError`` for a folder that is a run."""
    if path.is_dir() and are_of_run(os.listdir(path)):
        raise DataError(path, "is a run, and its pictures are renders", "give its data set; dogsplat info names it")
