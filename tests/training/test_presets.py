"""Recipes: what the method prescribes, and that every phase fits into a run of any length."""

import dataclasses
import math

import numpy as np
import pytest
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.scores.score import ScoreRule
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.given_rows import GIVEN
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.recipe import Recipe
from mi_dogsplat.training.resolve import recipe_of_run
from mi_dogsplat.training.strategy.cut_activation import CutRule
from mi_dogsplat.training.strategy.densify import Densification
from mi_dogsplat.training.strategy.scheduler import PruningRule
from mi_dogsplat.training.strategy.shift_activation import ShiftRule
from mi_dogsplat.training.strategy.sieve import Sieve
from mi_dogsplat.training.strategy.slope_activation import SlopeRule

EXTENSIONS = ["ours", "ours_slopes", "ours_cuts", "ours_preconditioned", "ours_second_cuts", "ours_curvatures",
              "ours_shifts"]  # fmt: skip
"""Each adds to the one before it."""
PRUNING = [name for name, recipe in RECIPES.items() if recipe.pruning]


def test_the_presets_are_those_of_the_interface_and_of_its_extensions_and_the_default_is_ours():
    assert list(RECIPES) == [*EXTENSIONS, "ours_early", "paper", "released", "3dgs"]
    assert RECIPES["ours_early"] == RECIPES["ours_shifts"].growing(0.35)
    assert TrainConfig("data").preset == "ours"


def test_the_baseline_neither_prunes_nor_knows_dog():
    assert RECIPES["3dgs"] == Recipe(Densification(), None, None, None)


@pytest.mark.parametrize(
    ("before", "after", "rows", "kind", "beside"),
    [
        ("ours", "ours_slopes", "slopes", SlopeRule, "dog"),
        ("ours_slopes", "ours_cuts", "cuts", CutRule, "slopes"),
        ("ours_preconditioned", "ours_second_cuts", "second_cuts", CutRule, "cuts"),
        ("ours_second_cuts", "ours_curvatures", "curvatures", SlopeRule, "slopes"),
        ("ours_curvatures", "ours_shifts", "shifts", ShiftRule, "slopes"),
    ],
)
def test_each_kind_of_rows_comes_with_what_there_is_and_is_all_that_is_added(before, after, rows, kind, beside):
    old, new = RECIPES[before], RECIPES[after]
    assert new == dataclasses.replace(old, **{rows: kind(getattr(old, beside).start)})
    given = [name for name, recipe in RECIPES.items() if getattr(recipe, rows)]
    assert given == [*EXTENSIONS[EXTENSIONS.index(after) :], "ours_early"]
    for recipe in (new.scaled(7000), new.from_pruning(), new.from_pruning().scaled(350)):
        assert recipe.dog and getattr(recipe, rows).start == getattr(recipe, beside).start == recipe.dog.start


def test_preconditioned_steps_come_after_the_activation_of_dog_and_are_all_that_is_added_to_cuts():
    cut, preconditioned = RECIPES["ours_cuts"], RECIPES["ours_preconditioned"]
    rule = preconditioned.preconditioning
    assert rule and dataclasses.replace(cut, preconditioning=rule) == preconditioned
    assert [name for name, recipe in RECIPES.items() if recipe.preconditioning] == [*EXTENSIONS[3:], "ours_early"]
    for recipe in (preconditioned, preconditioned.scaled(7000), preconditioned.from_pruning()):
        assert recipe.preconditioning and recipe.dog
        after = recipe.preconditioning.start - (recipe.first_step + recipe.dog.start)
        assert 0 < after <= recipe.reference_steps / 30


def test_rows_are_given_in_their_order_and_each_kind_is_looked_at_in_the_end():
    assert list(GIVEN) == ["slopes", "curvatures", "cuts", "second_cuts", "shifts"]
    names = [part.name for part in RECIPES["ours_shifts"].strategies(Sieve())]
    every = "slope", "curvature", "cut", "secondcut", "shift"
    assert names[-5:] == [f"{kind}activation" for kind in every]
    assert [name for name in names if name.endswith("control")] == [f"{kind}control" for kind in ("dog", *every)]


@pytest.mark.parametrize("name", RECIPES)
def test_any_recipe_can_have_preconditioned_steps_once_it_has_pruned_and_given_rows(name):
    recipe = RECIPES[name].preconditioned()
    rule, begins = recipe.preconditioning, [r.start for r in (recipe.dog, *recipe.row_rules.values()) if r]
    grown = recipe.densification.stop
    assert rule and rule.start >= 500 + max([3000 + grown, *begins, recipe.pruning.stop if recipe.pruning else 0])
    assert recipe.preconditioned() == recipe
    assert dataclasses.replace(recipe, preconditioning=RECIPES[name].preconditioning) == RECIPES[name]


