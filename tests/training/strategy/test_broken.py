"""Primitives that training cannot repair: who they are, what removing them costs, and that no file ever holds one."""

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mi_dogsplat.runs.run
import numpy as np
import pytest
import tiny_data
from happenings import history_of
from launches import KernelWatch
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.runs.checkpoint import load_checkpoint
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.broken import MAX_COLOR, MAX_RADIANCE, MAX_SCALE, broken, drop_broken
from mi_dogsplat.training.strategy.strategy import Strategy, Training
from mi_dogsplat.training.train import Trainer
from small_optimizer import random_model

EXTENT, N = 2.0, 7
MAX_SH = MAX_COLOR / C0
NAMES = ("means", "log_scales", "quats", "logit_opacities", "sh_dc", "sh_rest", "dog_logit_opacities", "dog_log_scales")


def optimizer_of(dog_index=(0, 2, 5)) -> SplatOptimizer:
    return SplatOptimizer(random_model(N, 1, dog_index), LearningRates(EXTENT, 1000))


def put(optimizer: SplatOptimizer, name: str, row: int, column: int, value: float) -> None:
    values = optimizer.numpy(name)
    values.reshape(len(values), -1)[row, column] = value
    optimizer.assign(name, values)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("column", [0, -1])
def test_a_primitive_with_a_value_that_is_not_finite_is_broken_and_no_other(name, value, column):
    optimizer = optimizer_of()
    assert not broken(optimizer, EXTENT).any()
    put(optimizer, name, 2, column, value)  # row 2 of the DoG arrays is primitive 5
    assert np.flatnonzero(broken(optimizer, EXTENT)).tolist() == [5 if name.startswith("dog") else 2]


@pytest.mark.parametrize(
    ("name", "limit"),
    [("log_scales", np.log(MAX_SCALE * EXTENT)), ("sh_dc", MAX_SH), ("sh_dc", -MAX_SH), ("sh_rest", MAX_SH)],
)
def test_what_no_gradient_brings_back_is_broken(name, limit):
    for value, expected in ((0.999 * limit, False), (1.001 * limit, True)):
        optimizer = optimizer_of()
        put(optimizer, name, 3, 1, value)
        assert broken(optimizer, EXTENT)[3] == expected


def test_a_lamp_in_linear_images_is_not_broken_up_to_what_no_light_is():
    """The loss of display-referred images clamps at white, that through a curve does not."""
    limit = MAX_RADIANCE / C0
    for value, expected in ((10 * MAX_SH, False), (0.999 * limit, False), (1.001 * limit, True)):
        optimizer = SplatOptimizer(optimizer_of().to_splats(), LearningRates(EXTENT, 1000), SrgbLog())
        put(optimizer, "sh_dc", 3, 1, value)
        assert broken(optimizer, EXTENT)[3] == expected


def test_small_far_and_saturated_values_are_not_broken():
    optimizer = optimizer_of()
    for name, value in {"log_scales": -1e3, "means": 1e6, "logit_opacities": 1e4, "quats": 1e30}.items():
        put(optimizer, name, 1, 0, value)
    assert not broken(optimizer, EXTENT).any()


def test_broken_rows_go_with_their_moments_and_the_others_stay_as_they_are():
    optimizer = optimizer_of()
    for name in optimizer.adam:
        entry = Entry.of(optimizer.adam, name)
        m, v = (type(entry.m)(np.arange(1.0, dr.width(entry.m) + 1)) for _ in range(2))
        replace(entry, m=m, v=v).put(optimizer.adam, name)
    before, m = optimizer.to_splats(), optimizer.state()["means.m"].reshape(-1, 3)
    put(optimizer, "means", 1, 0, np.nan)
    put(optimizer, "dog_log_scales", 1, 0, np.inf)  # of primitive 2
    kept = drop_broken(optimizer, EXTENT)
    assert kept.tolist() == [0, 3, 4, 5, 6]
    after, expected = optimizer.to_splats(), before.select(kept)
    for field in Splats.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(after, field), getattr(expected, field))
    np.testing.assert_array_equal(optimizer.state()["means.m"].reshape(-1, 3), m[kept])


