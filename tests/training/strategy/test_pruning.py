"""Pruning in training: who goes, what the history tells, and every phase in order up to the exact target."""

import copy
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mi_dogsplat.runs.run
import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from happenings import history_of, records, rows_with
from launches import counts_without_compiling
from mi_dogsplat import read_ply, reference, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training import initialize
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.initialize import model_to_prune
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.scheduler import PruningRule
from mi_dogsplat.training.train import Trainer
from small_optimizer import translucent_model
from splat_scenes import random_splats, rounded

STEPS = 120
DECISIONS = ("pruned", "not_pruned", "refined", "dog_activated")


# --- in training ---


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"steps": STEPS, "sh_degree": 1, "log_every": 10, "max_primitives": 100, "target": 0.3}
    return TrainConfig(str(data), **(base | changes))


def test_the_mean_error_is_that_of_the_pictures_of_all_training_views(tmp_path):
    folder = tiny_data.write_tiny_data(tmp_path, n=5, alpha=True)
    trainer = Trainer(config_of(folder), load_dataset(folder))
    errors = [
        np.abs(trainer.picture(view).color - (view.image[..., :3] + (1 - view.image[..., 3:]))).mean()
        for view in trainer.dataset.train
    ]
    assert trainer.background == 1 and len(errors) == 4
    assert trainer.training_l1() == pytest.approx(np.mean(errors), rel=1e-5)


@pytest.mark.parametrize("preset", ["ours", "paper", "released"])
def test_a_run_densifies_prunes_to_the_exact_target_and_then_makes_the_rest_dog(data, tmp_path, preset):
    metrics = mi_dogsplat.runs.run.train(config_of(data, preset=preset), tmp_path)
    rows = history_of(tmp_path)
    prunes, activations = rows_with(rows, "pruned"), rows_with(rows, "dog_activated")
    start = prunes[0]["pruned_from"]
    target = round(0.3 * start)
    assert start > 60 and prunes[-1]["pruned_to"] == rows[-1]["n"] == target
    assert len(prunes) >= 4 and records(prunes, "pruned")[0]["reason"] == "first check"
    scaled = RECIPES[preset].scaled(STEPS)
    assert scaled.pruning and scaled.dog and prunes[0]["step"] == scaled.pruning.start
    assert all("test_psnr" in row for row in prunes + activations)
    assert [row["step"] for row in rows if "test_flip" in row] == list(range(15, STEPS + 1, 15))  # as scheduled
    for row in prunes:
        assert f"prune {row['pruned_from']} -> {row['pruned_to']}: " in row["event"]
        assert 0 < row["train_l1"] < 1 if scaled.pruning.compares else "train_l1" not in row
        assert row["n"] == row["pruned_to"] < row["pruned_from"]
    assert [row["step"] for row in activations] == [scaled.dog.start]
    assert [record["count"] for record in records(rows, "dog_activated")] == [target]
    assert all(row["step"] <= prunes[0]["step"] for row in rows_with(rows, "densified"))
    assert all(row["n_dog"] == 0 for row in rows if row["step"] < scaled.dog.start)
    assert 0 < rows[-1]["n_dog"] <= target
    splats = read_ply(tmp_path / "point_cloud.ply")
    assert metrics["n_dog"] == splats.n_dog > 0 and metrics["n"] == splats.n_splats <= target
    assert not [row for row in rows_with(rows, "refined") if "pruned_to" in row]


@pytest.mark.parametrize("preset", ["ours", "paper", "released"])
@pytest.mark.parametrize("steps", [1, 2, 3, 12])
def test_the_shortest_runs_complete_every_phase(data, preset, steps):
    trainer = Trainer(config_of(data, preset=preset, steps=steps, target=20), load_dataset(data))
    rows = list(run_to_end(trainer))
    assert trainer.optimizer.n == 20 and trainer.states["dogactivation"].done and rows[-1]["step"] == steps
    assert [record["count"] for record in records(rows, "dog_activated")] == [20]


def test_the_baseline_keeps_all_its_primitives_plain(data):
    trainer = Trainer(config_of(data, preset="3dgs", steps=30), load_dataset(data))
    rows = list(run_to_end(trainer))
    assert trainer.optimizer.n_dog == 0 and not records(rows, *DECISIONS) and "pruning" not in trainer.states


