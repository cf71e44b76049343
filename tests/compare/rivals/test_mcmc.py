"""What 3DGS-MCMC does besides relocation: noise, start, regularisers and growth."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.compare.rivals import mcmc
from mi_dogsplat.compare.rivals.mcmc import displacement
from mi_dogsplat.engine.parameters import upload
from splat_scenes import random_splats, rounded


def test_mcmc_shakes_positions_by_the_covariance_where_opacities_are_low():
    splats = rounded(random_splats(40, seed=3, degree=0, dog_share=0))
    splats.logit_opacities[::2] = -6
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(40, 3))
    got = displacement(upload(splats), mi.Float(normal.ravel().astype(np.float32)), 0.3).numpy().reshape(40, 3)
    x, y, z, w = (splats.quats.astype(float) / np.linalg.norm(splats.quats.astype(float), axis=1, keepdims=True)).T
    i = np.zeros(40)
    q = np.stack([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]).transpose(2, 0, 1)  # left products
    p = np.stack([[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]]).transpose(2, 0, 1)  # right, conjugate
    R = (q @ p)[:, 1:, 1:] + i[:, None, None]
    variance = np.exp(2 * splats.log_scales.astype(float))
    sigma = R @ (variance[:, :, None] * R.transpose(0, 2, 1))
    opacity = 1 / (1 + np.exp(-splats.logit_opacities.astype(float)))
    gate = 1 / (1 + np.exp(100 * (opacity - 0.005)))
    expected = 0.3 * gate[:, None] * np.einsum("nij,nj->ni", sigma, normal)
    np.testing.assert_allclose(got, expected, rtol=2e-3, atol=1e-7 * np.abs(expected).max())
    assert gate[::2].min() > 0.5 and gate[1::2].max() < 0.1


def test_mcmc_starts_small_and_half_opaque_and_once(trainer_of):
    trainer = trainer_of(mcmc.RECIPE, 3000)
    before = trainer.optimizer.numpy("log_scales")
    trainer.begin()
    splats = trainer.optimizer.to_splats()
    np.testing.assert_allclose(splats.opacities, 0.5, rtol=1e-6)
    np.testing.assert_allclose(np.exp(splats.log_scales), 0.1 * np.exp(before), rtol=1e-5)
    again = trainer_of(mcmc.RECIPE, 3000)  # as where a run goes on from a checkpoint before its first step
    again.restore(trainer.state())
    again.begin()
    np.testing.assert_array_equal(again.optimizer.to_splats().log_scales, splats.log_scales)


def test_mcmcs_regularisers_are_gradients_of_two_means(trainer_of):
    trainer = trainer_of(mcmc.RECIPE, 3000)
    params = trainer.optimizer.params
    for name in ("logit_opacities", "log_scales"):
        dr.set_grad(params[name], dr.zeros(mi.Float, dr.width(params[name])))
    part = next(s for s in trainer.strategies if s.name == "mcmc")
    part.after_backward(trainer, None, None)  # type: ignore[arg-type]
    n = trainer.optimizer.n

    def value(logits, log_scales):
        return 0.01 * (1 / (1 + np.exp(-logits))).mean() + 0.01 * np.exp(log_scales).mean()

    arrays = [trainer.optimizer.numpy(name).astype(float) for name in ("logit_opacities", "log_scales")]
    for which, name in enumerate(("logit_opacities", "log_scales")):
        got = dr.grad(params[name]).numpy().reshape(arrays[which].shape)
        for k in np.ndindex(*arrays[which].shape):
            if k[0] % 9 == 0:
                moved = [a.copy() for a in arrays]
                moved[which][k] += 1e-4
                above = value(*moved)
                moved[which][k] -= 2e-4
                assert got[k] == pytest.approx((above - value(*moved)) / 2e-4, rel=1e-3), (name, k, n)


def test_mcmc_grows_by_a_twentieth_to_the_budget_and_then_relocates(trainer_of):
    trainer = trainer_of(mcmc.RECIPE, 400, target=90, max_primitives=None)
    start = trainer.optimizer.n
    counts = [trainer.optimizer.n]
    while trainer.step_count < 330:
        trainer.step()
        counts.append(trainer.optimizer.n)
    changes = [(a, b) for a, b in zip(counts[:-1], counts[1:], strict=True) if a != b]
    assert start < 90 == counts[-1] and all(b == min(90, int(1.05 * a)) for a, b in changes)
    part = next(s for s in trainer.strategies if s.name == "mcmc")
    logits = trainer.optimizer.numpy("logit_opacities")
    logits[:5] = -8
    trainer.optimizer.assign("logit_opacities", logits)
    trainer.step_count = part.every * (1 + part.start // part.every)
    event = part.after_step(trainer, None)[0]
    assert event.record["moved"] >= 5 and trainer.optimizer.n == 90
    assert trainer.optimizer.to_splats().opacities.min() > 0.0049
