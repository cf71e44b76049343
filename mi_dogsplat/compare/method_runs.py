"""The runs of a comparison: the densified start of a seed, a method from there on, and the renders of all in turns."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..datasets import Dataset
from ..datasets.dataset import View
from ..datasets.masks import Masks
from ..formats.read import read_model
from ..measure.evaluate import render_milliseconds_in_turn
from ..render.picture import Picture, background_color, picture_of
from ..report.run_folder import CONFIG, DOG_PROFILE, METRICS, MODEL, RECIPE, RENDER_MS
from ..report.write import write_report
from ..runs.checkpoint import CHECKPOINT
from ..runs.mixture import write_comparison
from ..runs.run import train, train_until
from ..scene.drawing import Drawing, drawn_as
from ..support.files import read_object, write_json
from ..training.config import TrainConfig
from ..training.optimizer.learning_rates import Refinement
from ..training.presets import RECIPES
from ..training.recipe import Recipe
from .folders import REMEDY
from .methods import METHODS, WITHOUT_DOG, Method


def densified_start(config: TrainConfig, path: Path) -> None:
    """Train up to the end of densification, and save the state.

    Cut off, it goes on from the checkpoint in the run folder beside ``path``, which keeps the history.
    """
    folder = path.with_suffix("")
    step = min(RECIPES[config.preset].scaled(config.steps).densification.stop, config.steps)
    os.replace(train_until(config, folder, step, resume=(folder / CHECKPOINT).exists()), path)


def recipe_of(method: Method, masked: bool = False) -> dict:
    """What the run folder of a method keeps, as JSON gives it back: its label and the numbers of its recipe.

    ``masked``: the run is on photographs with masks.
    """
    revised = {"revision": method.revision} if method.revision > 1 else {}
    if masked and method.masked_revision > 1:
        revised["masked_revision"] = method.masked_revision
    return {"label": method.label, "recipe": json.loads(json.dumps(dataclasses.asdict(method.recipe)))} | revised


def is_complete(folder: Path, method: Method) -> bool:
    """Whether a folder holds a finished run of this method."""
    if not (folder / METRICS).exists():
        return False
    config = folder / CONFIG
    masked = config.exists() and read_object(config, REMEDY).get("masks") is not None
    return _recipe_in(folder) == recipe_of(method, masked)


def _recipe_in(folder: Path) -> Any:
    """As ``recipe_of`` has it; what an earlier version did not write down was as a recipe has it by default."""
    path = folder / RECIPE
    known = read_object(path, REMEDY) if path.exists() else None
    if known and isinstance(known.get("recipe"), dict):
        recipe = json.loads(json.dumps(dataclasses.asdict(Recipe()))) | known["recipe"]
        if isinstance(recipe["score"], dict):
            recipe["score"].pop("curve", None)  # which no recipe has set, and a score of an earlier version had
        if recipe["refinement"]:
            recipe["refinement"].setdefault("growth_gain", Refinement.growth_gain)
        known["recipe"] = recipe
    return known


def train_method(config: TrainConfig, name: str, folder: Path, start: Path) -> None:
    """Fill a run folder; a run of the same recipe that was cut off goes on from its checkpoint.

    Args:
        config: its preset is not used.
        name: in ``METHODS``.
        start: checkpoint at the end of densification.
    """
    method = METHODS[name]
    config = replace(config, preset=name if name in RECIPES else "paper")  # the nearest; recipe.json has the numbers
    config = replace(config, steps=round(config.steps * method.length))
    stopped, recipe = (folder / CHECKPOINT).exists(), recipe_of(method, config.masks is not None)
    resume = stopped and _recipe_in(folder) == recipe
    if stopped and not resume:
        (folder / CHECKPOINT).unlink()  # of another recipe
    begin = start if method.from_the_start else None
    train(config, folder, resume=resume, recipe=method.recipe, start=begin, method=recipe)


def draw_in_turn(dataset: Dataset, config: TrainConfig, folders: Sequence[Path]) -> None:
    """Time the renders of all models of a seed in turns, and compare pictures with and without DoG."""
    background = background_color(config.background, dataset.has_alpha)
    masks = Masks(config.masks, dataset.views) if config.masks else None
    drawings = {folder.name: _drawing(folder, config, background) for folder in folders}
    times = render_milliseconds_in_turn(drawings, dataset.test)
    for folder in folders:
        write_json(folder / RENDER_MS, {"render_ms": times[folder.name], "in_turn_with": sorted(drawings)})
        if WITHOUT_DOG.get(folder.name) in drawings:
            _compare_without_dog(dataset, folder, drawings, background, masks)


def _drawing(folder: Path, config: TrainConfig, background: float) -> Callable[[View], Picture]:
    """Renders views of the model in a run folder."""
    model = read_model(folder / MODEL)
    drawn = drawn_as(Drawing(config.antialiased, config.near_clip), model.drawing)
    picture = picture_of(model.splats, background, drawn)
    return lambda view: picture(view.camera)


def _compare_without_dog(
    dataset: Dataset,
    folder: Path,
    drawings: Mapping[str, Callable[[View], Picture]],
    background: float,
    masks: Masks | None,
) -> None:
    """In the report of a run, the model trained without DoG takes the place of its own, switched off."""
    profile, name = folder / "test" / DOG_PROFILE, WITHOUT_DOG[folder.name]
    if profile.exists():  # else no primitive is DoG any more
        shown = read_object(profile, REMEDY)["view"]
        view = next(view for view in dataset.test if view.name == shown)
        words = f'the model trained without it, "{METHODS[name].label}"'
        mask = masks.of(view) if masks else None
        write_comparison(drawings[folder.name], drawings[name], view, background, profile.parent, words, mask)
        write_report(folder)