@pytest.mark.parametrize("name", ["ours", "ours_gaussian", "3dgs_equal"])
def test_a_shorter_growth_and_preconditioned_steps_make_the_same_recipe_in_either_order(name):
    recipe = METHODS[name].recipe
    assert recipe.growing(0.35).preconditioned() == recipe.preconditioned().growing(0.35)


def test_what_ply_alone_holds_is_named():
    given = {name: recipe.given for name, recipe in RECIPES.items() if recipe.given}
    both, twice = "slopes and cuts", "slopes, cuts and second cuts"
    assert given == {
        "ours_slopes": "slopes", "ours_cuts": both, "ours_preconditioned": both, "ours_second_cuts": twice,
        "ours_curvatures": "slopes, curvatures, cuts and second cuts",
        **dict.fromkeys(["ours_shifts", "ours_early"], "slopes, curvatures, cuts, second cuts and shifts"),
    }  # fmt: skip


def test_the_papers_recipe_is_that_of_its_text():
    recipe = RECIPES["paper"]
    assert recipe.pruning == PruningRule(15_000, 25_000, 500, 2000, 0.95, "halving", None)
    assert recipe.score == ScoreRule("spatio-spectral", 1, 1, 1)
    assert recipe.dog and (recipe.dog.start, recipe.dog.opacity, recipe.dog.scale) == (25_000, 0.5, 0.6)
    assert recipe.dog.control and recipe.reference_steps == 30_000


def test_all_factors_of_the_papers_pseudo_gaussians_start_below_1():
    dog = RECIPES["paper"].dog
    assert dog and 0 < dog.opacity < 1 and np.all(np.less([0.0], dog.scale) & np.less(dog.scale, 1.0))


def test_the_released_recipe_is_that_of_the_authors_code():
    recipe = RECIPES["released"]
    assert recipe.pruning == PruningRule(15_700, 25_200, 500, 2000, 0.99, "halving", 5)
    assert recipe.score == ScoreRule("released")
    assert recipe.dog and (recipe.dog.start, recipe.dog.opacity, recipe.dog.scale) == (25_200, 0.5, 1.6)
    assert not recipe.dog.control and (recipe.reference_steps, recipe.position_steps) == (40_000, 30_000)


def test_a_recipe_for_its_own_length_is_itself():
    for recipe in RECIPES.values():
        assert recipe.scaled(recipe.reference_steps) == recipe


@pytest.mark.parametrize("name", PRUNING)
@pytest.mark.parametrize("whole", [True, False])
def test_every_phase_is_within_a_run_of_any_length_and_in_order(name, whole):
    for steps in (*range(1, 40), 300, 7000, 60_000):
        recipe = (RECIPES[name] if whole else RECIPES[name].from_pruning()).scaled(steps)
        assert recipe.pruning and recipe.dog, steps
        assert recipe.densification.stop <= recipe.pruning.start + 1 <= steps + 1
        assert recipe.pruning.start <= recipe.pruning.stop <= recipe.dog.start <= steps
        assert recipe.position_steps >= 1 and recipe.sh_every >= whole, steps


@pytest.mark.parametrize("name", PRUNING)
def test_for_a_model_the_recipe_begins_with_the_first_check_and_the_rates_of_that_step(name):
    whole, rest = RECIPES[name], RECIPES[name].from_pruning()
    assert whole.pruning and whole.dog and rest.pruning and rest.dog
    start = whole.pruning.start
    assert rest.pruning == dataclasses.replace(whole.pruning, start=0, stop=whole.pruning.stop - start)
    assert rest.first_step == start and rest.reference_steps == whole.reference_steps - start
    assert rest.dog.start == whole.dog.start - start
    rule = rest.scaled(7000).densification
    assert not any(rule.refines(s) or rule.resets_opacity(s) or s < rule.stop for s in range(7001))


@pytest.mark.parametrize("name", RECIPES)
@pytest.mark.parametrize("share", [0.05, 0.2833, 0.6])
def test_a_shorter_growth_brings_all_that_follows_forward_and_refinement_gets_the_rest(name, share):
    usual, recipe = RECIPES[name], RECIPES[name].growing(share, gain=3.0)
    earlier = usual.densification.stop - recipe.densification.stop
    assert recipe.densification.stop == round(share * usual.reference_steps)
    later = ("pruning", "preconditioning", "dog", *GIVEN)
    for rule in later:
        before, after = getattr(usual, rule), getattr(recipe, rule)
        moved = {name: getattr(before, name) - earlier for name in ("start", "stop") if hasattr(before, name)}
        assert after == (before and dataclasses.replace(before, **moved))
    kept = {rule: getattr(usual, rule) for rule in (*later, "densification", "refinement")}
    assert dataclasses.replace(recipe, **kept) == usual and recipe.reference_steps > recipe.last_milestone


