"""Run folders that are taken for captures: their pictures are renders, not photographs."""

from __future__ import annotations

import os
from pathlib import Path

from ..support.errors import DataError


def are_of_run(files: list[str]) -> bool:
    """Whether these are the files of a run, which has settings and a history."""
    return "config.json" in files and any(file.endswith(".jsonl") for file in files)


def refuse_run(path: Path) -> None:
    """Raise ``DataError`` for a folder that is a run."""
    if path.is_dir() and are_of_run(os.listdir(path)):
        raise DataError(path, "is a run, whose pictures are renders", "give its data set; dogsplat info names it")
