"""Incremental structure from motion (Schönberger and Frahm 2016): poses, points and lenses from verified matches."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..support.cores import usable_cores
from .config import PosesConfig

FEWEST_IMAGES = 3  # of a model: COLMAP's 10 would refuse small captures
PART = "mapping"  # models while they grow


def reconstruct(
    pycolmap: Any, database: Path, folder: Path, n: int, config: PosesConfig, progress: Callable[[int, int], None]
) -> list[Any]:
    """Models of what the matches connect, the one with most images first; none if no pair gives a start.

    ``n`` images, or panoramas with their views, are in the database. Interrupted, it begins anew: nothing of a model is
    kept before it is whole.
    """
    part = database.with_name(PART)
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    options = pycolmap.IncrementalPipelineOptions(num_threads=usable_cores(), random_seed=config.seed)
    options.min_model_size = min(FEWEST_IMAGES, n)
    options.mapper.random_seed = options.triangulation.random_seed = config.seed
    options.mapper.num_threads = options.num_threads
    if config.panoramas:  # where the views of a panorama look, and how wide they are, is known
        options.ba_refine_focal_length = options.ba_refine_extra_params = options.ba_refine_sensor_from_rig = False
        options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = False
    registered = 0

    def started() -> None:
        nonlocal registered
        registered = 2
        progress(registered, n)

    def another() -> None:
        nonlocal registered
        registered = min(registered + 1, n)
        progress(registered, n)

    pycolmap.set_random_seed(config.seed)
    try:
        models = pycolmap.incremental_mapping(
            str(database), str(folder), str(part), options,
            initial_image_pair_callback=started, next_image_callback=another,
        )  # fmt: skip
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return sorted(models.values(), key=lambda model: (-model.num_reg_images(), -model.num_points3D()))
