"""A poisoned training recovers, and what is not finite is counted."""

import json
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.strategy.sieve import Sieve

from benchmarks.numerics import poison

PHASES = ("densification", "pruning", "DoG")


def assert_recovered(result: dict, within: float) -> None:
    assert [result[key] for key in ("spread", "bad_images", "bad_losses", "bad_moments")] == [0, 0, 0, 0]
    assert tuple(result["phases"]) == PHASES and len(result["events"]) == 3
    for (step, event), injected in zip(result["events"], result["phases"].values(), strict=True):
        assert injected < step <= injected + 10 and "broken primitives" in event
    assert result["injected"] == 3 * len(poison.POISONS) >= result["dropped"]
    # of the values that are not finite, those of a pseudo-Gaussian may go alone
    assert result["dropped"] >= 3 * sum(not p.finite and not p.name.startswith("dog") for p in poison.POISONS)
    assert result["psnr_poisoned"] > result["psnr_clean"] - within
    before = [psnr for step, psnr in result["poisoned"] if step <= result["phases"]["densification"]]
    if lanes_add_in_turn(mi.variant()):  # the same run but for the poison
        assert before == [psnr for _, psnr in result["clean"][: len(before)]]
    assert json.loads(json.dumps(result)) == result


@pytest.mark.slow
def test_a_poisoned_training_ends_within_half_a_decibel_of_a_clean_one():
    assert_recovered(poison.run(), within=0.5)


@pytest.mark.slow
def test_a_short_poisoned_training_without_control_of_dog_recovers_too():
    """120 steps of the recipe "released": each poison has 20 steps to heal."""
    assert_recovered(poison.run(120, "released"), within=3.0)


def test_poison_that_is_not_removed_is_counted(monkeypatch):
    trainer, harm = poison.poisoned(poison.config_of(30, "ours"), poison.data_set(4, 1), [3])
    monkeypatch.setattr(Sieve, "drop", lambda self, t: [])
    while trainer.step_count < 5:
        trainer.step()
    assert harm.spread == 0 and harm.not_finite_rows > 15
    trainer.optimizer.assign("quats", np.full((2, 4), np.nan), np.array([0, 1]))
    poison.look(trainer, harm)
    assert harm.spread == 2
    entry = Entry.of(trainer.optimizer.adam, "means")
    replace(entry, v=entry.v * dr.inf).put(trainer.optimizer.adam, "means")
    trainer.losses.loss_sum += dr.nan
    poison.look(trainer, harm)
    assert harm.bad_moments > 0 and harm.bad_losses == 1 and harm.bad_images == 0
