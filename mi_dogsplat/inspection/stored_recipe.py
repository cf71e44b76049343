"""The numbers of the recipe of a run: as they are stored where it is no preset's, or those of its preset."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from ..report.run_folder import CONFIG, RECIPE, Run
from ..support.errors import DataError
from ..support.wording import finite
from ..training.given_rows import GIVEN
from ..training.presets import RECIPES
from ..training.recipe import Recipe

RULES = ("pruning", "dog", *GIVEN, "preconditioning")  # which a recipe may lack
REMEDY = "restore or delete it"


def recipe_of(run: Run, config: dict[str, Any]) -> dict[str, Any]:
    """Numbers of the recipe by name, those of a rule by its name; ``config``: of the run, defaults included.

    Raises ``DataError`` for a stored one that no run writes, or a preset that does not go with the rest.
    """
    if run.recipe is None or "recipe" not in run.recipe:
        return dataclasses.asdict(_recipe_of_preset(run.path, config))
    recipe = run.recipe["recipe"]
    if wrong := _unfit_part(recipe):
        raise DataError(run.path / RECIPE, f'"{wrong}" is not what a run writes', REMEDY)
    return recipe


def _unfit_part(recipe: Any) -> str:
    """Name of the first part that is missing or of another kind; empty if there is none."""
    if not isinstance(recipe, dict):
        return "recipe"
    for name, least in {"reference_steps": 1, "sh_every": 0, "first_step": 0}.items():
        number = finite(recipe.get(name))
        if number is None or number < least:
            return name
    rules = {"densification": ("start", "stop")} | {name: ("start",) for name in RULES if recipe.get(name) is not None}
    for name, numbers in rules.items():
        rule = recipe.get(name)
        if not isinstance(rule, dict) or any(finite(rule.get(number)) is None for number in numbers):
            return name
    return ""


def _recipe_of_preset(path: Path, config: dict[str, Any]) -> Recipe:
    if config["preset"] not in RECIPES:
        problem = f'its preset "{config["preset"]}" is unknown'
        raise DataError(path / CONFIG, problem, "use the version of dogsplat that made it")
    try:
        recipe = RECIPES[config["preset"]].as_set(config["preconditioned"], config["format"], config["growth"])
    except ValueError as error:
        raise DataError(path / CONFIG, f"does not fit together ({error})", REMEDY) from None
    return recipe if config["model"] is None else recipe.from_pruning()
