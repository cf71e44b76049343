"""Training to the size of a file: never above it, bytes divided among primitives, bands and DoG rows."""

import re
from pathlib import Path
from typing import Any

import mi_dogsplat.runs.run
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line
from command_line import run as dogsplat
from happenings import history_of, records, rows_with
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.strategy.compaction import Compaction
from mi_dogsplat.training.train import Trainer
from shifted_models import with_shifts

STEPS = 120


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"steps": STEPS, "sh_degree": 2, "log_every": 10, "max_primitives": 100, "target": "5kB"}
    return TrainConfig(str(data), **(base | changes))


def test_a_sog_whose_tables_outgrow_what_was_foreseen_is_cut_at_the_end(data, tmp_path):
    metrics = mi_dogsplat.runs.run.train(config_of(data, target="7900B", format="sog"), tmp_path)
    path = tmp_path / "point_cloud.sog"
    assert metrics["bytes"] == path.stat().st_size == sum(metrics["bytes_by_part"].values()) <= 7900
    assert read_model(path).splats.n_splats == metrics["n"] > 20


@pytest.mark.parametrize(("name", "size"), [("ply", 6000), ("spz", 1200)])
def test_a_run_ends_with_a_file_of_its_size_and_tells_its_parts(data, tmp_path, name, size):
    metrics = mi_dogsplat.runs.run.train(config_of(data, target=f"{size}B", format=name), tmp_path)
    path = tmp_path / f"point_cloud.{name}"
    assert metrics["bytes"] == path.stat().st_size == sum(metrics["bytes_by_part"].values())
    assert 0.9 * size < metrics["bytes"] <= size
    splats, rows = read_ply(tmp_path / "point_cloud.ply"), history_of(tmp_path)
    assert metrics["n"] == splats.n_splats == rows[-1]["n"] and metrics["n_dog"] == splats.n_dog
    allocated = records(rows, "allocated")
    assert allocated and all(record["bytes"] <= record["budget"] for record in allocated)
    prunes = rows_with(rows, "pruned")
    assert records(prunes, "pruned")[0]["reason"] == "first check" and prunes[0]["file_bytes"] > size
    assert sum(allocated[-1]["degrees"]) == metrics["n"]
    assert "dog" in metrics["bytes_by_part"] or not splats.n_dog
    if name == "ply":
        np.testing.assert_array_equal(np.bincount(splats.sh_degrees, minlength=4), allocated[-1]["degrees"])
    if name == "spz":
        read = read_model(path).splats
        assert read.n_splats == metrics["n"] and read.sh_degree == max(np.flatnonzero(allocated[-1]["degrees"]))


@pytest.mark.usefixtures("ordered")
def test_a_run_that_is_resumed_makes_the_same_choices(data, tmp_path):
    config = config_of(data, format="spz", target="900B", steps=60)
    whole, rows = Trainer(config, load_dataset(data)), []
    states = {}
    for cut in (31, 45, None):  # within the window, and before the last division
        rows += run_to_end(whole, until=cut)
        if cut:
            states[cut] = whole.state()
    for cut, state in states.items():
        again = Trainer(config, load_dataset(data))
        again.restore(state)
        resumed = records(list(run_to_end(again)), "allocated")
        assert resumed and resumed == records([row for row in rows if row["step"] > cut], "allocated")
        np.testing.assert_array_equal(again.optimizer.to_splats().sh_degrees, whole.optimizer.to_splats().sh_degrees)


def test_bytes_may_be_divided_after_the_last_step_of_so_short_a_run(data, tmp_path):
    """Bands go then, and the palette is one for other bands."""
    metrics = mi_dogsplat.runs.run.train(config_of(data, target="5kB", format="sog", steps=1), tmp_path)
    path = tmp_path / "point_cloud.sog"
    assert path.stat().st_size == metrics["bytes"] <= 5000
    rows = history_of(tmp_path)
    assert records(rows, "allocated")[-1]["degrees"][2] < metrics["n"] and records(rows, "quantised")
    read, kept = read_model(path).splats, read_ply(tmp_path / "point_cloud.ply")
    np.testing.assert_array_equal(np.sort(read.logit_opacities), np.sort(kept.logit_opacities))
    assert read.sh_degree == kept.sh_degree


