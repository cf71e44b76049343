"""Who goes in a prune, when one is made, and what the history tells about it."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.scores.score import ScoreRule
from mi_dogsplat.training.events import row_of
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.prune import Pruning, keep_best
from mi_dogsplat.training.strategy.scheduler import Progress, PruningRule
from mi_dogsplat.training.strategy.strategy import arrays_of, restore_fields
from small_optimizer import translucent_model

RULE = PruningRule(start=10, stop=50, check_every=10, max_interval=20, rounds=3)


def optimizer_of(n: int) -> SplatOptimizer:
    """Each row has moments of its own."""
    optimizer = SplatOptimizer(translucent_model(n), LearningRates(1.0, 100))
    state = optimizer.state()
    for name in [name for name in state if name.endswith((".m", ".v"))]:
        state[name] = np.arange(1.0, len(state[name]) + 1)
    optimizer.restore(state)
    return optimizer


# --- who goes ---


def test_the_best_are_kept_in_their_order_with_values_and_moments():
    optimizer = optimizer_of(6)
    before, state = optimizer.to_splats(), optimizer.state()
    keep_best(optimizer, np.array([3.0, 0.1, 9.0, 0.2, 4.0, 0.0]), 3)
    after, kept = optimizer.to_splats(), [0, 2, 4]
    np.testing.assert_array_equal(after.means, before.means[kept])
    for moment in ("m", "v"):
        rows = state[f"means.{moment}"].reshape(-1, 3)[kept]
        np.testing.assert_array_equal(optimizer.state()[f"means.{moment}"].reshape(-1, 3), rows)


def test_what_has_no_score_goes_first_and_of_equals_the_one_further_back():
    optimizer = optimizer_of(6)
    before = optimizer.to_splats()
    keep_best(optimizer, np.array([np.nan, 0.0, 1.0, 0.0, np.nan, 0.0]), 3)
    np.testing.assert_array_equal(optimizer.to_splats().means, before.means[[1, 2, 3]])


def test_scores_of_another_model_are_refused():
    with pytest.raises(ValueError, match="5 scores for 6 primitives"):
        keep_best(optimizer_of(6), np.zeros(5), 3)


# --- what the history tells ---


def checked(
    target: float, state: Progress, optimizer: SplatOptimizer, l1: dict[int, float], steps: range
) -> dict[int, dict]:
    """Rows of the history by step, without their records; the score is the row's number."""
    rows, pruning = {}, Pruning(RULE, ScoreRule("opacity"))
    for step in steps:
        training: Any = SimpleNamespace(
            step_count=step, optimizer=optimizer, target=target, training_l1=lambda step=step: l1[step],
            scores=lambda score: np.arange(float(optimizer.n)),
        )  # fmt: skip
        if events := pruning.after_step(training, state):
            rows[step] = {name: value for name, value in row_of(events).items() if name != "events"}
    return rows


def test_every_check_is_a_row_with_its_reason_and_a_prune_also_tells_from_what_to_what():
    optimizer = optimizer_of(100)
    last = optimizer.to_splats().means[-10:]
    l1 = {10: 0.02, 20: 0.0213, 30: 0.0215, 40: 0.019}
    rows = checked(0.1, Progress(), optimizer, l1, range(60))
    assert rows == {
        10: {"event": "prune 100 -> 55: first check", "train_l1": 0.02, "pruned_from": 100, "pruned_to": 55},
        20: {"event": "refine: L1 0.0213 > 0.95 x 0.02", "train_l1": 0.0213},
        30: {
            "event": "prune 55 -> 33: forced by 20 steps since the last prune, L1 0.0215 > 0.95 x 0.02",
            "train_l1": 0.0215,
            "pruned_from": 55,
            "pruned_to": 33,
        },
        40: {
            "event": "prune 33 -> 10: L1 0.019 <= 0.95 x 0.0215, round 3 meets the target",
            "train_l1": 0.019,
            "pruned_from": 33,
            "pruned_to": 10,
        },
    }
    np.testing.assert_array_equal(optimizer.to_splats().means, last)


@pytest.mark.parametrize(("n", "target"), [(10, 10), (10, 400), (4, 0.1)])
def test_a_model_that_is_not_above_its_target_is_left_alone_and_the_history_says_so_once(n, target):
    optimizer, state = optimizer_of(n), Progress()
    rows = checked(target, state, optimizer, {}, range(60))
    assert list(rows) == [10] and list(rows[10]) == ["event"] and optimizer.n == n
    assert re.match(r"no pruning: the target .*\b(not below the 10|of 4 primitives leaves none)", rows[10]["event"])
    again = Progress()
    restore_fields(again, arrays_of(state))
    assert again == state and not checked(target, again, optimizer, {}, range(60))


def test_a_restored_window_goes_on_where_it_was():
    l1 = {10: 0.02, 20: 0.0213, 30: 0.0215, 40: 0.03, 50: 0.03}
    whole = checked(0.1, Progress(), optimizer_of(100), l1, range(60))
    for cut in (5, 15, 25, 35, 45):
        state, again, optimizer = Progress(), Progress(), optimizer_of(100)
        head = checked(0.1, state, optimizer, l1, range(cut))
        restore_fields(again, arrays_of(state))
        assert head | checked(0.1, again, optimizer, l1, range(cut, 60)) == whole
