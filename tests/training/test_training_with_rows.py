"""Runs whose primitives get slopes, curvatures, cuts or shifts: what they tell and gain, and what becomes of models."""

from collections.abc import Callable
from dataclasses import dataclass, replace
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
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, SECOND_CUTS, SHIFTS, SLOPES
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.wording import in_words
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.initialize import model_to_prune
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.cut_activation import CutRule
from mi_dogsplat.training.strategy.slope_activation import SlopeRule
from mi_dogsplat.training.train import Trainer
from row_kinds import RowKind

STEPS = 120
BASE: dict[str, Any] = {"steps": STEPS, "sh_degree": 1, "log_every": 10, "target": 20, "max_primitives": 60}


@dataclass(frozen=True)
class Kind(RowKind):
    """Rows that a preset gives to primitives, and pictures that need them."""

    given: tuple[str, ...]  # all that the preset gives
    before: str  # the preset that lacks these alone
    comes_with: str  # what happens in the same step
    truth: Callable[[], Splats]
    grown: float  # what some row is longer than at the end of a run
    faint: float  # a number in a row that no pixel shows

    @property
    def preset(self) -> str:
        return f"ours_{self.word}"

    @property
    def activated(self) -> str:
        return f"{self.word}_activated"

    @property
    def said(self) -> str:
        return self.word.replace("_", " ")

    def config(self, data: Path, **changes) -> TrainConfig:
        settings: dict[str, Any] = {**BASE, "preset": self.preset, **changes}
        return TrainConfig(str(data), **settings)


SLOPED = Kind(
    "slopes", SLOPES, ("slopes",), "ours", "dog_activated", tiny_data.sloped_truth, 0.1, 0.9 / 255
)
CUT = Kind(
    "cuts", CUTS, ("slopes", "cuts"), "ours_slopes", "slopes_activated", tiny_data.cut_truth, 1, 0.1
)
SECOND_CUT = Kind(
    "second_cuts", SECOND_CUTS, ("slopes", "cuts", "second_cuts"), "ours_preconditioned", "cuts_activated",
    tiny_data.twice_cut_truth, 1, 0.1,
)  # fmt: skip
CURVED = Kind(
    "curvatures", CURVATURES, ("slopes", "curvatures", "cuts", "second_cuts"), "ours_second_cuts", "slopes_activated",
    tiny_data.curved_truth, 0.1, 0.9 / 255,
)  # fmt: skip
SHIFTED = Kind(
    "shifts", SHIFTS, ("slopes", "curvatures", "cuts", "second_cuts", "shifts"), "ours_curvatures", "slopes_activated",
    tiny_data.shifted_truth, 0.05, 1e-5,
)  # fmt: skip

KINDS = SLOPED, CURVED, CUT, SECOND_CUT, SHIFTED


def after(steps: int, trainer: Trainer) -> Trainer:
    while trainer.step_count < steps:
        trainer.step()
    return trainer


@pytest.fixture(scope="module", params=KINDS, ids=lambda kind: kind.word)
def kind(request) -> Kind:
    return request.param


@pytest.fixture(scope="module")
def pictures(kind, tmp_path_factory) -> Path:
    """Of primitives whose colours vary over them, or that have a sharp side."""
    return tiny_data.write_tiny_data(tmp_path_factory.mktemp(kind.word), splats=kind.truth())


def test_a_run_tells_when_they_come_and_how_many_are_left(kind, pictures, tmp_path):
    metrics = mi_dogsplat.runs.run.train(kind.config(pictures), tmp_path / "run")
    rows, splats = history_of(tmp_path / "run"), read_ply(tmp_path / "run" / "point_cloud.ply")
    (come,), (row,) = records(rows, kind.activated), rows_with(rows, kind.activated)
    assert come["count"] == 20 and row["step"] == 72 and records([row], kind.comes_with)  # 18,000 of 30,000 steps
    assert f"{kind.said} activated for 20 primitives" in row["event"]
    for word in kind.given:
        assert all(row[f"n_{word}"] == 20 * (row["step"] >= 72) for row in rows[:-1])
        assert metrics[f"n_{word}"] == getattr(splats, f"n_{word}")
    assert kind.n(splats) > 10
    assert np.linalg.norm(kind.values(splats).reshape(kind.n(splats), -1), axis=1).max() > kind.grown


