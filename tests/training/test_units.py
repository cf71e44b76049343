"""Training does not depend on the unit of length of a data set: metres or millimetres, whatever a tool came up with."""

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.measure.evaluate import evaluate_views, mean_metrics
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

from benchmarks.training.scene_scale import in_units

STEPS = 60


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Dataset:
    return load_dataset(tiny_data.write_tiny_data(tmp_path_factory.mktemp("units") / "data"))


def trained(dataset: Dataset, scale: float, **settings) -> tuple[Trainer, float]:
    """A training in other units, and its PSNR in dB."""
    config = TrainConfig("", preset="3dgs", steps=STEPS, sh_degree=1, max_primitives=80, **settings)
    trainer = Trainer(config, in_units(dataset, scale))
    for _ in range(STEPS):
        trainer.step()
    views = evaluate_views(trainer.picture, trainer.dataset.test, trainer.background)
    return trainer, mean_metrics(views)["psnr"]


@pytest.mark.slow
def test_a_world_of_other_units_is_learnt_as_well(dataset):
    """Within the spread of seeds, as densification amplifies rounding."""
    seeds = [trained(dataset, 1.0, seed=seed)[1] for seed in range(3)]
    for scale in (1e3, 1e-3):
        trainer, psnr = trained(dataset, scale)
        assert abs(psnr - np.mean(seeds)) < max(0.5, np.ptp(seeds)), (scale, psnr, seeds)
        size = np.median(np.linalg.norm(trainer.optimizer.to_splats().means, axis=1))
        assert size == pytest.approx(scale * np.median(np.linalg.norm(tiny_data.truth().means, axis=1)), rel=0.2)


def test_the_near_clip_is_in_proportion_where_units_are_small(dataset):
    """A fixed one would hide a world of a millimetre from all of its cameras."""
    clips = {scale: trained(dataset, scale)[0].near_clip for scale in (1.0, 1e-3)}
    assert clips[1.0] == 0.2 and 1e-4 < clips[1e-3] < 3e-4
    trainer, _ = trained(dataset, 1.0, near_clip=0.3)
    assert trainer.near_clip == trainer.config.near_clip == 0.3
