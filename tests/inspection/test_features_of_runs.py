"""``dogsplat info --features`` of data sets and runs: what images, recipes and settings ask for."""

import dataclasses
import json
from pathlib import Path

import pytest
import tiny_data
from described import stated
from mi_dogsplat import write_ply
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.inspection.describe_features import describe_features
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.given_rows import GIVEN
from splat_scenes import random_splats, rounded


@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("points", [False, True])
def test_a_data_set_needs_what_its_images_and_points_ask_for(tmp_path, alpha, points):
    found = stated(describe_features(tiny_data.write_tiny_data(tmp_path, n=3, alpha=alpha, points=points)))
    expected = {"alpha masks": alpha, "background": alpha, "random start": not points, "test renders": True}
    expected["several image sizes"] = False
    assert {name: state for name, (state, _) in found.items()} == {
        name: "needed" if is_needed else "left out" for name, is_needed in expected.items()
    }


def write_run(folder: Path, with_model=True, **config) -> Path:
    (folder / "config.json").write_text(json.dumps({"data": "photos", "preset": "ours", "model": None, **config}))
    if with_model:
        write_ply(folder / "point_cloud.ply", rounded(random_splats(40, degree=1)))
    return folder


def test_a_run_needs_what_its_model_and_its_recipe_ask_for(tmp_path):
    found = stated(describe_features(write_run(tmp_path, background="black", sh_degree=1)))
    assert found["SH degree 1"][0] == found["training DoG"][0] == found["pruning"][0] == "needed"
    assert found["training DoG"][1] == "from 60% of the run on, left out before"
    assert found["background"] == ("left out", "black") and found["antialiasing"][0] == "left out"


@pytest.mark.parametrize(("model", "part"), [(None, "62%"), ("m.ply", "23%")])
def test_preconditioned_steps_come_after_training_dog_in_a_run_from_a_model_too(tmp_path, model, part):
    write_run(tmp_path, False, background="black", preset="ours_preconditioned", model=model)
    found = stated(describe_features(tmp_path))
    assert found["preconditioned steps"][1] == f"from {part} of the run on, left out before"


@pytest.mark.parametrize(("preset", "growth", "grown", "given"), [("ours", 0.2, 20, 30), ("ours_early", 0.3, 30, 40)])
def test_a_run_whose_growth_was_shorter_is_told_so_with_all_that_came_earlier(tmp_path, preset, growth, grown, given):
    write_run(tmp_path, False, background="black", preset=preset, growth=growth)
    found = stated(describe_features(tmp_path))
    assert found["densification"][1].startswith(f"to {grown}% of the run")
    assert found["pruning"][1] == f"from {grown}% of the run on, left out before"
    assert found["training DoG"][1] == f"from {given}% of the run on, left out before"


@pytest.mark.parametrize("growth", ["half", 2, [0.3]])
def test_a_growth_that_no_run_writes_is_one_line(tmp_path, growth):
    write_run(tmp_path, False, growth=growth)
    with pytest.raises(DataError, match=r'config\.json: "growth" is not what a run writes; '):
        describe_features(tmp_path)


def test_a_file_that_holds_no_dog_needs_no_training_of_them(tmp_path):
    write_run(tmp_path, False, background="black", format="sog")
    assert stated(describe_features(tmp_path))["training DoG"] == ("left out", "not in the recipe")


def test_preconditioned_steps_of_a_setting_are_told_of_methods_of_a_comparison_too(tmp_path):
    write_run(tmp_path, False, preset="paper", background="black", preconditioned=True)
    assert stated(describe_features(tmp_path))["preconditioned steps"][1] == "from 85% of the run on, left out before"
    recipe = dataclasses.asdict(METHODS["v3"].recipe)
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "V3", "recipe": recipe}))
    assert stated(describe_features(tmp_path))["preconditioned steps"][0] == "needed"


