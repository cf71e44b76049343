"""Weights of LPIPS with few features, drawn at random: the network's shape without its 59 MB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mi_dogsplat.measure.lpips import BLOCKS
from mi_dogsplat.support.arrays import write_arrays

FEATURES = (4, 5, 6, 6, 7)


def small_weights() -> dict[str, np.ndarray]:
    """By name, as ``mi_dogsplat.measure.lpips.Lpips`` wants them."""
    rng = np.random.default_rng(0)
    weights: dict[str, np.ndarray] = {}
    inputs, layer = 3, 0
    for block, (convolutions, outputs) in enumerate(zip(BLOCKS, FEATURES, strict=True)):
        for _ in range(convolutions):
            weights[f"kernel_{layer}"] = rng.normal(0, (2 / (9 * inputs)) ** 0.5, (outputs, inputs, 3, 3))
            weights[f"bias_{layer}"] = rng.normal(0, 0.1, outputs)
            inputs, layer = outputs, layer + 1
        weights[f"linear_{block}"] = rng.uniform(0, 0.5, outputs)
    return {name: values.astype(np.float32) for name, values in weights.items()}


def install(cache: Path) -> None:
    """Where ``weights_path`` looks if ``XDG_CACHE_HOME`` is ``cache``."""
    write_arrays(cache / "mi_dogsplat" / "lpips_vgg16.npz", small_weights())
