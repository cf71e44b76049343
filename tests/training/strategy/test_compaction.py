"""Training to the size of a file: never above it, bytes divided among primitives, bands and DoG rows."""

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
from happenings import records, rows_with
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.sizes import Prices
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.bands import Bands
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.strategy.compaction import as_chosen
from mi_dogsplat.training.strategy.options import Options, Rows
from mi_dogsplat.training.train import Trainer
from splat_scenes import random_splats, rounded

STEPS = 120


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return tiny_data.write_tiny_data(tmp_path_factory.mktemp("data"))


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"steps": STEPS, "sh_degree": 2, "log_every": 10, "max_primitives": 100, "target": "5kB"}
    return TrainConfig(str(data), **(base | changes))


def rows_of(run: Path) -> list[dict]:
    return [json.loads(line) for line in (run / "history.jsonl").read_text().splitlines()]


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
    splats, rows = read_ply(tmp_path / "point_cloud.ply"), rows_of(tmp_path)
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


def test_a_run_that_is_resumed_makes_the_same_choices(data, tmp_path):
    config = config_of(data, format="spz", target="1500B")
    whole, rows = Trainer(config, load_dataset(data)), []
    states = {}
    for cut in (65, 90, None):
        rows += run_to_end(whole, until=cut)
        if cut:
            states[cut] = whole.state()
    for cut, state in states.items():
        again = Trainer(config, load_dataset(data))
        again.restore(state)
        resumed = records(list(run_to_end(again)), "allocated")
        assert resumed == records([row for row in rows if row["step"] > cut], "allocated")
        np.testing.assert_array_equal(again.optimizer.to_splats().sh_degrees, whole.optimizer.to_splats().sh_degrees)


def test_a_model_is_pruned_to_a_size(data, tmp_path):
    write_ply(tmp_path / "model.ply", tiny_data.dog_model())
    config = config_of(data, model=str(tmp_path / "model.ply"), target="3kB", max_primitives=None)
    metrics = mi_dogsplat.runs.run.train(config, tmp_path / "run")
    assert metrics["bytes"] == (tmp_path / "run" / "point_cloud.ply").stat().st_size <= 3000
    assert rows_of(tmp_path / "run")[0]["step"] == 0


def test_a_size_that_the_model_does_not_reach_is_an_event_and_it_keeps_all_its_bands(data):
    trainer = Trainer(config_of(data, target="1GB"), load_dataset(data))
    (skipped,) = records(list(run_to_end(trainer)), "not_pruned")
    assert "1000000000" in skipped["reason"] and not records(list(run_to_end(trainer)), "allocated")
    assert trainer.optimizer.to_splats().sh_degree == 2 and not trainer.optimizer.to_splats().mixed_sh


@pytest.mark.parametrize("flags", [["--target", "1MB"], ["--target", "1MB", "--format", "spz"]])
def test_a_model_that_has_the_size_already_is_one_line(data, tmp_path, capsys, flags):
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    result = dogsplat(capsys, "prune", tmp_path / "model.ply", data, "-o", tmp_path / "run", *flags)
    assert_one_line(result, "--target", "1MB", "not below", flags[-1] if len(flags) > 2 else "ply", "model.ply")


@pytest.mark.parametrize("command", ["compare", "ablate"])
def test_comparisons_are_of_numbers_of_primitives(data, tmp_path, capsys, command):
    result = dogsplat(capsys, command, data, "-o", tmp_path / "out", "--target", "2MB")
    assert_one_line(result, "--target", "2MB is the size of a file", "a ratio or a number of primitives")


# --- what is chosen ---


