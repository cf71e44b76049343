"""What GaussianSpa does: its projection, and the penalty between projections."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.rivals import gaussian_spa
from mi_dogsplat.compare.rivals.gaussian_spa import projected


def test_gaussianspa_projects_on_the_nearest_sparse_vector():
    values = np.random.default_rng(0).uniform(0, 1, 6)
    got = projected(values, 2)
    candidates = [np.where(np.isin(np.arange(6), [i, j]), values, 0) for i in range(6) for j in range(i)]
    best = min(candidates, key=lambda z: float(np.sum((values - z) ** 2)))
    np.testing.assert_array_equal(got, best)


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
