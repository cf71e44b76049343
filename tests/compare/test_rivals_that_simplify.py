"""What rivals that simplify do beside their scores, by independent brute force: penalties, masks, new beginnings."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.rivals import gaussian_spa, mask_gaussian, mini_splatting
from mi_dogsplat.training.optimizer.adam import Entry

# GaussianSpa


def test_gaussianspa_has_its_penalty_in_every_50th_step_with_the_targets_from_before_it(trainer_of):
    rule = gaussian_spa.GaussianSpa(start=2, stop=12, every=4, rho=0.7)
    trainer = trainer_of(replace(METHODS["3dgs"].recipe, also=()), 3000, target=20)
    z = u = np.zeros(0)
    for step in range(13):
        trainer.step_count = step
        logits: Any = trainer.optimizer.params["logit_opacities"]
        dr.set_grad(logits, dr.zeros(mi.Float, trainer.optimizer.n))
        o = trainer.optimizer.to_splats().opacities
        rule.after_backward(trainer, None, SimpleNamespace(last=True))  # type: ignore[arg-type]
        if step == 2:
            z, u = np.where(o >= np.sort(o)[-20], o, 0), np.zeros(len(o))
        expected = np.zeros(len(o))
        if step in (5, 9):
            expected = 0.7 * (o - z + u) * o * (1 - o)
            z = np.where(o + u >= np.sort(o + u)[-20], o + u, 0)
            u = u + o - z
        np.testing.assert_allclose(dr.grad(logits).numpy(), expected, rtol=1e-4, atol=1e-7)
        moved = trainer.optimizer.numpy("logit_opacities") + 0.1 * np.sin(np.arange(len(o)) + step)
        trainer.optimizer.assign("logit_opacities", moved)
    np.testing.assert_allclose(trainer.optimizer.numpy(gaussian_spa.DUAL), u, atol=1e-5)


# Mini-Splatting


@pytest.mark.parametrize("name", ["mini_splatting", "gaussian_spa"])
def test_after_the_first_simplification_points_begin_anew_with_an_optimizer_that_is_new(trainer_of, name):
    trainer = trainer_of(METHODS[name].recipe, 300, target=20, max_primitives=120)
    while trainer.step_count < 150:
        trainer.step()
    means, colors = trainer.optimizer.numpy("means"), trainer.optimizer.numpy("sh_dc")
    assert 20 < len(means) < 90  # of 120 at most
    part = next(s for s in trainer.strategies if s.name == "reinitialize")
    part.before_step(trainer, None)
    np.testing.assert_array_equal(trainer.optimizer.numpy("means"), means)
    np.testing.assert_allclose(trainer.optimizer.numpy("sh_dc"), colors, atol=1e-6)
    np.testing.assert_allclose(trainer.optimizer.to_splats().opacities, 0.1, rtol=1e-5)
    distance = np.sort(np.linalg.norm(means[:, None].astype(float) - means, axis=2), axis=1)[:, 1:4]
    scale = np.sqrt((distance**2).mean(1))
    np.testing.assert_allclose(np.exp(trainer.optimizer.numpy("log_scales")), scale[:, None].repeat(3, 1), rtol=1e-3)
    assert not trainer.optimizer.numpy("sh_rest").any()
    for parameter in trainer.optimizer.adam:
        entry = Entry.of(trainer.optimizer.adam, parameter)
        assert entry.t[0] == 0 and not entry.m.numpy().any() and not entry.v.numpy().any()
    trainer.step()
    rate = Entry.of(trainer.optimizer.adam, "means").rate
    assert rate == pytest.approx(trainer.extent * 1.6e-4 * 0.01 ** (5000 / 30_000), rel=1e-6)  # that of step 5,000
    assert Entry.of(trainer.optimizer.adam, "logit_opacities").rate == pytest.approx(0.05)


def test_mini_splattings_second_simplification_renews_the_optimizer_alone(trainer_of):
    trainer = trainer_of(mini_splatting.RECIPE, 300, target=20, max_primitives=120)
    while trainer.step_count < 200:
        trainer.step()
    scales = trainer.optimizer.numpy("log_scales")
    assert trainer.optimizer.n == 20
    part = next(s for s in trainer.strategies if s.name == "reinitialize")
    part.before_step(trainer, None)
    np.testing.assert_array_equal(trainer.optimizer.numpy("log_scales"), scales)
    assert Entry.of(trainer.optimizer.adam, "means").t[0] == 0


# MaskGaussian


def test_masks_are_there_from_the_first_step_and_sweep_at_every_refinement(trainer_of):
    recipe = METHODS["mask_gaussian"].recipe
    assert METHODS["mask_gaussian"].whole and not METHODS["mask_gaussian"].from_the_start
    trainer = trainer_of(recipe, 3000, target=20)
    trainer.step()
    logits = trainer.optimizer.numpy(mask_gaussian.MASK)
    step = 10 * mask_gaussian.RATE  # a tenth of the recipe's steps
    np.testing.assert_allclose(np.abs(logits - (10 - 1)), step, rtol=1e-3)
    part = next(s for s in trainer.strategies if s.name == "maskgaussian")
    # refinements of a tenth of the recipe's steps are 48 apart, the sweeps after them 100
    sweeps = {96: True, 100: False, 1488: True, 1500: True, 1550: False, 1600: True, 2500: True}
    for step, swept in sweeps.items():
        trainer.step_count = step
        trainer.optimizer.assign(mask_gaussian.MASK, np.where(np.arange(trainer.optimizer.n) < 1, -60.0, 9.0))
        assert bool(part.after_step(trainer, None)) == swept, step
