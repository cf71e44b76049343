"""What the folder of a data set keeps of a comparison: the settings and views of all its runs.

What a broken disk or an editor has damaged is told in one line.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from ..report.run_folder import CONFIG
from ..support.errors import DataError
from ..support.files import is_empty, read_object, write_json
from ..training.config import FREE, TrainConfig

VIEWS = "views.json"  # in the folder of a data set: the names of those that are trained on and measured
REMEDY = "restore or delete it, then compare again"  # of a file in a run folder: what is missing is made anew


def settings_in(folder: Path) -> dict[str, Any]:
    """What all runs on a data set share. Raises ``DataError``."""
    return read_object(folder / CONFIG, "restore it, or name another folder")


def claim(out: Path, config: TrainConfig) -> None:
    """Make the folder one of runs on a data set, all with these settings. Raises ``DataError`` for anything else.

    While it holds nothing but starts that are complete, which know of no target, that may be another one.
    """
    settings = {k: v for k, v in dataclasses.asdict(config).items() if k not in ("preset", "seed", *FREE)}
    path = out / CONFIG
    earlier = {field.name: field.default for field in dataclasses.fields(TrainConfig) if field.name in settings}
    known = earlier | settings_in(out) if path.exists() else settings
    if known != settings and not (known | {"target": settings["target"]} == settings and _has_starts_alone(out)):
        name = next(name for name in settings | known if known.get(name) != settings.get(name))
        problem = f"holds runs with other settings: {name} was {known.get(name)} and is {settings.get(name)} now"
        raise DataError(out, problem, "name another folder")
    if not path.exists() and out.is_dir() and not is_empty(out):
        raise DataError(out, "is a folder with other contents", "name a new folder, or that of an earlier call")
    out.mkdir(parents=True, exist_ok=True)
    write_json(path, settings)


def claim_views(out: Path, names: dict[str, list[str]]) -> None:
    """Keep the ``names`` of the views that runs in the folder are on. Raises ``DataError`` if they were others before:
    no table is of both."""
    path = out / VIEWS
    if path.exists() and read_object(path, REMEDY) != names:
        problem = "holds runs on other views: since then images were added or removed, or the split has changed"
        raise DataError(out, problem, "name another folder")
    write_json(path, names)


def _has_starts_alone(out: Path) -> bool:
    """Whether no run in the folder of a data set has begun, and no start has begun and is not complete."""
    folders = [path for path in out.glob("seed_*/*/") if path.is_dir()]
    return all(path.name == "start" and path.with_suffix(".npz").exists() for path in folders)
