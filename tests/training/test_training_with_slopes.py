"""Runs whose primitives get slopes: what they tell, what they gain, and what becomes of models that have some."""

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
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.initialize import model_to_prune
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.slope_activation import SlopeRule
from mi_dogsplat.training.train import Trainer

STEPS = 120


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "ours_slopes", "steps": STEPS, "sh_degree": 1, "log_every": 10}
    base |= {"target": 20, "max_primitives": 60}
    return TrainConfig(str(data), **(base | changes))


def rows_of(run: Path) -> list[dict]:
    return [json.loads(line) for line in (run / "history.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def sloped_data(tmp_path_factory) -> Path:
    """Pictures of primitives whose colours vary over them."""
    return tiny_data.write_tiny_data(tmp_path_factory.mktemp("sloped"), splats=tiny_data.sloped_truth())


@pytest.fixture(scope="module")
def trained(sloped_data, tmp_path_factory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("runs") / "run"
    return out, mi_dogsplat.runs.run.train(config_of(sloped_data), out)


def test_a_run_tells_when_slopes_come_and_how_many_are_left(trained):
    out, metrics = trained
    rows, splats = rows_of(out), read_ply(out / "point_cloud.ply")
    (come,) = records(rows, "slopes_activated")
    (row,) = [row for row in rows if records([row], "slopes_activated")]
    assert come["count"] == 20 and row["step"] == 72 and records([row], "dog_activated")  # 18,000 of 30,000 steps
    assert "slopes activated for 20 primitives" in row["event"]
    assert all(row["n_slopes"] == 20 * (row["step"] >= 72) for row in rows[:-1])
    assert metrics["n_slopes"] == splats.n_slopes > 10


def test_slopes_bring_the_pictures_nearer_to_colours_that_vary(sloped_data):
    """From one state, before DoG and slopes come."""
    dataset, before = load_dataset(sloped_data), Trainer(config_of(sloped_data, steps=300), load_dataset(sloped_data))
    while before.step_count < 175:
        before.step()
    state, found = before.state(), {}
    for preset in ("ours", "ours_slopes"):
        trainer = Trainer(config_of(sloped_data, steps=300, preset=preset), dataset)
        trainer.restore(state)
        assert trainer.optimizer.n == 20 and trainer.optimizer.n_slopes == 0
        for _ in run_to_end(trainer):
            pass
        found[preset] = trainer.training_l1()
    assert found["ours_slopes"] < 0.85 * found["ours"]


def test_the_end_leaves_out_what_no_pixel_shows_and_says_so(sloped_data):
    trainer = Trainer(config_of(sloped_data), load_dataset(sloped_data))
    while trainer.step_count < STEPS:
        trainer.step()
    slopes = trainer.optimizer.numpy("color_slopes")
    slopes[[2, 11]] = 0.9 / 255
    trainer.optimizer.assign("color_slopes", slopes)
    expected = np.flatnonzero(np.abs(slopes).max(axis=1) >= 1 / 255)
    (event,) = trainer.end()
    gone = 20 - len(expected)
    assert event.record == {"kind": "slopes_left_out", "count": gone, "left": len(expected)} and gone >= 2
    assert event.text == f"slopes of {gone} primitives left out, {len(expected)} have some"
    np.testing.assert_array_equal(trainer.optimizer.slope_index, expected)
    assert trainer.end() == []


def test_a_recipe_without_slopes_says_nothing_of_them(sloped_data, tmp_path):
    metrics = mi_dogsplat.runs.run.train(config_of(sloped_data, preset="ours", steps=12), tmp_path)
    assert "n_slopes" not in metrics and not any("n_slopes" in row for row in rows_of(tmp_path))
    assert "slope" not in (tmp_path / "history.jsonl").read_text()


@pytest.mark.parametrize("preset", ["ours", "ours_slopes"])
def test_a_model_with_slopes_keeps_them_and_they_learn(sloped_data, tmp_path, preset):
    splats = tiny_data.sloped_truth()
    half = replace(splats, slope_index=splats.slope_index[::2], color_slopes=splats.color_slopes[::2])
    write_ply(tmp_path / "model.ply", half)
    config = config_of(sloped_data, model=str(tmp_path / "model.ply"), target=50, preset=preset, max_primitives=None)
    trainer = Trainer(config, load_dataset(sloped_data))
    assert trainer.optimizer.n_slopes == 30
    rows = list(run_to_end(trainer, until=5))
    kept = trainer.optimizer.to_splats()
    assert 15 < kept.n_slopes <= 30 and rows[0]["n_slopes"] <= 30
    assert not np.isin(kept.color_slopes, splats.color_slopes).any()
    rows = list(run_to_end(trainer))
    assert 15 < trainer.optimizer.n_slopes <= (30 if preset == "ours" else 50)
    assert len(records(rows, "slopes_activated")) == (preset == "ours_slopes")


@pytest.mark.parametrize("steps", [1, 2, 3, 12])
def test_the_shortest_runs_complete_every_phase(data, steps):
    trainer = Trainer(config_of(data, steps=steps), load_dataset(data))
    rows = list(run_to_end(trainer))
    assert trainer.optimizer.n == 20 and trainer.states["slopeactivation"].done
    assert [record["count"] for record in records(rows, "slopes_activated")] == [20]


def test_a_recipe_that_does_not_prune_can_have_slopes_too(data):
    recipe = replace(RECIPES["3dgs"], slopes=SlopeRule(start=15_000))
    trainer = Trainer(config_of(data, preset="3dgs", steps=30), load_dataset(data), recipe)
    rows = list(run_to_end(trainer))
    assert records(rows, "slopes_activated")[0]["count"] == trainer.optimizer.n > 20


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_a_format_without_slopes_is_refused_in_one_line(data, capsys, tmp_path, name):
    flags = ["--preset", "ours_slopes", "--format", name]
    result = dogsplat(capsys, "train", data, "-o", tmp_path / "run", *flags)
    problem = f'"ours_slopes" gives slopes to primitives, and {name} does not hold them'
    assert_one_line(result, "--preset", problem, "use ours, or --format ply")
    with pytest.raises(DataError, match="--preset"):
        config_of(data, format=name)
    with pytest.raises(ValueError, match=f"slopes to primitives, which {name} does not hold"):
        RECIPES["ours_slopes"].for_format(name)
    assert RECIPES["ours_slopes"].for_format("ply") is RECIPES["ours_slopes"]


def test_a_model_that_is_to_end_in_such_a_format_starts_in_its_mean_colours(tmp_path):
    splats = tiny_data.sloped_truth()
    write_ply(tmp_path / "model.ply", splats)
    for name, n_slopes in (("ply", splats.n_slopes), ("spz", 0)):
        assert model_to_prune(str(tmp_path / "model.ply"), 0.5, name).splats.n_slopes == n_slopes
