"""How DashGaussian allots sizes of pictures, primitives and steps, by independent brute force."""

from typing import Any

import numpy as np
import pytest
from hdr_data import write_hdr_data
from mi_dogsplat.compare.rivals import dash
from mi_dogsplat.compare.rivals.dash import LARGEST, Spectra, count_at
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.support.srgb import linear_to_srgb_log
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer


def test_dash_begins_with_small_pictures(trainer_of):
    trainer = trainer_of(dash.RECIPE)
    trainer.step()
    photographs = trainer.photographs
    assert photographs.factor > 1
    assert photographs.cameras[0].width == trainer.dataset.train[0].camera.width // photographs.factor


def test_dash_follows_what_the_loss_sees_of_linear_pictures(tmp_path):
    data = str(write_hdr_data(tmp_path / "data"))
    config = TrainConfig(data, preset="3dgs", steps=60, sh_degree=1, target=90)
    trainer = Trainer(config, load_dataset(data, 1), dash.RECIPE)
    (state,) = (state for state in trainer.states.values() if isinstance(state, dash.Shown))
    images = [view.image / trainer.dataset.white for view in trainer.dataset.train]
    assert state.start == pytest.approx(Spectra.of([linear_to_srgb_log(image) for image in images]).start, rel=1e-4)
    assert state.start != pytest.approx(Spectra.of(images).start, rel=1e-2)


def test_dash_keeps_the_appearance_that_it_has_learned(trainer_of):
    trainer = trainer_of(dash.RECIPE, appearance=True)
    for _ in run_to_end(trainer):
        pass
    assert trainer.photographs.factor == 1 and sum(trainer.photographs.appearance.of_images.t) == 60


def brute_force_share(images: list[np.ndarray], factor: Any) -> float:
    """Summed amplitude of the frequencies below 1 / factor of the highest along both axes, by loops."""
    inside = total = 0.0
    for image in images:
        height, width = image.shape[:2]
        amplitude = np.abs(reference_score.fourier(np.moveaxis(image, -1, 0))).sum(0)
        for y in range(height):
            for x in range(width):
                total += amplitude[y, x]
                fy, fx = min(y, height - y) / height * 2, min(x, width - x) / width * 2
                inside += amplitude[y, x] * (max(fy, fx) <= 1 / factor + 1e-9)
    return inside / total


def test_dash_starts_where_no_photograph_keeps_less_than_a_quarter_and_gives_steps_by_logarithms():
    rng = np.random.default_rng(1)
    smooth = np.add.outer(np.linspace(0, 1, 40), np.linspace(0, 1, 32))[..., None] * np.ones(3) / 2
    images = [smooth + noise * rng.normal(size=(40, 32, 3)) for noise in (0.15, 0.1)]
    spectra = Spectra.of(images)
    factors = np.arange(1, LARGEST, 1 / 64)
    kept = [min(brute_force_share([image], factor) for image in images) for factor in factors]
    first = factors[np.flatnonzero(np.array(kept) >= 0.25)[-1]]
    assert 2 < first < LARGEST and spectra.factor(0.0) == int(first)
    X = [brute_force_share(images, k) for k in range(1, LARGEST + 1)]
    assert spectra.start == pytest.approx(brute_force_share(images, first), rel=0.05)
    for progress in np.linspace(0, 1, 101):
        level = np.exp((1 - progress) * np.log(spectra.start))  # log X rises evenly
        assert spectra.factor(progress) == max(k for k in range(1, int(first) + 1) if X[k - 1] >= level - 1e-9)
    assert spectra.factor(spectra.begins_to_fall + 1e-6) == 1 < spectra.factor(spectra.begins_to_fall - 1e-6)
    assert [count_at(r, 0.5, 100, 900) for r in (1, 4)] == [900, 100 + 800 / 4**1.5]


def test_dash_shows_black_photographs_whole():
    """They have no spectrum to go by; one that is black beside others changes nothing."""
    rng = np.random.default_rng(1)
    black, noisy = np.zeros((40, 32, 3)), np.full((40, 32, 1), 0.5) + 0.1 * rng.normal(size=(40, 32, 3))
    spectra = Spectra.of([black, black])
    assert [spectra.factor(progress) for progress in (0.0, 0.5, 1.0)] == [1, 1, 1] and spectra.begins_to_fall == 0
    with_black, alone = Spectra.of([noisy, black]), Spectra.of([noisy])
    assert with_black.start == alone.start
    np.testing.assert_array_equal(with_black.shares, alone.shares)


def test_dash_grows_by_a_fifth_at_most_before_its_last_refinement_and_holds_position_steps(trainer_of):
    trainer = trainer_of(dash.RECIPE, 3000)
    rule, count = trainer.recipe.densification, trainer.optimizer.n
    trainer.photographs.shrink(1)
    trainer.step_count = rule.stop // 2
    assert dash.GrowWithPictures().budget(trainer, rule) == int(1.2 * count) < 90
    trainer.step_count = rule.stop - 1
    assert dash.GrowWithPictures().budget(trainer, rule) == 90
    part = next(s for s in trainer.strategies if isinstance(s, dash.SmallPictures))
    state, rates = trainer.states[part.name], trainer.optimizer.learning_rates
    state.start, state.shares = 0.25, np.array([1.0, 0.5])  # below 2 from half of densification on
    for step, expected in ((0, 1.6e-4), (rule.stop // 2, 1.6e-4), (3000, 1.6e-6), (rule.stop // 4 + 1500, 1.6e-5)):
        trainer.step_count = step
        part.before_step(trainer, state)
        got = rates.at(step)["means"] * trainer.optimizer.rate_factors["means"] / trainer.extent
        assert got == pytest.approx(expected, rel=0.01), step