@pytest.mark.parametrize("target", ["5kB", "1MB"])
def test_a_window_that_closes_late_divides_no_bytes_where_the_run_is_resumed(data, target):
    config, dataset = config_of(data, steps=1, target=target), load_dataset(data)
    whole, resumed = Trainer(config, dataset), Trainer(config, dataset)
    whole.begin()
    whole.step()
    resumed.restore(whole.state())
    assert resumed.begin() == [] and resumed.states["compaction"] == whole.states["compaction"]


def test_a_model_is_pruned_to_a_size(data, tmp_path):
    write_ply(tmp_path / "model.ply", tiny_data.dog_model())
    config = config_of(data, model=str(tmp_path / "model.ply"), target="3kB", max_primitives=None, steps=30)
    metrics = mi_dogsplat.runs.run.train(config, tmp_path / "run")
    assert metrics["bytes"] == (tmp_path / "run" / "point_cloud.ply").stat().st_size <= 3000
    assert history_of(tmp_path / "run")[0]["step"] == 0


def test_a_size_that_the_model_does_not_reach_is_an_event_and_it_keeps_all_its_bands(data):
    trainer = Trainer(config_of(data, target="1GB", steps=30), load_dataset(data))
    rows = list(run_to_end(trainer))
    (skipped,) = records(rows, "not_pruned")
    assert "1000000000" in skipped["reason"] and "--max-primitives" in skipped["reason"]
    assert not records(rows, "allocated")
    assert trainer.optimizer.to_splats().sh_degree == 2 and not trainer.optimizer.to_splats().mixed_sh


def test_a_size_that_something_else_has_reached_is_told_in_bytes(data):
    trainer = Trainer(config_of(data, target="1GB", steps=30), load_dataset(data))
    compaction = next(strategy for strategy in trainer.strategies if isinstance(strategy, Compaction))
    state = trainer.states[compaction.name]
    trainer.step_count, state.n_start, state.n_target = compaction.rule.start, 2 * 10**9, 10**9
    (refined,) = compaction.after_step(trainer, state)
    assert refined.text.endswith(" bytes are left, the target is 1000000000")


def test_a_model_that_reaches_its_size_without_what_is_near_cameras_is_told_of_no_flag_of_train(data, tmp_path):
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    pruned = {"model": str(tmp_path / "model.ply"), "max_primitives": None, "near_zone": 2.6}
    trainer = Trainer(config_of(data, **pruned, target="6000B", steps=1), load_dataset(data))
    (skipped,) = records(list(run_to_end(trainer)), "not_pruned")
    assert skipped["reason"].endswith("the target is 6000; it has room for more primitives")


@pytest.mark.parametrize("flags", [["--target", "1MB"], ["--target", "1MB", "--format", "spz"]])
def test_a_model_that_has_the_size_already_is_one_line(data, tmp_path, capsys, flags):
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    result = dogsplat(capsys, "prune", tmp_path / "model.ply", data, "-o", tmp_path / "run", *flags)
    assert_one_line(result, "--target", "1MB", "not below", flags[-1] if len(flags) > 2 else "ply", "model.ply")


@pytest.mark.parametrize("command", ["compare", "ablate"])
def test_comparisons_are_of_numbers_of_primitives(data, tmp_path, capsys, command):
    result = dogsplat(capsys, command, data, "-o", tmp_path / "out", "--target", "2MB")
    assert_one_line(result, "--target", "2MB is the size of a file", "a ratio (0.1, 10%) or a count of primitives")


