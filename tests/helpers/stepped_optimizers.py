"""Optimizers as density control finds them: a model of known sizes, and moments that are not zero."""

import dataclasses

import drjit as dr
import numpy as np
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer

EXTENT = 2.0


def model_of(scales, opacities) -> Splats:
    rng, n = np.random.default_rng(0), len(scales)
    opacities = np.asarray(opacities, float)
    return Splats(
        rng.normal(size=(n, 3)),
        np.log(np.asarray(scales, float))[:, None] + np.array([0, -1, -2]),
        rng.normal(size=(n, 4)),
        np.log(opacities / (1 - opacities)),
        rng.normal(size=(n, 4, 3)),
    )


def optimizer_of(scales, opacities=None) -> SplatOptimizer:
    """An optimizer whose moments are not zero."""
    opacities = np.full(len(scales), 0.5) if opacities is None else opacities
    optimizer = SplatOptimizer(model_of(scales, opacities), LearningRates(EXTENT, 1000))
    for name in optimizer.adam:
        entry = Entry.of(optimizer.adam, name)
        m, v = (type(entry.m)(np.arange(1.0, dr.width(entry.m) + 1)) for _ in range(2))
        dataclasses.replace(entry, m=m, v=v).put(optimizer.adam, name)
    return optimizer
