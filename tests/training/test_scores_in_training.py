"""What a run asks of scores: by its own views, and only by the pixels that its masks leave."""

from collections.abc import Callable

import numpy as np
import pytest
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.scene.row_groups import OWN_AXES
from mi_dogsplat.scores.bands import bands
from mi_dogsplat.scores.score import ScoreRule, energies
from mi_dogsplat.scores.slope_losses import curvature_losses, slope_losses
from mi_dogsplat.scores.training_views import TrainingViews, whole
from mi_dogsplat.training.strategy.options import NO_CUT, NO_SECOND_CUT, REMOVAL, Options
from mi_dogsplat.training.train import Trainer
from photographs import config_of, left_half, write_masks


def trainer_of(data, folder, on_disk=False) -> Trainer:
    dataset = load_dataset(data, on_disk=on_disk)
    masks = str(write_masks(folder, dataset, left_half()))
    return Trainer(config_of(masks=masks, data_on_disk=on_disk, sh_degree=1), dataset)


def views_of(trainer: Trainer, mask: Callable[[int], np.ndarray | None] = whole) -> TrainingViews:
    return TrainingViews(trainer.photographs.cameras, trainer.options, mask=mask)


def half_of(trainer: Trainer) -> tuple[dict, TrainingViews]:
    return trainer.optimizer.params, views_of(trainer, lambda _: left_half())


@pytest.mark.parametrize("on_disk", [False, True])
def test_pruning_goes_by_the_pixels_that_count(data, tmp_path, on_disk):
    trainer, rule = trainer_of(data, tmp_path, on_disk), ScoreRule("leave-one-out", spectral_weight=0.0)
    expected = rule(*half_of(trainer), 0)
    np.testing.assert_allclose(trainer.importance(rule), expected, rtol=1e-6)
    assert not np.allclose(expected, rule(trainer.optimizer.params, views_of(trainer), 0), rtol=0.1)


def test_masks_are_as_large_as_the_pictures_are_shown(data, tmp_path):
    trainer = trainer_of(data, tmp_path)
    trainer.photographs.shrink(2)
    small = left_half()[::2, ::2]
    expected = REMOVAL(trainer.optimizer.params, views_of(trainer, lambda _: small), 0)
    np.testing.assert_allclose(trainer.importance(REMOVAL), expected, rtol=1e-6)


def test_so_do_the_options_among_which_bytes_are_divided(data, tmp_path):
    trainer = trainer_of(data, tmp_path)
    trainer.step_count = 40  # with all bands
    splats = trainer.optimizer.to_splats()
    splats.sh_coeffs[:, 1:] = 0.2
    trainer.optimizer.assign("sh_rest", splats.sh_coeffs.reshape(splats.n_splats, -1))
    found = Options.of(trainer, splats)
    params, views = half_of(trainer)
    expected = energies(REMOVAL, params, views, 0)[0]
    np.testing.assert_allclose(found.removal, expected, rtol=1e-6)
    losses = bands(params, splats.sh_coeffs, views).losses()
    np.testing.assert_allclose(found.by_degree, losses, rtol=1e-6)
    assert losses[:, 0].max() > 0


def test_what_each_kind_of_rows_is_worth_is_looked_at_in_the_primitives_that_have_some(data, tmp_path):
    trainer, rng = trainer_of(data, tmp_path), np.random.default_rng(0)
    n = trainer.optimizer.n
    for k, group in enumerate(OWN_AXES):
        ((name, shape),), index = group.arrays.items(), np.arange(k, n, len(OWN_AXES))
        trainer.optimizer.set_rows(group, index, {name: rng.normal(size=(len(index), *shape)).astype(np.float32)})
    found = Options.of(trainer, trainer.optimizer.to_splats())
    shown = half_of(trainer)
    expected = [losses(*shown) for losses in (slope_losses, curvature_losses)]
    expected += [energies(rule, *shown, 0)[0] for rule in (NO_CUT, NO_SECOND_CUT)]
    assert list(found.rows) == list(OWN_AXES)
    for (group, rows), losses in zip(found.rows.items(), expected, strict=True):
        np.testing.assert_array_equal(np.flatnonzero(rows.has), trainer.optimizer.index_of(group))
        np.testing.assert_allclose(rows.without[rows.has], losses[rows.has], rtol=1e-5)
        assert losses[rows.has].max() > 0 and not rows.without[~rows.has].any()