@pytest.mark.slow
def test_they_bring_the_pictures_nearer_to_what_needs_them(kind, pictures, tmp_path):
    """From one state, before they come, of a model that lacks little else."""
    write_ply(tmp_path / "model.ply", kind.without(kind.truth()))
    changes = {"model": str(tmp_path / "model.ply"), "target": 59, "max_primitives": None, "steps": 200}
    state, found = after(36, Trainer(kind.config(pictures, **changes), load_dataset(pictures))).state(), {}
    for preset in (kind.before, kind.preset):
        trainer = Trainer(kind.config(pictures, **changes | {"preset": preset}), load_dataset(pictures))
        trainer.restore(state)
        assert trainer.optimizer.n == 59 and kind.n(trainer.optimizer.to_splats()) == 0
        list(run_to_end(trainer))
        found[preset] = trainer.training_l1()
    # Found: slopes .22, curvatures .50, cuts .66, second .59; seeds 0 to 2.
    assert found[kind.preset] < 0.8 * found[kind.before]


@pytest.mark.parametrize("kind", [CURVED, SECOND_CUT, SHIFTED], ids=lambda kind: kind.word, indirect=True)
def test_a_checkpoint_of_a_run_that_knew_none_goes_on(kind, pictures):
    """It is past the step at which they come."""
    state = after(80, Trainer(kind.config(pictures, preset=kind.before), load_dataset(pictures))).state()
    assert not any(kind.word[:-1] in name for name in state)
    trainer = Trainer(kind.config(pictures, preset=kind.before), load_dataset(pictures))
    trainer.restore(state)
    rows = list(run_to_end(trainer))
    assert kind.n(trainer.optimizer.to_splats()) == 0 and not records(rows, kind.activated)
    trainer = Trainer(kind.config(pictures), load_dataset(pictures))
    trainer.restore(state)
    assert [record["count"] for record in records(list(run_to_end(trainer)), kind.activated)] == [20]


def test_the_end_leaves_out_what_no_pixel_shows_and_says_so(kind, pictures):
    trainer = after(STEPS, Trainer(kind.config(pictures), load_dataset(pictures)))
    optimizer = trainer.optimizer
    values = optimizer.numpy(kind.name)
    values[[2, 11]] = kind.faint
    optimizer.assign(kind.name, values)
    (event,) = [event for event in trainer.end() if event.kind == f"{kind.word}_left_out"]
    left = len(optimizer.index_of(kind.group))
    gone = 20 - left
    assert event.record == {"kind": event.kind, "count": gone, "left": left} and gone >= 2 and left > 5
    assert event.text == f"{kind.said} left out: {gone}, kept: {left}"
    assert not np.isin([2, 11], optimizer.index_of(kind.group)).any()
    assert trainer.end() == []


@pytest.mark.parametrize("kind", [SLOPED], ids=["slopes"], indirect=True)
def test_slopes_are_left_out_by_their_largest_number_and_nothing_else_is(kind, pictures):
    trainer = after(STEPS, Trainer(kind.config(pictures), load_dataset(pictures)))
    slopes = trainer.optimizer.numpy("color_slopes")
    slopes[[2, 5, 11]] = kind.faint
    slopes[5, 4] = -1.1 / 255
    trainer.optimizer.assign("color_slopes", slopes)
    (event,) = trainer.end()
    assert event.kind == "slopes_left_out"
    shown = np.flatnonzero(np.abs(slopes).max(axis=1) >= 1 / 255)
    np.testing.assert_array_equal(trainer.optimizer.index_of(SLOPES), shown)


@pytest.mark.parametrize("preset", ["ours", "ours_second_cuts"])
def test_a_recipe_without_them_says_nothing_of_them(preset, data, tmp_path):
    metrics = mi_dogsplat.runs.run.train(CURVED.config(data, preset=preset, steps=12), tmp_path)
    for kind in (CURVED, SHIFTED) if preset == "ours_second_cuts" else KINDS:
        name = f"n_{kind.word}"
        assert name not in metrics and not any(name in row for row in history_of(tmp_path))
        assert kind.word[:-1] not in (tmp_path / "history.jsonl").read_text()


