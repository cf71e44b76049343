"""The splats that are timed: the sparse points of a real capture as primitives, SH degree 3, opacities of all kinds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mi_dogsplat.cameras import Camera
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.initialize import splats_from_points
from mi_dogsplat.splats import Splats

DATA = Path(__file__).parents[1].parent / "shared" / "data"


def fern(copies: int = 1) -> tuple[Splats, Camera]:
    """10,091 primitives (times ``copies``, scattered and shrunk to the same coverage) and a camera of 400 x 300."""
    dataset = load_dataset(DATA / "fern", 2)
    splats = splats_from_points(dataset.points, dataset.point_colors, 3)
    rng = np.random.default_rng(0)
    splats = splats.select(np.tile(np.arange(splats.n_splats), copies))
    n = splats.n_splats
    splats.logit_opacities[:] = rng.normal(0, 1.5, n)
    splats.sh_coeffs[:, 1:] = rng.normal(0, 0.05, (n, 15, 3))
    if copies > 1:
        splats.means += (rng.normal(size=(n, 3)) * splats.scales).astype(np.float32)
        splats.log_scales -= np.float32(np.log(copies) / 2)
    return splats, dataset.train[0].camera
