"""What rivals share in a training: they end with the budget, within the memory, and go on with the same bits."""

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.rivals import dash, taming
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.training.memory_budget import Budget
from mi_dogsplat.training.train import Trainer

MEMORY = 110  # primitives, of the 120 of the data that have a budget of 200


@pytest.mark.parametrize("recipe", [taming.RECIPE, dash.RECIPE])
def test_growth_ends_densification_with_exactly_the_budget(trainer_of, recipe):
    trainer = trainer_of(recipe)
    assert trainer.optimizer.n == 45
    rows = list(run_to_end(trainer))
    counts = [row["n"] for row in rows]
    assert max(counts) == counts[-1] == 90 and rows[-1]["step"] == 60
    assert rows[-1]["test_psnr"] > 18
    photographs = trainer.photographs
    assert photographs.factor == 1 and photographs.cameras[0].width == trainer.dataset.train[0].camera.width


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mask_gaussian", "lp_3dgs", "gaussian_spa"])
def test_a_method_that_learns_more_goes_on_from_a_checkpoint_with_the_same_bits(trainer_of, name):
    """The one that goes on from it is stopped within the window in which its numbers are learned."""

    def trainer() -> Trainer:
        return trainer_of(METHODS[name].recipe, 120, target=20)

    first, second = trainer(), trainer()
    while first.step_count < 79:
        first.step()
    state = first.state()
    assert any(key.startswith("optimizer.") for key in state.keys() - trainer_of().state().keys())
    second.restore(state)
    for one in (first, second):
        while one.step_count < 120:
            one.step()
    if lanes_add_in_turn(mi.variant()):
        a, b = first.state(), second.state()
        assert a.keys() == b.keys() and all(np.array_equal(a[key], b[key]) for key in a if key != "seconds")


@pytest.mark.parametrize("name", ["taming", "dash", "mcmc", "improved_gs", "3dgs_capped"])
def test_growth_ends_where_the_memory_does(trainer_of, monkeypatch, name):
    monkeypatch.setattr(Budget, "most_primitives", lambda self, pairs: MEMORY)
    trainer = trainer_of(METHODS[name].recipe, 60, target=200, memory="8G", initial_primitives=50)
    most = max(row["n"] for row in run_to_end(trainer))
    assert trainer.n_start < most <= max(MEMORY, trainer.n_start)


@pytest.mark.parametrize("name", ["improved_gs", "mcmc", "3dgs_capped", "gns", "taming_equal", "dash_equal"])
def test_what_grows_to_the_budget_ends_there_and_can_see(trainer_of, name):
    trainer = trainer_of(METHODS[name].recipe, 240, test_every=80)
    rows = list(run_to_end(trainer))
    assert rows[-1]["n"] == 90 or (name == "3dgs_capped" and rows[-1]["n"] <= 90)
    assert rows[-1]["test_psnr"] > 18
    if name in ("mcmc", "3dgs_capped"):
        assert max(row["n"] for row in rows) <= 90
