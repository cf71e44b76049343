"""What the settings make of a recipe."""

import dataclasses

import pytest
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.resolve import recipe_of_run


@pytest.mark.parametrize("settings", [{}, {"format": "sog", "target": "20kB"}, {"model": "model.ply"}])
def test_preconditioned_steps_go_with_each_format_and_with_a_model_that_exists(settings):
    config = TrainConfig("data", steps=6000, preconditioned=True, **settings)
    found, without = recipe_of_run(config, None), recipe_of_run(TrainConfig("data", steps=6000, **settings), None)
    factor = 6000 / (15_000 if "model" in settings else 30_000)
    assert found.preconditioning and not without.preconditioning
    assert found.preconditioning.start == 18_500 * factor
    assert bool(found.dog) == bool(without.dog) == ("format" not in settings)


@pytest.mark.parametrize("name", ["mini_splatting", "mcmc", "3dgs_equal"])
def test_methods_of_a_comparison_have_them_too(name):
    assert recipe_of_run(TrainConfig("data", preconditioned=True), METHODS[name].recipe).preconditioning
    assert not recipe_of_run(TrainConfig("data"), METHODS[name].recipe).preconditioning


@pytest.mark.parametrize("name", ["ours_preconditioned", "ours_second_cuts", "ours_curvatures", "ours_shifts"])
def test_a_preset_that_has_them_keeps_its_own(name):
    recipe = RECIPES[name]
    ours = [recipe_of_run(TrainConfig("data", preconditioned=p), recipe).preconditioning for p in (False, True)]
    assert ours[0] == ours[1] == recipe.preconditioning


def test_a_shorter_growth_goes_with_each_preset_and_with_preconditioned_steps():
    config = TrainConfig("data", preset="ours", steps=3000, growth=0.4, preconditioned=True, format="sog")
    found, usual = recipe_of_run(config, None), recipe_of_run(dataclasses.replace(config, growth=None), None)
    assert found.pruning and usual.pruning and found.preconditioning and usual.preconditioning and found.refinement
    assert (usual.densification.stop, usual.pruning.start) == (1500, 1500)
    assert (found.densification.stop, found.pruning.start, found.refinement.start) == (1200, 1200, 1200)
    assert usual.preconditioning.start - found.preconditioning.start == 300
