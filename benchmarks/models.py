"""The splats that are timed, all 10,000 at 400 x 300 pixels: from freshly initialised to trained, and an object."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.initialize import splats_from_points
from mi_dogsplat.training.train import Trainer

DATA = Path(__file__).parents[1].parent / "shared" / "data"


def fern_points(copies: int = 1) -> tuple[Splats, Camera]:
    """The 10,091 sparse points of fern as training starts with them (opacity 0.1), with a view-dependent part.

    ``copies`` > 1: each point that many times, scattered and shrunk to the same coverage.
    """
    dataset = load_dataset(DATA / "fern", 2)
    splats = splats_from_points(dataset.points, dataset.point_colors, 3)
    rng = np.random.default_rng(0)
    splats = splats.select(np.tile(np.arange(splats.n_splats), copies))
    splats.sh_coeffs[:, 1:] = rng.normal(0, 0.05, (splats.n_splats, 15, 3))
    if copies > 1:
        splats.means += (rng.normal(size=(splats.n_splats, 3)) * splats.scales).astype(np.float32)
        splats.log_scales -= np.float32(np.log(copies) / 2)
    return splats, dataset.train[0].camera


def fern_opaque() -> tuple[Splats, Camera]:
    """The same with logit opacities from N(0, 1.5): half of them hide what is behind, so that rays end early."""
    splats, camera = fern_points()
    splats.logit_opacities[:] = np.random.default_rng(0).normal(0, 1.5, splats.n_splats)
    return splats, camera


def fern_trained(steps: int = 1500) -> tuple[Splats, Camera]:
    """A model of at most 10,000 primitives trained on fern, in half a minute."""
    config = TrainConfig(
        str(DATA / "fern"), "3dgs", steps, downscale=2, max_primitives=10_000, max_world_scale=float("inf")
    )
    dataset = load_dataset(config.data, config.downscale)
    trainer = Trainer(config, dataset)
    for _ in run_to_end(trainer):
        pass
    return trainer.optimizer.to_splats(), dataset.test[0].camera


def playbot() -> tuple[Splats, Camera]:
    """Every 12.5th primitive of a published object of 125,000, enlarged to the same coverage."""
    splats = read_ply(DATA / "models" / "playbot_lod2_sh2.ply")
    some = np.sort(np.random.default_rng(0).permutation(splats.n_splats)[:10_000])
    camera = automatic_camera(splats).resized(400, 300)
    chosen = splats.select(some)
    chosen.log_scales += np.float32(np.log(splats.n_splats / chosen.n_splats) / 2)
    return chosen, camera


CASES = {
    "fern, as initialised": fern_points,
    "fern, trained": fern_trained,
    "playbot": playbot,
    "fern, random opacities": fern_opaque,
    "fern x 10, as initialised": lambda: fern_points(10),
}
