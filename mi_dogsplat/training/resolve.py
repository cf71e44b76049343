"""What the settings of a run, its recipe and its data set decide together, before the first step."""

from __future__ import annotations

from dataclasses import replace

from ..datasets import Dataset
from ..scene.drawing import DrawnAs
from ..scene.row_groups import BESIDE_COLORS
from ..scene.splats import Splats
from ..support.errors import DataError
from .config import TrainConfig
from .later_rows import later_rows
from .memory_budget import Budget, budget
from .presets import RECIPES, Recipe
from .strategy.pose_refinement import PoseRefinement

NEAR_SHARE = 1 / 16  # of the camera extent: the near clip of captures in small units


def exposed(config: TrainConfig, dataset: Dataset) -> Dataset:
    """The images with the white of the settings. Raises ``DataError`` for settings that are for others."""
    if config.white is not None and dataset.white is None:
        raise DataError("--white", "is for linear images", "leave it out, or train on OpenEXR images")
    if config.appearance and dataset.white is not None:
        raise DataError("--appearance", "is for photographs, not for linear images", "leave it out")
    return dataset if config.white is None else dataset.exposed(config.white)


def recipe_of_run(config: TrainConfig, recipe: Recipe | None) -> Recipe:
    """The recipe of a run, that of the preset if None is given, with the bounds of the settings, scaled to its steps.

    Raises ``ValueError`` for one that does not go with the format of the file, or with a model to prune.
    """
    recipe = recipe or RECIPES[config.preset]
    recipe = (recipe.preconditioned() if config.preconditioned else recipe).for_format(config.format)
    bounds = {"max_primitives": config.max_primitives, "max_world_scale": config.max_world_scale}
    density = replace(recipe.densification, **bounds, batch_views=config.batch_views)
    also = (*recipe.also, PoseRefinement()) if config.refine_poses else recipe.also
    recipe = replace(recipe, densification=density, also=also)
    return (recipe if config.model is None else recipe.from_pruning()).scaled(config.steps)


def near_clip_of(config: TrainConfig, extent: float) -> float:
    """World units; ``extent`` is that of the cameras."""
    return min(DrawnAs().near_clip, NEAR_SHARE * extent) if config.near_clip is None else config.near_clip


def memory_of(config: TrainConfig, dataset: Dataset, recipe: Recipe, splats: Splats) -> Budget | None:
    """The budget of a run that starts with ``splats``. Raises ``DataError`` where these do not fit into it."""
    held = [group for group in BESIDE_COLORS if len(getattr(splats, group.index))]
    later = later_rows(config, recipe, held, splats.n_splats)
    masked = config.masks is not None
    memory = budget(config.memory, dataset, splats.sh_degree, config.data_on_disk, held, masked, later)
    if memory:
        memory.require(config.data, splats.n_splats)
    return memory
