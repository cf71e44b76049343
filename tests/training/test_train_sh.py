"""A training in which primitives get SH degrees of their own."""

from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.scene.ply import read_ply, write_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer


def trainer(data, **settings) -> Trainer:
    quiet: dict[str, Any] = {"steps": 600, "log_every": 900, "test_every": 900, "variant": mi.variant()}
    config = TrainConfig(str(data), **{"preset": "3dgs", "sh_degree": 3, **quiet, **settings})
    return Trainer(config, load_dataset(data))


def train(t: Trainer, steps: int) -> None:
    for _ in range(steps):
        t.step()


def assert_same(a: Splats, b: Splats):
    for name in Splats.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.fixture
def mixed(data) -> Trainer:
    """One that has just been given degrees, with all of them in use."""
    t = trainer(data)
    t.step_count = 62
    train(t, 3)
    t.optimizer.set_sh_degrees(np.arange(t.optimizer.n) % 4)
    assert t.active_sh_degree == 3
    return t


def test_a_training_goes_on_with_degrees_of_single_primitives(mixed):
    before, first = mixed.optimizer.to_splats(), mixed.training_l1()
    train(mixed, 40)  # densification is among them
    after = mixed.optimizer.to_splats()
    assert after.mixed_sh and after.n_splats != before.n_splats
    assert mixed.training_l1() < first
    assert np.abs(after.sh3_coeffs).max() > 0 and np.abs(after.sh1_coeffs).max() > 0


def test_degrees_come_in_one_after_the_other(data):
    t = trainer(data)
    t.optimizer.set_sh_degrees(np.arange(t.optimizer.n) % 4)
    assert t.active_sh_degree == 0
    train(t, 2)
    model = t.optimizer.to_splats()
    assert not any(getattr(model, f"sh{degree}_coeffs").any() for degree in (1, 2, 3))
    t.step_count = 20
    assert t.active_sh_degree == 1
    train(t, 2)
    model = t.optimizer.to_splats()
    assert all(getattr(model, f"sh{degree}_coeffs")[:, :3].any() for degree in (1, 2, 3))
    assert not any(getattr(model, f"sh{degree}_coeffs")[:, 3:].any() for degree in (2, 3))


def test_a_resumed_training_has_the_same_bits(data, mixed, ordered):
    state = mixed.state()
    resumed = trainer(data)
    resumed.restore(state)
    for t in (mixed, resumed):
        train(t, 5)
    assert_same(resumed.optimizer.to_splats(), mixed.optimizer.to_splats())
    assert all(np.array_equal(a, b) for a, b in zip(resumed.state().values(), mixed.state().values(), strict=True))


def test_a_mixed_model_can_be_trained_on(data, mixed, tmp_path):
    write_ply(tmp_path / "model.ply", mixed.optimizer.to_splats(), "rows")
    again = trainer(data, model=str(tmp_path / "model.ply"), preset="ours", target=10)
    assert again.optimizer.sh_degrees.tolist() == read_ply(tmp_path / "model.ply").sh_degrees.tolist()
    train(again, 3)
    assert again.optimizer.to_splats().mixed_sh