def test_a_count_that_densification_does_not_reach_is_an_event_and_no_prune(data):
    trainer = Trainer(config_of(data, steps=12, target=10**6, max_primitives=None), load_dataset(data))
    rows = list(run_to_end(trainer))
    n = trainer.optimizer.n
    (skipped,), (activated,) = records(rows, "not_pruned"), records(rows, "dog_activated")
    assert f" 1,000,000 primitives is not below the {n:,} " in skipped["reason"] and activated["count"] == n


def test_a_recipe_can_take_the_place_of_the_preset(data):
    pruning = PruningRule(division="equal", rounds=5)
    recipe = dataclasses.replace(RECIPES["ours"], pruning=pruning, dog=None)
    trainer = Trainer(config_of(data, max_primitives=60), load_dataset(data), recipe)
    prunes = rows_with(list(run_to_end(trainer)), "pruned")
    n = prunes[0]["pruned_from"]
    shares = [row["pruned_from"] - row["pruned_to"] for row in prunes]
    assert shares[:4] == [round((n - round(0.3 * n)) / 5)] * 4 and trainer.optimizer.n_dog == 0


@pytest.mark.slow
def test_prunes_compile_nothing_once_there_were_two(data):
    trainer = Trainer(config_of(data, preset="paper", steps=180, max_primitives=None), load_dataset(data))
    assert len(counts_without_compiling(trainer, 105, 149)) >= 4


CUTS = (60, 75, 90, 110)


@dataclasses.dataclass
class CutRun:
    """A run to its end, and its state, with what pruning and DoG know, after each of ``CUTS``."""

    rows: list[dict]
    n: int
    states: dict[int, dict[str, np.ndarray]]
    progress: dict[int, list[Any]]


@pytest.fixture(scope="module")
def cut_run(data) -> CutRun:
    trainer, rows, states, progress = Trainer(config_of(data, preset="paper"), load_dataset(data)), [], {}, {}
    for cut in (*CUTS, None):
        rows += run_to_end(trainer, until=cut)
        if cut:
            states[cut] = trainer.state()
            progress[cut] = copy.deepcopy([trainer.states[name] for name in ("pruning", "dogactivation")])
    return CutRun(rows, trainer.optimizer.n, states, progress)


@pytest.mark.parametrize("cut", CUTS)
def test_a_state_from_the_middle_of_the_window_goes_on_with_the_same_decisions(data, cut_run, cut):
    again = Trainer(config_of(data, preset="paper"), load_dataset(data))
    again.restore(cut_run.states[cut])
    assert cut_run.progress[cut][0].begun
    assert [again.states[name] for name in ("pruning", "dogactivation")] == cut_run.progress[cut]
    went_on = rows_with([row for row in cut_run.rows if row["step"] > cut], *DECISIONS)
    resumed = rows_with(list(run_to_end(again)), *DECISIONS)
    if lanes_add_in_turn(mi.variant()):  # else a decision that hangs on the last bit of L1 may come a step later
        assert [(row["step"], row["n"]) for row in resumed] == [(row["step"], row["n"]) for row in went_on]
    assert again.optimizer.n == cut_run.n
    assert bool(resumed) == (cut < 100)  # when the window closes and all become DoG


@pytest.fixture(scope="module")
def densified_start(data) -> tuple[int, dict[str, np.ndarray]]:
    """Primitives and state of the recipe without pruning, after half of its steps."""
    trainer = Trainer(config_of(data, preset="3dgs"), load_dataset(data))
    while trainer.step_count < STEPS // 2:
        trainer.step()
    return trainer.optimizer.n, trainer.state()


@pytest.mark.parametrize("preset", ["ours", "released"])
def test_a_densified_start_of_another_recipe_is_pruned_at_once_and_to_the_target(data, densified_start, preset):
    n, state = densified_start
    trainer = Trainer(config_of(data, preset=preset), load_dataset(data))
    trainer.restore(state)  # that of the other preset, too: a state can be restored again and again
    rows = list(run_to_end(trainer))
    assert rows[0]["step"] == STEPS // 2 and records(rows, "pruned")[0]["before"] == n
    assert trainer.optimizer.n == round(0.3 * n) and trainer.optimizer.n_dog > 0


# --- a model that exists ---


