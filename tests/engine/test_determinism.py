"""A run repeats itself to the last bit, through densification, pruning and DoG."""

import numpy as np
import pytest
from happenings import records
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.train import Trainer


def assert_same_bits(state: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> None:
    assert state.keys() == expected.keys()
    for name in state.keys() - {"seconds"}:
        np.testing.assert_array_equal(state[name], expected[name], err_msg=name)


@pytest.mark.slow
@pytest.mark.usefixtures("ordered", "all_cores")
@pytest.mark.parametrize("preset", ["ours", "paper", "released"])
def test_the_same_seed_gives_the_same_bits(preset, data):
    config = TrainConfig(str(data), preset, steps=40, sh_degree=1, max_primitives=300, target=0.4, log_every=10)
    runs = []
    for _ in range(2):
        trainer = Trainer(config, load_dataset(data, 1))
        rows = [{k: v for k, v in row.items() if k != "seconds"} for row in run_to_end(trainer)]
        runs.append((rows, trainer.state()))
    (rows, state), (other_rows, other_state) = runs
    assert records(rows, "densified") and any("pruned_to" in row for row in rows)
    assert any(row["n_dog"] for row in rows)
    assert rows == other_rows
    assert_same_bits(state, other_state)


@pytest.mark.usefixtures("ordered")
def test_parameters_that_wait_for_their_sh_degree_train_as_if_adam_had_taken_them_along(data, monkeypatch):
    dataset = load_dataset(data)
    config = TrainConfig("", "3dgs", steps=60, sh_degree=1, max_primitives=300)
    waited, left_out = Trainer(config, dataset), []
    step = SplatOptimizer.step

    def all_of_it(self, unused=()):
        left_out.append(bool(unused))
        step(self)

    def train(trainer: Trainer) -> dict[str, np.ndarray]:
        for _ in range(20):
            trainer.step()
        return trainer.state()

    state = train(waited)
    monkeypatch.setattr(SplatOptimizer, "step", all_of_it)
    assert_same_bits(state, train(Trainer(config, dataset)))
    assert left_out == sorted(left_out, reverse=True) and 1 < sum(left_out) < 20  # the degree was raised on the way
    assert np.ptp(state["optimizer.sh_rest.m"]) > 0
