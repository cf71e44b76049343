"""What tests of rivals share."""

from dataclasses import replace

import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer


@pytest.fixture(scope="module")
def trainer_of(data):
    """Makes a trainer by a recipe, on tiny data, with a target of 90 primitives."""
    config = TrainConfig(str(data), preset="3dgs", steps=60, sh_degree=1, target=90, log_every=10, test_every=10)

    def make(recipe=None, steps=60, **settings):
        return Trainer(replace(config, steps=steps, **settings), load_dataset(config.data, 1), recipe)

    return make