def test_a_run_of_a_comparison_needs_what_the_recipe_of_its_method_asks_for(tmp_path):
    write_run(tmp_path, False, preset="paper", background="black", sh_degree=1)
    recipe = dataclasses.asdict(METHODS["v3"].recipe)
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "V3", "recipe": recipe}))
    found = stated(describe_features(tmp_path))
    assert (found["pruning"][0], found["training DoG"][0]) == ("needed", "left out")


@pytest.mark.parametrize("known", [(), ("slopes",), ("slopes", "cuts")])
def test_a_recipe_of_an_earlier_version_knows_nothing_of_rows_that_came_later(tmp_path, known):
    write_run(tmp_path, False, preset="paper", background="black")
    recipe = dataclasses.asdict(METHODS["ours_cuts"].recipe)
    recipe = {name: rule for name, rule in recipe.items() if name not in GIVEN or name in known}
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "cuts", "recipe": recipe}))
    found = stated(describe_features(tmp_path))
    for name in GIVEN:
        said = found[f"training {name.replace('_', ' ')}"]
        assert said[0] == ("needed" if name in known else "left out")
        assert said[1] == ("from 60% of the run on, left out before" if name in known else "not in the recipe")


@pytest.mark.parametrize(
    ("changed", "wrong"),
    [
        ({"reference_steps": 0}, "reference_steps"),
        ({"sh_every": "often"}, "sh_every"),
        ({"densification": {"start": 500}}, "densification"),
        ({"pruning": 3}, "pruning"),
        ({"dog": {"start": None}}, "dog"),
        ({"second_cuts": {"start": "soon"}}, "second_cuts"),
        ({"preconditioning": []}, "preconditioning"),
        (None, "recipe"),
    ],
)
def test_a_damaged_recipe_is_one_line(tmp_path, changed, wrong):
    write_run(tmp_path, False, preset="paper", background="black")
    recipe = 5 if changed is None else dataclasses.asdict(METHODS["paper"].recipe) | changed
    (tmp_path / "recipe.json").write_text(json.dumps({"label": "V3", "recipe": recipe}))
    with pytest.raises(DataError, match=rf'recipe\.json: "{wrong}" is not what a run writes; restore or delete it'):
        describe_features(tmp_path)


def test_a_format_that_the_preset_of_a_run_cannot_have_is_one_line(tmp_path):
    write_run(tmp_path, False, background="black", preset="ours_cuts", format="sog")
    with pytest.raises(DataError, match=r"config\.json.*restore or delete it"):
        describe_features(tmp_path)


@pytest.mark.parametrize(
    ("config", "feature", "state"),
    [
        ({"preset": "3dgs"}, "pruning", "left out"),
        ({"preset": "3dgs"}, "training DoG", "left out"),
        ({"preset": "ours_slopes"}, "training slopes", "needed"),
        ({"preset": "ours_cuts"}, "training cuts", "needed"),
        ({"preset": "ours_second_cuts"}, "training second cuts", "needed"),
        ({"preset": "ours_curvatures"}, "training curvatures", "needed"),
        ({"preset": "ours_preconditioned"}, "preconditioned steps", "needed"),
        ({"preconditioned": True}, "preconditioned steps", "needed"),
        ({"model": "m.ply"}, "densification", "left out"),
        ({"sh_degree": 0}, "SH degree in turn", "left out"),
        ({"background": "white"}, "background", "needed"),
        ({"antialiased": True}, "antialiasing", "needed"),
    ],
)
def test_each_setting_of_a_run_changes_its_line(tmp_path, config, feature, state):
    defaults = {"background": "black", "antialiased": False, "sh_degree": 3}
    write_run(tmp_path, False, **defaults)
    assert stated(describe_features(tmp_path))[feature][0] != state
    write_run(tmp_path, False, **{**defaults, **config})
    found = stated(describe_features(tmp_path))
    assert found[feature][0] == state and "Gaussians" not in found


def test_a_preset_that_is_unknown_is_one_line(tmp_path):
    with pytest.raises(DataError, match='preset "best" is unknown') as caught:
        describe_features(write_run(tmp_path, preset="best"))
    assert "\n" not in str(caught.value)
