"""What the settings make of a recipe."""

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
