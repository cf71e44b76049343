"""A run repeats itself to the last bit, through densification, pruning and DoG."""

import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from mi_dogsplat.composite_derivatives import lanes_add_in_turn
from mi_dogsplat.config import TrainConfig
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.train import Trainer


@pytest.mark.parametrize("preset", ["ours", "paper", "released"])
def test_the_same_seed_gives_the_same_bits(preset, tmp_path):
    if not lanes_add_in_turn(mi.variant()):
        pytest.skip("this backend adds the gradients of a tile with atomics, in any order")
    data = str(tiny_data.write_tiny_data(tmp_path))
    config = TrainConfig(data, preset, steps=120, sh_degree=1, max_primitives=300, target=0.4, log_every=10)
    runs = []
    for _ in range(2):
        trainer = Trainer(config, load_dataset(data, 1))
        rows = [{k: v for k, v in row.items() if k != "seconds"} for row in trainer.rows()]
        runs.append((rows, {k: v for k, v in trainer.state().items() if k != "seconds"}))
    (rows, state), (other_rows, other_state) = runs
    assert any("densify" in row.get("event", "") for row in rows) and any("pruned_to" in row for row in rows)
    assert any(row["n_dog"] for row in rows)
    assert rows == other_rows
    assert state.keys() == other_state.keys()
    for name, values in state.items():
        np.testing.assert_array_equal(values, other_state[name], err_msg=name)