def test_a_model_of_broken_primitives_has_diverged():
    optimizer = optimizer_of()
    optimizer.assign("means", np.full((N, 3), np.nan))
    with pytest.raises(FloatingPointError, match="diverged"):
        drop_broken(optimizer, EXTENT)


def test_looking_launches_one_kernel_and_compiles_none_as_the_count_changes():
    optimizer = optimizer_of()
    with KernelWatch() as kernels:
        drop_broken(optimizer, EXTENT)
        optimizer.rearrange(np.arange(6), np.zeros(6, bool))
        kernels.forget()
        broken(optimizer, 2 * EXTENT)
    assert kernels.launched == 1 and not kernels.new


# --- in a run ---


def config_of(data, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "3dgs", "steps": 60, "sh_degree": 1, "max_primitives": 100, "log_every": 10}
    return TrainConfig(str(data), **{**base, **changes})


@dataclass(frozen=True)
class Poisoned(Strategy[None]):
    """Five primitives become NaN after 55 steps, when densification is long over."""

    def before_step(self, t: Training, state: None) -> None:
        if t.step_count == 55:
            t.optimizer.assign("means", np.full((2, 3), np.nan), np.array([0, 3]))
            t.optimizer.assign("quats", np.full((3, 4), np.inf), np.array([5, 6, 7]))


POISONED = replace(RECIPES["3dgs"], also=(Poisoned(),))


def test_no_file_holds_a_broken_primitive_and_the_history_tells_how_many_there_were(data, tmp_path):
    metrics = mi_dogsplat.runs.run.train(config_of(data), tmp_path, recipe=POISONED)
    rows = history_of(tmp_path)
    assert rows[-1]["event"] == "dropped 5 broken primitives" and rows[-1]["n"] == rows[-2]["n"] - 5
    assert np.isfinite(rows[-1]["l1"]) and metrics["train"]["psnr"] > 15
    state = load_checkpoint(tmp_path / "checkpoint" / "state.npz")
    assert all(np.isfinite(values).all() for values in state.values() if values.dtype.kind == "f")
    assert len(state["densification.views"]) == rows[-1]["n"] >= read_ply(tmp_path / "point_cloud.ply").n_splats > 0


def test_a_state_that_is_taken_at_any_time_is_finite(data):
    trainer = Trainer(config_of(data), load_dataset(data), POISONED)
    while trainer.step_count < 56:
        trainer.step()
    n = trainer.optimizer.n
    state = trainer.state()
    assert all(np.isfinite(values).all() for values in state.values() if values.dtype.kind == "f")
    assert trainer.optimizer.n == n - 5 == len(state["densification.views"])


def test_a_run_without_a_usable_primitive_is_a_data_error_that_names_the_step(data, tmp_path):
    @dataclass(frozen=True)
    class Diverged(Strategy[None]):
        def before_step(self, t: Training, state: None) -> None:
            t.optimizer.assign("means", np.full((t.optimizer.n, 3), np.nan))

    recipe = replace(RECIPES["3dgs"], also=(Diverged(),))
    with pytest.raises(DataError, match=rf"{data.name}.*: step 1: no primitive has usable values"):
        mi_dogsplat.runs.run.train(config_of(data, log_every=1), tmp_path / "run", recipe=recipe)


def test_a_model_to_prune_loses_its_broken_primitives_before_it_is_measured(data, tmp_path):
    splats = tiny_data.truth()
    splats.sh_coeffs[3, 0], splats.log_scales[8], splats.sh_coeffs[20, 2, 1] = 1e8, np.log(1e6), -1e8
    write_ply(tmp_path / "model.ply", splats)
    config = config_of(data, preset="paper", model=str(tmp_path / "model.ply"), target=20, max_primitives=None)
    trainer = Trainer(config, load_dataset(data))
    rows = list(run_to_end(trainer))
    assert rows[0]["step"] == 0 and rows[0]["event"].startswith("dropped 3 broken primitives; prune 57 -> ")
    assert rows[0]["train_l1"] < 0.03 and rows[-1]["n"] == 20
    assert trainer.test_errors()["test_psnr"] > 20