def options_of(removal, by_degree, without_dog, splats: Splats, without_slopes=None, without_cuts=None) -> Options:
    whole = splats.uniform_sh()
    nothing = [np.zeros(splats.n_splats)] * (whole.sh_coeffs.shape[1] * (whole.sh_coeffs.shape[1] + 1) // 2)
    bands = Bands(whole.sh_coeffs, nothing)
    losses = {"dog_index": without_dog, "slope_index": without_slopes, "cut_index": without_cuts}
    rows = []
    for index, loss in losses.items():
        has = np.isin(np.arange(splats.n_splats), getattr(splats, index))
        rows.append(Rows(has, np.zeros(splats.n_splats) if loss is None else np.array(loss)))
    return Options(np.array(removal), np.array(by_degree), splats.sh_degrees, *rows, bands)


def four() -> Splats:
    """Of degrees 1, 1, 1, 0; the first two are DoG."""
    splats = rounded(random_splats(4, seed=0, degree=1, dog_share=0))
    dog = {"dog_index": [0, 1], "dog_logit_opacities": [0.0, 1.0], "dog_log_scales": np.zeros((2, 3))}
    arrays = {name: getattr(splats, name) for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")}
    return Splats(**arrays, **dog).with_sh_degrees([1, 1, 1, 0])


PRICES = Prices(10.0, (100.0, 150.0, 200.0, 300.0), 20.0)
LOSSES = ([9, 5, 4, 1.0], [[4, 0], [0.1, 0], [0.1, 0], [0, 0.0]], [3, 0.01, 0, 0.0])


@pytest.mark.parametrize(
    ("budget", "kept", "degrees", "dog"),
    [
        (1000, [0, 1, 2, 3], [1, 1, 1, 0], [0, 1]),  # all of it
        (485, [0, 1, 2, 3], [1, 0, 0, 0], [0]),  # bands and rows that hardly matter go first
        (385, [0, 1, 2], [1, 0, 0], [0]),  # then the last primitive
        (285, [0, 1], [1, 0], [0]),
        (60, [], [], []),
    ],
)
def test_bytes_go_where_they_gain_most(budget, kept, degrees, dog):
    chosen = options_of(*LOSSES, four()).chosen(PRICES, budget)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.degrees, degrees)
    np.testing.assert_array_equal(chosen.dog, dog)


SLOPED = Prices(10.0, (100.0, 150.0, 200.0, 300.0), 20.0, 40.0)


def four_sloped() -> Splats:
    """The same, all but the second with slopes."""
    rng = np.random.default_rng(0)
    return replace(four(), slope_index=[0, 2, 3], color_slopes=rng.normal(size=(3, 3, 3)))


@pytest.mark.parametrize(
    ("budget", "kept", "degrees", "dog", "slopes"),
    [
        (1000, [0, 1, 2, 3], [1, 1, 1, 0], [0, 1], [0, 2, 3]),  # all of it
        (665, [0, 1, 2, 3], [1, 1, 1, 0], [0], [0, 2]),  # what hardly matters goes first
        (565, [0, 1, 2, 3], [1, 0, 0, 0], [0], [0, 2]),
        (525, [0, 1, 2, 3], [1, 0, 0, 0], [0], [0]),
        (425, [0, 1, 2], [1, 0, 0], [0], [0]),  # then the last primitive, before slopes that matter
    ],
)
def test_slopes_go_where_they_gain_least_for_their_bytes(budget, kept, degrees, dog, slopes):
    options = options_of([9, 5, 4, 3.0], *LOSSES[1:], four_sloped(), without_slopes=[2.0, 0, 0.5, 0.02])
    chosen = options.chosen(SLOPED, budget)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.degrees, degrees)
    np.testing.assert_array_equal(chosen.dog, dog)
    np.testing.assert_array_equal(chosen.slopes, slopes)
    model = as_chosen(four_sloped(), options, chosen)
    np.testing.assert_array_equal(model.slope_index, slopes)
    expected = four_sloped().color_slopes[np.searchsorted([0, 2, 3], slopes)]
    np.testing.assert_array_equal(model.color_slopes, expected)


PRICED = Prices(10.0, (100.0, 150.0, 200.0, 300.0), 20.0, 40.0, 30.0)


def four_cut(sloped: bool) -> Splats:
    """Four, all but the third cut off."""
    normals = np.random.default_rng(1).normal(size=(3, 3))
    return replace(four_sloped() if sloped else four(), cut_index=[0, 1, 3], cut_normals=normals)


@pytest.mark.parametrize("sloped", [False, True])
@pytest.mark.parametrize(
    ("budget", "kept", "cuts"),
    [
        (1e9, [0, 1, 2, 3], [0, 1, 3]),  # all of it
        (655, [0, 1, 2, 3], [0, 1]),  # what hardly matters goes first
        (515, [0, 1, 2, 3], [0]),
        (410, [0, 1, 2], [0]),  # then the last primitive, before a cut that matters
    ],
)
def test_cuts_go_where_they_gain_least_for_their_bytes(sloped, budget, kept, cuts):
    splats = four_cut(sloped)
    without_slopes = [2.0, 0, 1.8, 1.7] if sloped else None  # more for their bytes than any cut
    options = options_of([9, 6, 5, 3.0], *LOSSES[1:], splats, without_slopes, [1.5, 0.2, 0, 0.05])
    chosen = options.chosen(PRICED, budget + 40 * (len(kept) - 1) * sloped)
    np.testing.assert_array_equal(chosen.kept, kept)
    np.testing.assert_array_equal(chosen.cuts, cuts)
    np.testing.assert_array_equal(chosen.slopes, np.intersect1d(splats.slope_index, kept))
    model = as_chosen(splats, options, chosen)
    np.testing.assert_array_equal(model.cut_index, cuts)
    np.testing.assert_array_equal(model.cut_normals, splats.cut_normals[np.searchsorted([0, 1, 3], cuts)])


