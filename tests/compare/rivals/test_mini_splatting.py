"""New beginnings of Mini-Splatting after its simplifications."""

import numpy as np
import pytest
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.rivals import mini_splatting
from mi_dogsplat.training.optimizer.adam import Entry


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