def test_a_model_is_pruned_before_its_first_step_with_the_colours_it_has(data, model, tmp_path):
    steps = 40
    config = config_of(data, preset="paper", model=str(model), target=20, max_primitives=None, steps=steps)
    metrics = mi_dogsplat.runs.run.train(config, tmp_path)
    rows = history_of(tmp_path)
    assert rows[0]["step"] == 0 and rows[0]["event"] == "prune 60 -> 40: first check" and "l1" not in rows[0]
    assert rows[0]["train_l1"] < 0.005  # it is the model that the pictures were made of
    assert rows[-1]["n"] == 20 and rows[-1]["step"] == steps
    assert not records(rows, "densified", "opacity_reset", "sh_degree")
    assert metrics["n_dog"] > 0 and metrics["steps"] == steps
    assert json.loads((tmp_path / "config.json").read_text())["model"] == str(model)


@pytest.mark.parametrize("target", [20, "3kB"])
def test_a_model_to_prune_is_read_and_measured_once(data, model, tmp_path, monkeypatch, target):
    done: list[str] = []

    def noting(name: str) -> Callable:
        original = getattr(initialize, name)
        return lambda *args: done.append(name) or original(*args)

    for name in ("read_model", "FileKind"):
        monkeypatch.setattr(initialize, name, noting(name))
    config = config_of(data, model=str(model), target=target, max_primitives=None, steps=1)
    mi_dogsplat.runs.run.train(config, tmp_path)
    assert done == (["read_model", "FileKind"] if target == "3kB" else ["read_model"])


def test_a_pruned_model_resumes_from_its_checkpoint(data, model, tmp_path):
    config = config_of(data, model=str(model), target=20, max_primitives=None, steps=40, checkpoint_seconds=0.0)
    mi_dogsplat.runs.run.train(config, tmp_path / "whole")

    def stop(row):
        if row["step"] > 15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mi_dogsplat.runs.run.train(config, tmp_path / "parts", stop)
    mi_dogsplat.runs.run.train(config, tmp_path / "parts", resume=True)
    whole, parts = (
        [(row["step"], row["n"]) for row in rows_with(history_of(tmp_path / run), "pruned", "dog_activated")]
        for run in ("whole", "parts")
    )
    assert parts == whole and parts[0][0] == 0 and parts[-1][1] == 20


def test_a_model_with_dog_keeps_it_until_all_become_dog(data, tmp_path):
    splats = tiny_data.truth()
    mixed = dataclasses.replace(
        splats, dog_index=[3, 7], dog_logit_opacities=[0.0, 0.0], dog_log_scales=np.full((2, 3), 0.5)
    )
    write_ply(tmp_path / "m.ply", mixed)
    config = config_of(data, model=str(tmp_path / "m.ply"), target=59, max_primitives=None, steps=40)
    trainer = Trainer(config, load_dataset(data))
    assert trainer.optimizer.n_dog == 2
    rows = list(run_to_end(trainer))
    assert 0 < rows[0]["n_dog"] <= 2 and records(rows, "dog_activated")[0]["count"] == 59


@pytest.mark.parametrize(
    ("n", "target", "words"),
    [
        (0, 0.1, "holds 0 primitives; pruning needs at least 2"),
        (1, 0.1, "holds 1 primitive; pruning needs at least 2"),
        (5, 5, "--target: the target of 5 primitives is not below the 5 that there are"),
        (5, 500, "--target: .* not below the 5"),
        (5, 0.01, "--target: .* of 5 primitives leaves none"),
    ],
)
def test_a_model_that_cannot_be_pruned_says_so_and_leaves_no_folder(data, tmp_path, n, target, words):
    write_ply(tmp_path / "m.ply", translucent_model(n))
    config = config_of(data, model=str(tmp_path / "m.ply"), target=target, max_primitives=None)
    with pytest.raises(DataError, match=words):
        mi_dogsplat.runs.run.train(config, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_quaternions_of_a_model_to_prune_get_length_1_and_turn_as_before(tmp_path):
    splats = rounded(random_splats(5, seed=3, degree=0))
    splats.quats = splats.quats * np.array([1e-3, 1, 1e3, 1e18, 0], np.float32)[:, None]
    write_ply(tmp_path / "m.ply", splats)
    quats = model_to_prune(str(tmp_path / "m.ply"), 0.5).splats.quats
    np.testing.assert_allclose(np.linalg.norm(quats[:4], axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(reference.rotations(quats), reference.rotations(splats.quats), atol=1e-6)
    assert not quats[4].any()