@pytest.mark.parametrize("name", ["ours", "ours_early", "3dgs"])
def test_step_sizes_of_a_shorter_growth_are_larger_and_those_behind_it_are_as_usual(name):
    usual, recipe = RECIPES[name], RECIPES[name].growing(0.4, gain=3.0)

    def rates(recipe: Recipe, step: int) -> dict[str, float]:
        return LearningRates(1.0, 10**15, refinement=recipe.refinement).at(step)

    threshold = recipe.densification.gradient_threshold / Densification.gradient_threshold
    assert threshold == pytest.approx(math.sqrt(3))  # larger steps, larger gradients
    plain = rates(Recipe(), 0)
    assert rates(recipe, 11_999) == pytest.approx({name: 3 * rate for name, rate in plain.items()})
    begun = rates(usual, usual.refinement.start) if usual.refinement else plain
    assert rates(recipe, 12_000) == pytest.approx(begun)


def test_the_shorter_growth_of_a_preset_can_be_asked_for_once_more_and_stays_what_it_is():
    early = RECIPES["ours_early"]
    assert recipe_of_run(TrainConfig("data", preset="ours_early", growth=0.35), None) == early
    assert early.growing(0.2).growing(0.35) == early == RECIPES["ours_shifts"].growing(0.35)


def test_a_growth_that_leaves_no_step_to_grow_or_to_refine_is_refused():
    with pytest.raises(ValueError, match="a share of 0.01 leaves no step to grow"):
        RECIPES["ours"].growing(0.01)
    with pytest.raises(ValueError, match="a share of 0.9 leaves no step after the last milestone"):
        RECIPES["ours"].growing(0.9)
    with pytest.raises(DataError, match="--growth: is for a training from the first step on"):
        TrainConfig("data", model="model.ply", growth=0.3)
    with pytest.raises(DataError, match="--growth: 0.7 is out of range"):
        TrainConfig("data", growth=0.7)


def test_a_recipe_that_does_not_prune_has_no_rest_and_one_without_score_cannot_prune():
    with pytest.raises(ValueError, match="does not prune"):
        RECIPES["3dgs"].from_pruning()
    with pytest.raises(ValueError, match="needs a score"):
        Recipe(pruning=PruningRule())


# --- what a configuration takes from them ---


@pytest.mark.parametrize(
    ("preset", "model", "steps"),
    [
        ("ours", None, 30_000),
        ("3dgs", None, 30_000),
        ("released", None, 40_000),
        ("paper", "m.ply", 15_000),
        ("released", "m.ply", 24_300),
    ],
)
def test_the_preset_decides_on_the_steps_unless_they_are_given(preset, model, steps):
    assert TrainConfig("data", preset, model=model).steps == steps
    assert TrainConfig("data", preset, 70, model=model).steps == 70


def test_the_preset_decides_on_the_largest_scale_unless_it_is_given():
    assert TrainConfig("data", "paper").max_world_scale == 0.1
    assert TrainConfig("data", "ours").max_world_scale == math.inf
    assert TrainConfig("data", "ours", max_world_scale=0.3).max_world_scale == 0.3


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"target": 0.0}, "--target: 0 is not a target"),
        ({"target": -0.1}, "--target"),
        ({"target": 2.5}, "--target: 2.5 is not a target"),
        ({"target": math.nan}, "--target"),
        ({"target": math.inf}, "--target"),
        ({"target": 500, "max_primitives": 500}, "--target: 500 .* --max-primitives 500"),
        ({"target": 501, "max_primitives": 500}, "smaller target"),
        ({"preset": "3dgs", "model": "m.ply"}, '"3dgs" does not prune; use ours or ours_slopes or ours_cuts or'),
    ],
)
def test_settings_that_cannot_be_met_name_their_flag(settings, words):
    with pytest.raises(DataError, match=words):
        TrainConfig("data", **settings)


def test_a_recipe_that_grows_needs_a_number_of_primitives_to_grow_to():
    recipe = Recipe(start_share=0.5)
    assert (recipe.start_limit(300.0), recipe.start_limit(1.0)) == (150, 1)
    assert Recipe().start_limit(0.1) is None
    for target in (0.1, "2MB"):
        with pytest.raises(ValueError, match=f"grows to a number of primitives, not to {target}"):
            recipe.start_limit(target)