@pytest.mark.parametrize(
    ("word", "row_bytes", "primitive_bytes", "least"),  # of a primitive: with all that it will get
    [("slopes", 40, 68 + 40, 10), ("curvatures", 28, 68 + 40 + 28 + 2 * 16, 5),
     ("shifts", 52, 68 + 40 + 28 + 2 * 16 + 52, 5)],
    ids=["slopes", "curvatures", "shifts"],
)  # fmt: skip
def test_a_run_that_gives_rows_ends_with_a_file_of_its_size(tmp_path, word, row_bytes, primitive_bytes, least):
    data = tiny_data.write_tiny_data(tmp_path / "data", splats=tiny_data.sloped_truth())
    config = config_of(data, target="7kB", preset=f"ours_{word}", sh_degree=1)
    metrics = mi_dogsplat.runs.run.train(config, tmp_path / "run")
    rows, n = history_of(tmp_path / "run"), getattr(read_ply(tmp_path / "run" / "point_cloud.ply"), f"n_{word}")
    assert 6300 < metrics["bytes"] == sum(metrics["bytes_by_part"].values()) <= 7000
    assert metrics["bytes_by_part"][word] > row_bytes * n
    assert metrics[f"n_{word}"] == n > least
    last = [row for row in rows if records([row], "pruned") and row["step"] <= 70][-1]  # before they come
    assert last["n"] <= 7000 / primitive_bytes and last[f"n_{word}"] == last["n_slopes"] == 0
    (come,) = records(rows, f"{word}_activated")
    assert come["count"] <= last["n"]
    if word == "shifts":  # no primitive that was kept has lost its own but for being faint at the end
        assert n == metrics["n"] - sum(record["count"] for record in records(rows, "shifts_left_out"))


def test_a_model_with_shifts_is_pruned_to_a_size_and_who_stays_keeps_them(data, tmp_path):
    write_ply(tmp_path / "model.ply", with_shifts(tiny_data.dog_model(), every=1))
    config = config_of(data, model=str(tmp_path / "model.ply"), target="4kB", max_primitives=None, steps=30)
    metrics = mi_dogsplat.runs.run.train(config, tmp_path / "run")
    path = tmp_path / "run" / "point_cloud.ply"
    assert 3600 < metrics["bytes"] == path.stat().st_size == sum(metrics["bytes_by_part"].values()) <= 4000
    assert read_ply(path).n_shifts == metrics["n_shifts"] == metrics["n"] < 4000 / (68 + 52)
    assert metrics["bytes_by_part"]["shifts"] > 52 * metrics["n"]


@pytest.mark.parametrize("name", ["ply", "spz"])
def test_a_run_whose_primitives_have_all_faded_says_so(data, tmp_path, name, monkeypatch):
    """Primitives fade for good in the last step; where the file is not a PLY, before they are put on its grids."""
    steps = 30
    trainer = Trainer(config_of(data, format=name, steps=steps), load_dataset(data))
    step = trainer.optimizer.step

    def fading(**how):
        step(**how)
        if trainer.step_count == steps - 1:
            trainer.optimizer.assign("logit_opacities", np.full(trainer.optimizer.n, -20.0))

    monkeypatch.setattr(trainer.optimizer, "step", fading)
    with pytest.raises(DataError, match="the model in training: every primitive has faded.*; check that its images"):
        list(run_to_end(trainer))


@pytest.mark.parametrize(
    ("format", "target", "preset"),
    [("spz", "20B", "ours"), ("sog", "1kB", "ours"), ("ply", "300B", "ours"), ("ply", "700B", "ours_slopes"),
     ("ply", "1.4kB", "ours_shifts")],
)  # fmt: skip
def test_a_file_into_which_nothing_fits_is_refused_before_the_training(data, format, target, preset):
    with pytest.raises(DataError, match="--target.*no primitive fits into .* bytes of .*: one takes .* bytes or more"):
        Trainer(config_of(data, target=target, format=format, preset=preset), load_dataset(data))


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["ours", "ours_slopes", "ours_shifts"])
def test_the_size_that_is_said_to_be_the_least_holds_a_model(data, preset):
    with pytest.raises(DataError) as refused:
        Trainer(config_of(data, target="300B", preset=preset), load_dataset(data))
    least = re.search(r"one takes (\d+) bytes", str(refused.value))
    assert least
    trainer = Trainer(config_of(data, target=f"{least[1]}B", preset=preset, steps=30), load_dataset(data))
    assert list(run_to_end(trainer))[-1]["n"] == 1
