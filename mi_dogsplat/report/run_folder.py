"""What a run folder holds, read leniently: an interrupted run can be looked at too."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..poses.config import SETTINGS as POSES
from ..scene.appearance import APPEARANCE, Appearance, read_appearance
from ..scene.drawing import value_of
from ..support.errors import DataError
from ..support.files import parse_json, read_object
from ..support.settings import unfit
from ..support.wording import finite
from ..training.config import TrainConfig

# Names in a run folder. Two more are beside what reads them: CHECKPOINT (runs/checkpoint.py), and APPEARANCE.
MODEL = "point_cloud.ply"
CONFIG = "config.json"
HISTORY = "history.jsonl"
METRICS = "metrics.json"
REPORT = "report.html"
RECIPE = "recipe.json"  # of a method in a comparison, or a recipe given in Python: its label, and its numbers
RENDER_MS = "render_ms.json"  # of a method in a comparison: its render time, measured in turns with the others'
REFINED = "refined"  # the data of the run with the poses that it has refined, a folder
POSED = "posed"  # the data of the run where it has found their poses first, a folder
FIRST = "first"  # the run of a small model by which masks were found, a folder
MASKS = "masks"  # the masks that were found by it, a folder
MASKED = "masked.png"  # what the masks of a run hide, to look at
DOG_PROFILE = "dog_profile.json"  # in test/: the comparison with and without DoG (runs/mixture.py)
MISFITS = "train/misfits.json"  # training images that do not fit (runs/misfits.py)

# Settings by which others draw the model of a run and find its data; the rest are only shown.
FOLLOWED = ("data", "preset", "split", "downscale", "data_on_disk", "background", "antialiased", "near_clip", "white")
FOLLOWED += ("up", "unit", "format", "preconditioned", "growth")
REMEDY = "restore or delete it, then try again"
LARGEST = 1e30  # what a run measures is far below
# Parts of the files that others rely on: objects with their own parts, under given names or any, and lists of numbers.
ANY, NUMBERS = "*", ("numbers",)
METRICS_PARTS: dict[str, Any] = {
    **{name: {} for name in ("test", "train", "versions", "masked", "depths")},
    **{name: {ANY: {}} for name in ("views", "poses")},
}
SIDE: dict[str, Any] = {"error": NUMBERS, "metrics": {}}
PROFILE_PARTS: dict[str, Any] = {"with_dog": SIDE, "without_dog": SIDE}
MISFIT_PARTS: dict[str, Any] = {"psnr": {}, "misfits": {ANY: {}}}


@dataclass
class Run:
    """The content of a run folder.

    ``config`` is empty and ``metrics`` None where the file is missing (metrics come when a run is complete);
    ``dog_profile`` is None unless the run compared pictures with and without DoG; ``broken_rows`` counts the
    lines of history.jsonl that are not JSON: a killed run leaves half a line.
    """

    path: Path
    config: dict[str, Any]
    history: list[dict[str, Any]]
    metrics: dict[str, Any] | None
    dog_profile: dict[str, Any] | None
    broken_rows: int
    recipe: dict[str, Any] | None = None  # of a method in a comparison, or one given in Python
    misfits: dict[str, Any] | None = None  # None where nothing was looked for
    appearance: Appearance | None = None  # of the photographs, where it was learned
    source: str | None = None  # the photographs or the video, where the run has found their poses first

    @property
    def data_name(self) -> str:
        """Name of the data set, of the photographs or video whose poses the run has found itself, or of the run folder
        where the configuration does not tell."""
        name = _last_part(self.config.get("data"))
        return (_last_part(self.source) if name == POSED else "") or name or self.path.resolve().name

    @property
    def data(self) -> Path | None:
        """The data set, with the poses that the run has refined if it has; None if it is not there.

        A relative name is one of the folder where the training was started: looked for here, and in the folders that
        the run is in.
        """
        own = self.config.get("data")
        if (self.path / REFINED / "transforms.json").is_file():
            return self.path / REFINED
        places = (Path(), *self.path.resolve().parents) if own else ()
        return next((place / str(own) for place in places if (place / str(own)).exists()), None)

    @property
    def data_missing(self) -> str:
        """What to say where the configuration names a data set that is not there; empty otherwise."""
        own = self.config.get("data")
        return f"the data of the run, {own}, are not there: --data names them" if own and self.data is None else ""

    @property
    def method(self) -> str:
        """The preset, or the method of a comparison, in words; empty where nothing tells."""
        preset = self.config.get("preset")
        return str((self.recipe or {}).get("label") or (f"preset {preset}" if preset else ""))

    @property
    def measured(self) -> str:
        """Which views were held out and measured: "test", or "validation"."""
        return str(self.config.get("split") or "test")

    def happened(self, row: int) -> list[dict[str, Any]]:
        """Records of what happened at a history row (``training/events.py``); none in rows that have only words."""
        records = self.history[row].get("events")
        return [record for record in records if isinstance(record, dict)] if isinstance(records, list) else []

    def rows_with(self, kind: str) -> list[int]:
        """History rows at which something of a kind happened."""
        return [i for i in range(len(self.history)) if any(r.get("kind") == kind for r in self.happened(i))]

    def column(self, key: str) -> NDArray[np.float64]:
        """One value of every history row, [rows]; NaN where a row has no finite number, or one that none measures."""
        values = (finite(row.get(key)) for row in self.history)
        return np.array([np.nan if v is None or abs(v) > LARGEST else v for v in values], np.float64)

    def measured_column(self, metric: str) -> NDArray[np.float64]:
        """Means of a metric, "psnr" or "flip", over the views that are measured, [rows]: at the last row, where
        ``test_every`` mostly has none, what the finished run has measured."""
        values, final = self.column(f"test_{metric}"), finite(((self.metrics or {}).get("test") or {}).get(metric))
        if final is not None and not np.isfinite(values[-1:]).any():
            values[-1:] = final
        return values


def read_run(path: str | Path) -> Run:
    """Reads config.json, history.jsonl, metrics.json and others of a run folder; each may be missing.

    Raises ``DataError`` where the folder does not exist, one of the .json files is not a JSON object, or something in
    it that others rely on is of another kind than what a run writes.
    """
    path = Path(path)
    if not path.is_dir():
        raise DataError(path, "no such folder", "give a run folder, as `dogsplat train DATA -o RUN` makes it")
    history, broken_rows = _read_rows(path / HISTORY)
    config, metrics = _read_config(path / CONFIG), _read_object(path / METRICS, METRICS_PARTS)
    profile, recipe = _read_object(path / "test" / DOG_PROFILE, PROFILE_PARTS), _read_object(path / RECIPE)
    misfits = _read_object(path / MISFITS, MISFIT_PARTS)
    stored = path / APPEARANCE
    appearance = read_appearance(stored) if stored.is_file() else None
    source = (_read_object(path / POSED / POSES) or {}).get("source")
    return Run(path, config, history, metrics, profile, broken_rows, recipe, misfits, appearance, source)


def _last_part(path: Any) -> str:
    """Of a path as any system writes it; empty where there is none."""
    return re.split(r"[/\\]", str(path or "").rstrip("/\\"))[-1]


def _read_config(path: Path) -> dict[str, Any]:
    """Settings of a run, of which those that are ``FOLLOWED`` may be relied on. Raises ``DataError``."""
    config = _read_object(path) or {}
    wrong = unfit(TrainConfig, {name: config[name] for name in FOLLOWED if name in config})
    up = config.get("up")
    if not wrong and up is not None and value_of("up", up) is None:
        wrong = "up"
    if wrong:
        raise DataError(path, f'"{wrong}" is not what a run writes', REMEDY)
    return config


def _read_object(path: Path, parts: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any] | None:
    """The object in a file, with ``parts`` of the right kinds; None without the file. Raises ``DataError``."""
    if not path.is_file():
        return None
    content = read_object(path, REMEDY)
    if wrong := _unfit_part(content, parts):
        raise DataError(path, f'"{wrong}" is not what a run writes', REMEDY)
    return content


def _unfit_part(content: Mapping[str, Any], parts: Mapping[str, Any]) -> str:
    """The first of the ``parts`` that is there and of another kind; empty if there is none."""
    for name, kind in parts.items():
        for key in content if name == ANY else [name] if name in content else []:
            value = content[key]
            if kind == NUMBERS:
                if not isinstance(value, list) or not value or any(finite(v) is None for v in value):
                    return key
            elif not isinstance(value, dict):
                return key
            elif inner := _unfit_part(value, kind):
                return f"{key}.{inner}"
    return ""


def _read_rows(path: Path) -> tuple[list[dict[str, Any]], int]:
    """Rows of a history, and how many of its lines are none."""
    rows: list[dict[str, Any]] = []
    broken = 0
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []:
        try:
            row = parse_json(line)
        except ValueError:
            row = None
        if isinstance(row, dict):
            rows.append(row)
        else:
            broken += 1
    return rows, broken
