"""Recipes that are no preset's, in the folders of their runs: what such a run goes on with, and whose it is."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..report.run_folder import RECIPE
from ..support.errors import DataError
from ..support.files import json_text
from ..training.presets import Recipe

LABEL = "a recipe of its own"
PRESETS = "the recipe of its preset"


def described(recipe: Recipe) -> dict[str, Any]:
    """What ``recipe.json`` holds of a recipe that was given in Python: its numbers, and the classes of its parts."""
    return json.loads(json_text({"label": LABEL, "recipe": json.loads(json.dumps(recipe, default=_plain))}))


def require_same_recipe(out: Path, before: Mapping[str, Any] | None, now: Mapping[str, Any] | None) -> None:
    """Raise ``DataError`` where a run is to go on with another recipe than it began with; None: that of its preset.

    Methods of a comparison are told by their labels: it compares their numbers itself, across versions too.
    """
    began, goes_on = (None if it is None else it.get("label") for it in (before, now))
    if began != goes_on:
        problem = f"was trained by {began or PRESETS} and is to go on with {goes_on or PRESETS}"
    elif began == LABEL and before != now:
        problem = f"was trained by another recipe than this one, that of its {RECIPE}"
    else:
        return
    raise DataError(out, problem, "resume with the recipe of the run (in Python recipe=), or name another folder")


def _plain(value: Any) -> Any:
    """A part of a recipe as JSON; what has no numbers to show is its class."""
    name = type(value).__qualname__
    if not dataclasses.is_dataclass(value):
        return name
    return {"class": name} | {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
