"""What the settings of a run, its recipe and its data set decide together, before the first step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..datasets import Dataset
from ..datasets.dataset import camera_extent
from ..formats.model import Model
from ..scene.drawing import DrawnAs
from ..scene.finite import finite_rows
from ..scene.row_groups import BESIDE_COLORS, DOG, RowGroup
from ..scene.splats import Splats
from ..support.errors import DataError
from .config import TrainConfig
from .depth_start import with_depth_points
from .initialize import initial_splats
from .memory_budget import Budget, Later, budget
from .optimizer.preconditioning import n_products
from .presets import RECIPES
from .recipe import Recipe
from .strategy.pose_refinement import PoseRefinement
from .strategy.sieve import Sieve

NEAR_SHARE = 1 / 16  # of the camera extent: the near clip of captures in small units


@dataclass(frozen=True)
class Start:
    """What a run begins with: its data set and settings as they decide each other, and the primitives.

    ``extent`` is that of the cameras, and ``near_clip`` that of the settings, world units; ``memory`` is None where
    nobody knows how much there is.
    """

    dataset: Dataset
    config: TrainConfig
    recipe: Recipe
    extent: float
    near_clip: float
    splats: Splats
    sieve: Sieve
    memory: Budget | None


def start_of(
    config: TrainConfig, dataset: Dataset, recipe: Recipe | None = None, model: Model | None = None
) -> Start:
    """The start of a run by the settings, or by a ``recipe`` in place of their preset's; photographs are read where
    the points are those of depth maps.

    ``model`` is the ``model_to_prune`` of the settings, where that has been read. Raises ``DataError`` for settings
    that are not for these data, and for primitives that do not fit into the memory or are all in the near zone.
    """
    dataset = exposed(config, dataset)
    recipe = recipe_of_run(config, recipe)
    extent = camera_extent(dataset.train)
    near_clip = near_clip_of(config, extent)
    config = replace(config, near_clip=near_clip, white=dataset.white)
    dataset = with_depth_points(config, dataset)
    splats = initial_splats(config, dataset, recipe.start_limit(config.target) or config.max_primitives, model)
    sieve = Sieve(config.near_zone)
    means = splats.means[finite_rows(splats.means)]  # of a model that is to be pruned some may be broken
    if sieve.near_zone and len(means):
        sieve.near(means, np.array([view.camera.position for view in dataset.train]))
    memory = memory_of(config, dataset, recipe, splats)
    return Start(dataset, config, recipe, extent, near_clip, splats, sieve, memory)


def exposed(config: TrainConfig, dataset: Dataset) -> Dataset:
    """The images with the white of the settings. Raises ``DataError`` for settings that are for others."""
    require_same_light(config, dataset.white is not None)
    return dataset if config.white is None else dataset.exposed(config.white)


def require_same_light(config: TrainConfig, linear: bool) -> None:
    """Raise ``DataError`` for settings that are for linear images where these are not, and the other way round."""
    if config.white is not None and not linear:
        raise DataError("--white", "is for linear images", "leave it out, or train on OpenEXR images")
    if config.appearance and linear:
        raise DataError("--appearance", "is for photographs, not for linear images", "leave it out")


def recipe_of_run(config: TrainConfig, recipe: Recipe | None) -> Recipe:
    """The recipe of a run, that of the preset if None is given, with the bounds of the settings, scaled to its steps.

    Raises ``ValueError`` for one that does not go with the format of the file, or with a model to prune.
    """
    recipe = (recipe or RECIPES[config.preset]).as_set(config.preconditioned, config.format, config.growth)
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
    memory = budget(
        config.memory, dataset, splats.sh_degree, on_disk=config.data_on_disk, groups=held,
        masked=config.masks is not None, with_depths=config.depths is not None,
        later=_later_rows(config, recipe, held, splats.n_splats),
    )  # fmt: skip
    if memory:
        fewer = "a smaller model" if config.model else "fewer --max-primitives, a smaller --sh-degree"
        memory.require(config.data, splats.n_splats, fewer)
    return memory


def _later_rows(config: TrainConfig, recipe: Recipe, held: list[RowGroup], n: int) -> Later:
    """What primitives get when the pruning is over, beside rows ``held`` from the start by ``n`` primitives.

    How many are left by then is known of a ratio, and of a count where a model or a cap says of how many.
    """
    given = [group for group in ([DOG] if recipe.dog else []) + [*recipe.given_groups] if group not in held]
    left = 1.0
    if recipe.pruning:
        target = 0.0 if config.target_bytes else float(config.target)
        most = n if config.model else config.max_primitives
        left = target if target < 1 else min(1.0, target / most) if most else 0.0
    return Later(given, n_products([*held, *given]) if recipe.preconditioning else 0, left)
