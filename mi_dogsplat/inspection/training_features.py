"""The part of ``dogsplat info --features`` on training: what a run needed, and what a data set will."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from ..formats.read import read_model
from ..report.run_folder import MODEL, read_run
from ..support.wording import counted
from ..training.config import TrainConfig
from ..training.given_rows import GIVEN
from .dataset import SCENE_SPP
from .features import FLOAT, LEFT_OUT, NEEDED, Feature, feature, model_features
from .stored_recipe import recipe_of

BEHIND = "per pixel of the image 3 operations, and the adjoint of T"
STATE = 3 * FLOAT  # bytes beside a parameter in training: its gradient and two moments


def dataset_features(path: Path) -> list[Feature]:
    """What training on a data set will need, whatever the recipe."""
    from ..datasets import load_largest  # here: it needs the extra "train"

    dataset, _ = load_largest(path, SCENE_SPP)
    sizes = {(view.camera.width, view.camera.height) for view in dataset.views}
    points, alpha, tests = len(dataset.points), dataset.has_alpha, len(dataset.test)
    masks = "laid over the background once, as the images are read: nothing per step"
    white, black = f"white, for images with alpha; {BEHIND}", "black, unless --background white asks for it"
    compiled = f"{len(sizes)}; the passes are recorded for each, not compiled"
    return [
        feature("alpha masks", alpha, masks, "the images have no alpha"),
        feature("background", alpha, white, black),
        feature("several image sizes", len(sizes) > 1, compiled, "all images have one size"),
        feature("random start", not points, "the data has no points", f"the data has {counted(points, 'point')}"),
        feature("test renders", tests > 0, f"{counted(tests, 'view')} held out", "no view is held out"),
    ]


def run_features(path: Path) -> list[Feature]:
    """What the model of a run folder needs, and what its training needed."""
    run = read_run(path)
    defaults = {field.name: field.default for field in dataclasses.fields(TrainConfig)}
    config: dict[str, Any] = defaults | run.config
    model = path / MODEL
    features = model_features([read_model(model).splats]) if model.is_file() else []
    return features + _recipe_features(recipe_of(run, config), config) + _image_features(config)


def _recipe_features(recipe: dict[str, Any], config: dict[str, Any]) -> list[Feature]:
    def part(steps: int) -> str:
        return f"{steps / recipe['reference_steps']:.0%} of the run"

    density, every = recipe["densification"], recipe["sh_every"]
    features = [Feature("optimizer", NEEDED, f"a gradient and two moments, {STATE} bytes beside each parameter")]
    gradients = f"gradients of the centres, {2 * FLOAT} bytes per primitive, left out after"
    centres = f"to {part(density['stop'])}: {gradients}; their sums, {3 * FLOAT} bytes, stay"
    dense = density["stop"] > density["start"]
    features.append(feature("densification", dense, centres, "training started from a model"))
    rules = {"pruning": recipe["pruning"], "training DoG": recipe["dog"]}
    rules |= {f"training {rows.replace('_', ' ')}": recipe.get(rows) for rows in GIVEN}  # which earlier versions lack
    begins = {name: f"from {part(rule['start'])}" for name, rule in rules.items() if rule}
    if jointly := recipe.get("preconditioning"):  # by the steps of the whole schedule
        begins["preconditioned steps"] = f"from {part(jointly['start'] - recipe['first_step'])}"
    elif config["preconditioned"]:  # of a method in a comparison, whose recipe is stored without the setting
        begins["preconditioned steps"] = "from the end of pruning"
    for name in (*rules, "preconditioned steps"):
        start = f"{begins.get(name)} on, left out before"
        features.append(feature(name, name in begins, start, "not in the recipe"))
    in_turn = f"one more every {part(every)}; those still to come are stored and updated all the same"
    raised = bool(config["sh_degree"] and every)
    return [*features, feature("SH degree in turn", raised, in_turn, "one degree all along")]


def _image_features(config: dict[str, Any]) -> list[Feature]:
    grey = config["background"]
    state = {"black": LEFT_OUT, "white": NEEDED}.get(grey, "needed for images with alpha")
    antialiased = bool(config["antialiased"])
    return [
        Feature("background", state, grey if state == LEFT_OUT else f"{grey}; {BEHIND}"),
        feature("antialiasing", antialiased, "antialiased is true", "antialiased is false"),
    ]
