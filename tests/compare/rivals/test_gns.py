"""The opacity pressure of natural selection, and when it ends."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.rivals import gns
from mi_dogsplat.compare.rivals.gns import pull


@pytest.mark.parametrize("gentle", [True, False])
def test_the_opacity_pressure_is_the_gradient_of_its_term(gentle):
    logits = np.array([-4.0, -1.0, 0.5, 2.0, 2.9, 3.5, 6.0])

    def term(values: np.ndarray) -> float:
        opacity = 1 / (1 + np.exp(-values))
        if gentle:
            return float(np.mean((values + 20) / np.maximum(0.05, 1 - opacity)) ** 2)
        return float(3 * (values.mean() + 20) ** 2)

    got = 2 / len(logits) * pull(mi.Float(logits.astype(np.float32)), gentle).numpy()
    for k in range(len(logits)):
        step = np.where(np.arange(len(logits)) == k, 1e-5, 0)
        assert got[k] == pytest.approx((term(logits + step) - term(logits - step)) / 2e-5, rel=1e-3)


@pytest.mark.parametrize("stop", [90, 97])
def test_natural_selection_draws_at_its_end_what_has_not_faded_by_then(trainer_of, stop):
    """In a run of 7,000 steps the end is no multiple of the steps between removals."""
    part = gns.NaturalSelection(start=0, stop=stop, every=10, gentle=50)
    trainer = trainer_of(replace(METHODS["3dgs"].recipe, also=()), 3000, target=20)
    state, n = part.new_state(trainer), trainer.optimizer.n
    for step in range(1, stop):
        trainer.step_count = step
        part.after_step(trainer, state)
    assert trainer.optimizer.n == n > 21 and state.met < 0
    trainer.step_count = stop
    assert part.due(trainer, state)
    part.after_step(trainer, state)
    assert trainer.optimizer.n == 20 and state.met == stop
    trainer.step_count = stop + 10 - stop % 10
    assert not part.due(trainer, state)


def test_natural_selection_steers_its_weight_meets_the_budget_and_lowers_the_steps_again(trainer_of):
    part = gns.NaturalSelection(start=0, stop=400, every=10, gentle=50)
    trainer = trainer_of(replace(METHODS["3dgs"].recipe, also=()), 3000, target=20)
    state = part.new_state(trainer)
    part.before_step(trainer, state)
    assert trainer.optimizer.rate_factors["logit_opacities"] == 4
    logits: Any = trainer.optimizer.params["logit_opacities"]
    dr.set_grad(logits, dr.zeros(mi.Float, trainer.optimizer.n))
    part.after_backward(trainer, state, SimpleNamespace())  # type: ignore[arg-type]
    assert state.began == pytest.approx(0.8 * np.sort(trainer.optimizer.to_splats().opacities)[-20], rel=1e-5)
    assert (dr.grad(logits).numpy() > 0).all()
    trainer.step_count = 300  # the opacity at the rank is far above its way
    part.before_step(trainer, state)
    assert state.weight == pytest.approx(1.2 * 2e-4)
    faint = trainer.optimizer.numpy("logit_opacities")
    faint[25:] = -9
    trainer.optimizer.assign("logit_opacities", faint)
    trainer.step_count = 60
    part.after_step(trainer, state)
    assert trainer.optimizer.n == 25 and state.met < 0
    trainer.optimizer.assign("logit_opacities", np.full(25, -9.0), np.arange(25))
    trainer.optimizer.assign("logit_opacities", np.zeros(20), np.arange(20))
    trainer.step_count = 70
    part.after_step(trainer, state)
    assert trainer.optimizer.n == 20 and state.met == 70
    for step, factor in ((100, 4), (120, 1)):
        trainer.step_count = step
        part.before_step(trainer, state)
        assert trainer.optimizer.rate_factors["logit_opacities"] == factor
