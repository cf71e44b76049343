"""Runs whose primitives are cut off: what they tell, what they gain, and what becomes of models that have cuts."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mi_dogsplat.runs.run
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line
from command_line import run as dogsplat
from happenings import records
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.initialize import model_to_prune
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.cut_activation import CutRule
from mi_dogsplat.training.train import Trainer

STEPS = 120


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "ours_cuts", "steps": STEPS, "sh_degree": 1, "log_every": 10}
    base |= {"target": 20, "max_primitives": 60}
    return TrainConfig(str(data), **(base | changes))


def rows_of(run: Path) -> list[dict]:
    return [json.loads(line) for line in (run / "history.jsonl").read_text().splitlines()]


def cut_truth() -> Splats:
    """The truth, larger and each primitive cut off near its centre."""
    model = tiny_data.truth()
    normals = np.random.default_rng(3).normal(0, 6, (model.n_splats, 3))
    rows = {"cut_index": np.arange(model.n_splats), "cut_normals": normals}
    return replace(model, log_scales=model.log_scales + np.log(1.6), **rows)


@pytest.fixture(scope="module")
def cut_data(tmp_path_factory) -> Path:
    """Pictures of primitives with a sharp side."""
    return tiny_data.write_tiny_data(tmp_path_factory.mktemp("cut"), splats=cut_truth())


@pytest.fixture(scope="module")
def trained(cut_data, tmp_path_factory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("runs") / "run"
    return out, mi_dogsplat.runs.run.train(config_of(cut_data), out)


def test_a_run_tells_when_cuts_come_and_how_many_are_left(trained):
    out, metrics = trained
    rows, splats = rows_of(out), read_ply(out / "point_cloud.ply")
    (come,) = records(rows, "cuts_activated")
    (row,) = [row for row in rows if records([row], "cuts_activated")]
    assert come["count"] == 20 and row["step"] == 72 and records([row], "slopes_activated")  # 18,000 of 30,000 steps
    assert "cuts activated for 20 primitives" in row["event"]
    assert all(row["n_cuts"] == row["n_slopes"] == 20 * (row["step"] >= 72) for row in rows[:-1])
    assert metrics["n_cuts"] == splats.n_cuts > 10 and metrics["n_slopes"] == splats.n_slopes
    assert np.linalg.norm(splats.cut_normals, axis=1).max() > 1


def test_cuts_bring_the_pictures_nearer_to_sharp_sides(cut_data):
    """From one state, before DoG, slopes and cuts come."""
    dataset, before = load_dataset(cut_data), Trainer(config_of(cut_data, steps=300), load_dataset(cut_data))
    while before.step_count < 175:
        before.step()
    state, found = before.state(), {}
    for preset in ("ours_slopes", "ours_cuts"):
        trainer = Trainer(config_of(cut_data, steps=300, preset=preset), dataset)
        trainer.restore(state)
        assert trainer.optimizer.n == 20 and trainer.optimizer.n_cuts == 0
        for _ in run_to_end(trainer):
            pass
        found[preset] = trainer.training_l1()
    assert found["ours_cuts"] < 0.95 * found["ours_slopes"]


def test_a_checkpoint_of_a_run_that_knew_no_cuts_goes_on(cut_data):
    """It is that of a run with slopes, past the step at which both come."""
    before = Trainer(config_of(cut_data, preset="ours_slopes"), load_dataset(cut_data))
    while before.step_count < 80:
        before.step()
    state = before.state()
    assert not any("cut" in name for name in state)
    trainer = Trainer(config_of(cut_data, preset="ours_slopes"), load_dataset(cut_data))
    trainer.restore(state)
    rows = list(run_to_end(trainer))
    assert trainer.optimizer.n_cuts == 0 and not records(rows, "cuts_activated")
    trainer = Trainer(config_of(cut_data), load_dataset(cut_data))
    trainer.restore(state)
    assert [record["count"] for record in records(list(run_to_end(trainer)), "cuts_activated")] == [20]


def test_the_end_leaves_out_what_no_pixel_shows_and_says_so(cut_data):
    trainer = Trainer(config_of(cut_data), load_dataset(cut_data))
    while trainer.step_count < STEPS:
        trainer.step()
    normals = trainer.optimizer.numpy("cut_normals")
    normals[[2, 11]] = 0.1
    trainer.optimizer.assign("cut_normals", normals)
    (event,) = [event for event in trainer.end() if event.kind == "cuts_left_out"]
    assert event.record["count"] >= 2 and event.record["left"] == trainer.optimizer.n_cuts > 5
    assert not np.isin([2, 11], trainer.optimizer.cut_index).any()
    assert trainer.end() == []


@pytest.mark.parametrize("preset", ["ours", "ours_slopes"])
def test_a_recipe_without_cuts_says_nothing_of_them(cut_data, tmp_path, preset):
    metrics = mi_dogsplat.runs.run.train(config_of(cut_data, preset=preset, steps=12), tmp_path)
    assert "n_cuts" not in metrics and not any("n_cuts" in row for row in rows_of(tmp_path))
    assert "cut" not in (tmp_path / "history.jsonl").read_text()


@pytest.mark.parametrize("preset", ["ours", "ours_cuts"])
def test_a_model_with_cuts_keeps_them_and_they_learn(cut_data, tmp_path, preset):
    splats = cut_truth()
    half = replace(splats, cut_index=splats.cut_index[::2], cut_normals=splats.cut_normals[::2])
    write_ply(tmp_path / "model.ply", half)
    config = config_of(cut_data, model=str(tmp_path / "model.ply"), target=50, preset=preset, max_primitives=None)
    trainer = Trainer(config, load_dataset(cut_data))
    assert trainer.optimizer.n_cuts == 30
    rows = list(run_to_end(trainer, until=5))
    kept = trainer.optimizer.to_splats()
    assert 15 < kept.n_cuts <= 30 and rows[0]["n_cuts"] <= 30
    assert not np.isin(kept.cut_normals, splats.cut_normals).any()
    rows = list(run_to_end(trainer))
    assert 15 < trainer.optimizer.n_cuts <= (30 if preset == "ours" else 50)
    assert len(records(rows, "cuts_activated")) == (preset == "ours_cuts")


@pytest.mark.parametrize("steps", [1, 2, 3, 12])
def test_the_shortest_runs_complete_every_phase(data, steps):
    trainer = Trainer(config_of(data, steps=steps), load_dataset(data))
    rows = list(run_to_end(trainer))
    assert trainer.optimizer.n == 20 and trainer.states["cutactivation"].done
    assert [record["count"] for record in records(rows, "cuts_activated")] == [20]


def test_cuts_need_no_slopes_and_those_that_come_while_it_densifies_stay_with_their_primitives(data):
    recipe = replace(RECIPES["3dgs"], cuts=CutRule(start=8000))
    trainer = Trainer(config_of(data, preset="3dgs", max_primitives=None), load_dataset(data), recipe)
    rows = list(run_to_end(trainer))
    optimizer, (come,) = trainer.optimizer, records(rows, "cuts_activated")
    later = records([row for row in rows if row["step"] > 32], "densified")
    assert sum(record["cloned"] + record["split"] for record in later) > 0
    assert optimizer.n_slopes == 0 and 0 < optimizer.n_cuts <= come["count"] and optimizer.n_cuts < optimizer.n


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_a_format_without_cuts_is_refused_in_one_line(data, capsys, tmp_path, name):
    flags = ["--preset", "ours_cuts", "--format", name]
    result = dogsplat(capsys, "train", data, "-o", tmp_path / "run", *flags)
    problem = f'"ours_cuts" gives slopes and cuts to primitives, and {name} does not hold them'
    assert_one_line(result, "--preset", problem, "use ours, or --format ply")
    with pytest.raises(DataError, match="--preset"):
        config_of(data, format=name)
    with pytest.raises(ValueError, match=f"slopes and cuts to primitives, which {name} does not hold"):
        RECIPES["ours_cuts"].for_format(name)
    assert RECIPES["ours_cuts"].for_format("ply") is RECIPES["ours_cuts"]


def test_a_model_that_is_to_end_in_such_a_format_starts_whole(tmp_path):
    splats = cut_truth()
    write_ply(tmp_path / "model.ply", splats)
    for name, n_cuts in (("ply", splats.n_cuts), ("spz", 0)):
        assert model_to_prune(str(tmp_path / "model.ply"), 0.5, name).splats.n_cuts == n_cuts