@pytest.mark.parametrize(
    ("kind", "gives"),
    [(SLOPED, True), (CURVED, False), (CUT, False), (SECOND_CUT, True), (SHIFTED, True)],
    indirect=["kind"],
)
def test_a_model_that_has_some_keeps_them_and_they_learn(kind, gives, pictures, tmp_path):
    splats, preset = kind.truth(), kind.preset if gives else "ours"
    half = {name: getattr(splats, name)[::2] for name in (kind.group.index, *kind.group.names)}
    write_ply(tmp_path / "model.ply", replace(splats, **half))
    changes = {"model": str(tmp_path / "model.ply"), "target": 50, "max_primitives": None}
    trainer = Trainer(kind.config(pictures, preset=preset, **changes), load_dataset(pictures))
    assert kind.n(trainer.optimizer.to_splats()) == 30
    rows = list(run_to_end(trainer, until=5))
    kept = trainer.optimizer.to_splats()
    assert 15 < kind.n(kept) <= 30 and rows[0][f"n_{kind.word}"] <= 30
    assert not np.isin(kind.values(kept), kind.values(splats)).any()
    rows = list(run_to_end(trainer))
    assert 15 < kind.n(trainer.optimizer.to_splats()) <= (50 if gives else 30)
    assert len(records(rows, kind.activated)) == gives


@pytest.mark.parametrize("steps", [1, 2, 3, 12])
def test_the_shortest_runs_complete_every_phase(steps, data):
    trainer = Trainer(SHIFTED.config(data, steps=steps), load_dataset(data))
    rows = list(run_to_end(trainer))
    assert trainer.optimizer.n == 20 and set(SHIFTED.given) == {kind.word for kind in KINDS}
    for kind in KINDS:
        assert trainer.states[f"{kind.word[:-1].replace('_', '')}activation"].done
        assert [record["count"] for record in records(rows, kind.activated)] == [20]


def test_a_recipe_that_does_not_prune_can_have_slopes_too(data):
    recipe = replace(RECIPES["3dgs"], slopes=SlopeRule(start=15_000))
    trainer = Trainer(SLOPED.config(data, preset="3dgs", steps=30), load_dataset(data), recipe)
    rows = list(run_to_end(trainer))
    assert records(rows, "slopes_activated")[0]["count"] == trainer.optimizer.n > 20


@pytest.mark.slow
def test_cuts_need_no_slopes_and_those_that_come_while_it_densifies_stay_with_their_primitives(data):
    recipe = replace(RECIPES["3dgs"], cuts=CutRule(start=8000))
    trainer = Trainer(CUT.config(data, preset="3dgs", max_primitives=None), load_dataset(data), recipe)
    rows = list(run_to_end(trainer))
    optimizer, (come,) = trainer.optimizer, records(rows, "cuts_activated")
    later = records([row for row in rows if row["step"] > 32], "densified")
    assert sum(record["cloned"] + record["split"] for record in later) > 0
    n_cuts = len(optimizer.index_of(CUTS))
    assert len(optimizer.index_of(SLOPES)) == 0 and 0 < n_cuts <= come["count"] and n_cuts < optimizer.n


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_a_format_without_them_is_refused_in_one_line(kind, name, data, capsys, tmp_path):
    flags, given = ["--preset", kind.preset, "--format", name], in_words([w.replace("_", " ") for w in kind.given])
    result = dogsplat(capsys, "train", data, "-o", tmp_path / "run", *flags)
    problem = f'"{kind.preset}" gives {given} to primitives, and {name} does not hold them'
    assert_one_line(result, "--preset", problem, "use ours, or --format ply")
    with pytest.raises(DataError, match="--preset"):
        kind.config(data, format=name)
    with pytest.raises(ValueError, match=f"gives {given} to primitives, which {name} does not hold"):
        RECIPES[kind.preset].for_format(name)
    assert RECIPES[kind.preset].for_format("ply") is RECIPES[kind.preset]


def test_a_model_that_is_to_end_in_such_a_format_starts_without_them(kind, tmp_path):
    """So in its mean colours, whole, or where it is stored."""
    splats = kind.truth()
    write_ply(tmp_path / "model.ply", splats)
    for name, n in (("ply", kind.n(splats)), ("spz", 0)):
        assert kind.n(model_to_prune(str(tmp_path / "model.ply"), 0.5, name).splats) == n
