"""A training step pays for nothing that its options leave out."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from changed_strategy import change_densification
from launches import kernels
from lean_calls import forget_recordings
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.geometry import Blocks, Grid
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.images.photographs import Photographs
from mi_dogsplat.training.train import Trainer
from splat_scenes import kernels as compiled

pytestmark = pytest.mark.usefixtures("fresh_recordings")


@pytest.fixture(scope="module")
def datasets(data, alpha_data):
    return [load_dataset(folder) for folder in (data, alpha_data)]


def trainer_of(dataset, **settings) -> Trainer:
    """One that is between two rows of its history."""
    quiet: dict[str, Any] = {"steps": 1000, "log_every": 900, "test_every": 900, "variant": mi.variant()}
    config = TrainConfig(str(dataset.path), **{"preset": "3dgs", "sh_degree": 0, **quiet, **settings})
    trainer = Trainer(config, dataset)
    assert not any(trainer.step() for _ in range(3))
    return trainer


def step(trainer: Trainer) -> list[tuple[int, int]]:
    """Kernels of a training step, but for those that have a lane per isect, whose number changes."""
    forget_recordings()
    n, blocks = trainer.optimizer.n, Blocks.of_backend()
    pixels = tiny_data.WIDTH * tiny_data.HEIGHT
    lanes = Grid(tiny_data.WIDTH, tiny_data.HEIGHT, blocks).n_tiles * blocks.lanes_per_tile
    known = {1, n, 3 * n, 4 * n, 48 * n, pixels, lanes}
    return [(size, operations) for size, operations in kernels(trainer.step) if size in known]


def test_a_black_background_costs_what_no_background_costs(datasets, monkeypatch):
    black, white = step(trainer_of(datasets[0], background="black")), step(trainer_of(datasets[0], background="white"))
    assert len(black) == len(white) and sum(k for _, k in black) < sum(k for _, k in white)

    def without(self, params, camera, probe=None, depth=False):
        frame = rasterize(params, camera, self.options, probe)
        return frame.colors, frame

    monkeypatch.setattr(Trainer, "_render", without)
    assert step(trainer_of(datasets[0], background="black")) == black


@pytest.mark.parametrize("background", ["black", "white"])
def test_alpha_masks_cost_nothing_per_step(datasets, background):
    assert datasets[1].has_alpha and not datasets[0].has_alpha
    assert step(trainer_of(datasets[0], background=background)) == step(trainer_of(datasets[1], background=background))


def test_pruning_and_dog_cost_nothing_before_they_start(datasets):
    assert step(trainer_of(datasets[0], preset="ours")) == step(trainer_of(datasets[0], preset="3dgs"))


def test_sh_degree_0_trains_without_the_other_coefficients(datasets):
    least, most = trainer_of(datasets[0]), trainer_of(datasets[0], sh_degree=3)
    assert sum(dr.width(values) for values in least.optimizer.adam.values()) == 14 * least.optimizer.n
    before = step(least)
    assert step(most) == before  # as long as degree 0 is all that is rendered
    most.step_count = 999  # the last one, where all degrees are
    assert most.active_sh_degree == 3
    assert sum(k for _, k in step(most)) > sum(k for _, k in before)


def test_a_mixed_model_trains_without_the_coefficients_that_its_primitives_do_not_have(datasets):
    least, most, mixed = trainer_of(datasets[0]), *(trainer_of(datasets[0], sh_degree=3) for _ in range(2))
    n = mixed.optimizer.n
    mixed.optimizer.set_sh_degrees(np.arange(n) % 2)
    assert sum(dr.width(values) for values in mixed.optimizer.adam.values()) == 14 * n + 12 * (n // 2)
    assert step(mixed) == step(least)  # as long as degree 0 is all that is rendered
    for trainer in (mixed, most):
        trainer.step_count = 999
    assert mixed.active_sh_degree == 1
    cost = {name: sum(size * k for size, k in kernels(trainer.step))
            for name, trainer in (("least", least), ("mixed", mixed), ("most", most))}
    assert cost["least"] < cost["mixed"] < cost["most"]


def test_gradients_of_the_centres_are_taken_only_while_there_is_densification(datasets):
    during, after = trainer_of(datasets[0]), trainer_of(datasets[0])
    change_densification(after, stop=0)
    assert sum(k for _, k in step(after)) < sum(k for _, k in step(during))


def test_masks_appearance_and_random_backgrounds_cost_nothing_when_they_are_off(datasets, monkeypatch):
    off, targets = step(trainer_of(datasets[1])), []

    def bare(self, planes, view, step, upcoming=()):
        if not targets:  # in a step before those that are counted
            targets.extend(self.loss.target(self.as_seen(shown.image)) for shown in self.views)
        l1, _, loss, gradient = self.loss.value_and_gradient(planes, targets[view])
        return l1, loss, gradient

    with monkeypatch.context() as patched:
        patched.setattr(Photographs, "compare", bare)
        patched.setattr(Photographs, "choose_background", lambda self, rng: None)
        assert step(trainer_of(datasets[1])) == off
    for on in ({"appearance": True}, {"background": "random"}):
        assert sum(k for _, k in step(trainer_of(datasets[1], **on))) > sum(k for _, k in off)


def test_options_about_images_compile_nothing_from_step_to_step(datasets, tmp_path):
    for view in datasets[1].train:
        write_png(tmp_path / f"{view.name}.png", np.eye(tiny_data.HEIGHT, tiny_data.WIDTH))
    options: dict[str, Any] = {"appearance": True, "background": "random", "masks": str(tmp_path), "near_zone": 0.1}
    trainer = trainer_of(datasets[1], **options)
    change_densification(trainer, stop=0)
    known = [compiled(trainer.step) for _ in range(10)]
    assert known[-1] <= set().union(*known[:5]) and known[-2] <= set().union(*known[:5])
