"""What a comparison does with the run folder of a method that is there already."""

import argparse
import math
from pathlib import Path

import pytest
from mi_dogsplat.cli.commands import compare as command
from mi_dogsplat.cli.flags import training_config
from mi_dogsplat.compare import method_runs
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.report.run_folder import METRICS
from mi_dogsplat.runs.checkpoint import CHECKPOINT
from mi_dogsplat.runs.resume import require_no_stopped_run
from mi_dogsplat.support.files import write_json
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.presets import RECIPES


@pytest.mark.parametrize("same", [True, False])
def test_a_run_that_was_cut_off_goes_on_and_one_of_another_recipe_begins_anew(tmp_path, monkeypatch, same):
    (tmp_path / CHECKPOINT).parent.mkdir()
    (tmp_path / CHECKPOINT).touch()
    recipe = method_runs.recipe_of(method_runs.METHODS["3dgs"])
    write_json(tmp_path / method_runs.RECIPE, recipe if same else recipe | {"label": "an earlier one"})
    goes_on = []

    def train(config: TrainConfig, out: Path, resume: bool, **others: object) -> None:
        goes_on.append(resume)
        if not resume:
            require_no_stopped_run(out)  # as training does

    monkeypatch.setattr(method_runs, "train", train)
    method_runs.train_method(TrainConfig("photos"), "3dgs", tmp_path, tmp_path / "start")
    assert goes_on == [same] and (tmp_path / CHECKPOINT).exists() == same


@pytest.mark.parametrize("name", ["3dgs", "ours", "ours_early", "mcmc"])
@pytest.mark.parametrize("given", [[], ["--max-world-scale", "inf"]])
def test_all_methods_have_one_limit_of_sizes_whatever_their_presets_have(tmp_path, monkeypatch, capsys, name, given):
    parser = argparse.ArgumentParser()
    command.add_training_flags(parser)
    config = training_config(parser.parse_args(given), preset=command.PRESET, data="photos")
    trained: list[float] = []
    monkeypatch.setattr(method_runs, "train", lambda config, out, **others: trained.append(config.max_world_scale))
    method_runs.train_method(config, name, tmp_path, tmp_path / "start")
    shared = RECIPES["3dgs"].densification.max_world_scale
    assert trained == [math.inf if given else shared]
    parser.print_help()
    said = " ".join(capsys.readouterr().out.split())
    assert f"in all methods, also those that grow by themselves (default: {shared:g}, that of 3dgs; inf: none)" in said


def test_a_run_of_an_earlier_version_is_complete_though_it_did_not_write_down_what_is_usual(tmp_path):
    method = next(method for method in METHODS.values() if method.recipe == RECIPES["ours"])
    recipe = method_runs.recipe_of(method)
    assert recipe["recipe"]["refinement"].pop("growth_gain") == 1.0
    recipe["recipe"]["score"]["curve"] = None  # nor is this one any more
    write_json(tmp_path / method_runs.RECIPE, recipe)
    assert not method_runs.is_complete(tmp_path, method)
    write_json(tmp_path / METRICS, {})
    assert method_runs.is_complete(tmp_path, method)
    recipe["recipe"]["refinement"]["gain"] += 1
    write_json(tmp_path / method_runs.RECIPE, recipe)
    assert not method_runs.is_complete(tmp_path, method)


@pytest.mark.parametrize("masks", [None, "masks"])
@pytest.mark.parametrize("name", ["taming", "radsplat_equal", "ours"])
def test_a_run_by_a_score_that_did_not_heed_masks_is_not_of_this_version_where_there_are_some(
    tmp_path, monkeypatch, name, masks
):
    method = method_runs.METHODS[name]
    write_json(tmp_path / METRICS, {})
    write_json(tmp_path / "config.json", {"masks": masks})
    write_json(tmp_path / method_runs.RECIPE, method_runs.recipe_of(method))  # what a run without masks keeps
    assert method_runs.is_complete(tmp_path, method) == (masks is None or name == "ours")
    kept = []
    monkeypatch.setattr(method_runs, "train", lambda *given, method, **how: kept.append(method))
    method_runs.train_method(TrainConfig("photos", target=100, masks=masks), name, tmp_path, tmp_path / "start")
    write_json(tmp_path / method_runs.RECIPE, kept[0])
    assert method_runs.is_complete(tmp_path, method)