def test_slopes_that_are_to_come_cost_what_they_will_and_are_not_given_up():
    losses = [np.inf, 0, np.inf, np.inf]
    chosen = options_of(*LOSSES, four_sloped(), without_slopes=losses).chosen(SLOPED, 10 + 3 * 140 + 100)
    assert chosen.kept.tolist() == [0, 1, 2] and chosen.slopes.tolist() == [0, 2]


def test_a_run_with_slopes_ends_with_a_file_of_its_size(tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", splats=tiny_data.sloped_truth())
    config = config_of(data, target="7kB", preset="ours_slopes", sh_degree=1)
    metrics = mi_dogsplat.runs.run.train(config, tmp_path / "run")
    rows, splats = rows_of(tmp_path / "run"), read_ply(tmp_path / "run" / "point_cloud.ply")
    assert 6300 < metrics["bytes"] == sum(metrics["bytes_by_part"].values()) <= 7000
    assert metrics["bytes_by_part"]["slopes"] > 40 * splats.n_slopes
    assert metrics["n_slopes"] == splats.n_slopes > 10
    last = [row for row in rows if records([row], "pruned") and row["step"] <= 70][-1]  # before slopes come
    assert last["n"] <= 7000 / (68 + 40) and last["n_slopes"] == 0
    (come,) = records(rows, "slopes_activated")
    assert come["count"] <= last["n"]


def test_a_run_with_cuts_ends_with_a_file_of_its_size(tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", splats=tiny_data.sloped_truth())
    config = config_of(data, target="7kB", preset="ours_cuts", sh_degree=1)
    metrics = mi_dogsplat.runs.run.train(config, tmp_path / "run")
    rows, splats = rows_of(tmp_path / "run"), read_ply(tmp_path / "run" / "point_cloud.ply")
    assert 6300 < metrics["bytes"] == sum(metrics["bytes_by_part"].values()) <= 7000
    assert metrics["bytes_by_part"]["cuts"] > 16 * splats.n_cuts
    assert metrics["n_cuts"] == splats.n_cuts > 5
    last = [row for row in rows if records([row], "pruned") and row["step"] <= 70][-1]  # before cuts come
    assert last["n"] <= 7000 / (68 + 40 + 16) and last["n_cuts"] == last["n_slopes"] == 0
    (come,) = records(rows, "cuts_activated")
    assert come["count"] <= last["n"]


def test_a_degree_does_not_rise():
    options = options_of([9, 9, 9, 9.0], np.array([[1, -5.0]] * 4), np.zeros(4), four())
    assert options.chosen(PRICES, 1e9).degrees.tolist() == [1, 1, 1, 0]


def test_at_the_end_whole_primitives_go_and_the_outermost_stay():
    splats = four()
    splats.means[:] = [[0, 0, 0.5], [1, 1, 1], [-1, 0, 2], [0.5, -3, 0]]  # the first is in the middle
    options = options_of(*LOSSES, splats).of_whole_primitives(splats.means)
    everything = options.chosen(PRICES, 1e9)
    assert everything.degrees.tolist() == [1, 1, 1, 0] and everything.dog.tolist() == [0, 1]
    fewer = options.chosen(PRICES, 10 + 100 + 150 + 170)
    assert fewer.kept.tolist() == [1, 2, 3] and fewer.degrees.tolist() == [1, 1, 0] and fewer.dog.tolist() == [0]


def test_the_model_of_a_choice_has_what_was_chosen():
    splats, options = four(), options_of(*LOSSES, four())
    result = as_chosen(splats, options, options.chosen(PRICES, 385))
    np.testing.assert_array_equal(result.means, splats.means[:3])
    assert result.sh_degrees.tolist() == [1, 0, 0] and result.dog_index.tolist() == [0]
    assert result.dog_logit_opacities.tolist() == [0.0]
    np.testing.assert_array_equal(result.uniform_sh().sh_coeffs[0], splats.uniform_sh().sh_coeffs[0])


@pytest.mark.parametrize("name", ["ply", "spz"])
def test_a_run_whose_primitives_have_all_faded_says_so(data, tmp_path, name, monkeypatch):
    """Primitives fade for good in the last step; where the file is not a PLY, before they are put on its grids."""
    trainer = Trainer(config_of(data, format=name), load_dataset(data))
    step = trainer.optimizer.step

    def fading(**how):
        step(**how)
        if trainer.step_count == STEPS - 1:
            trainer.optimizer.assign("logit_opacities", np.full(trainer.optimizer.n, -20.0))

    monkeypatch.setattr(trainer.optimizer, "step", fading)
    with pytest.raises(DataError, match="the model in training: every primitive has faded.*; check that its images"):
        list(run_to_end(trainer))


def test_a_file_into_which_nothing_fits_is_refused(data):
    trainer = Trainer(config_of(data, target="20B", format="spz"), load_dataset(data))
    with pytest.raises(DataError, match="--target.*no primitive fits"):
        list(run_to_end(trainer))
