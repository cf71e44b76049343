"""A run that was stopped goes on from its checkpoint as if nothing had happened."""

import json
import re
import shutil
import signal
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import mitsuba as mi
import numpy as np
import pytest
from happenings import history_of, records
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.report.run_folder import read_run
from mi_dogsplat.runs import run
from mi_dogsplat.runs.checkpoint import Checkpoints, load_checkpoint, save_checkpoint
from mi_dogsplat.runs.inputs import PLACES
from mi_dogsplat.runs.own_recipe import LABEL, described
from mi_dogsplat.runs.resume import resume_run
from mi_dogsplat.runs.stopping import Stopped
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.strategy import Strategy
from mi_dogsplat.training.train import Trainer

STEPS = 60
PRESETS = ("3dgs", "ours", "ours_shifts", "released")
"""The third has all that the presets between give to primitives, and preconditioned steps."""


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "3dgs", "steps": STEPS, "sh_degree": 1, "log_every": 10, "max_primitives": 100}
    base["checkpoint_seconds"] = 0.0
    return TrainConfig(str(data), **(base | changes))


ONE_STEP = config_of(Path(), steps=1, near_clip=0.2)


def without_clock(rows: list[dict]) -> list[dict]:
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def assert_same_state(folder: Path, expected: Path) -> None:
    state, other = (load_checkpoint(path / run.CHECKPOINT) for path in (folder, expected))
    assert state.keys() == other.keys()
    for name in state.keys() - {"seconds"}:
        np.testing.assert_array_equal(state[name], other[name], err_msg=name)


@pytest.mark.slow
@pytest.mark.usefixtures("ordered")
@pytest.mark.parametrize("preset", PRESETS)
def test_a_run_stopped_at_several_steps_and_resumed_has_the_bits_of_one_that_was_not(data, whole, tmp_path, preset):
    config = config_of(data, preset=preset)
    for step in (7, 34, 47, 56):  # in densification, pruning, with DoG: neither is a row
        with Interrupt(step), pytest.raises(Stopped, match=f"after step {step} of {STEPS}.*--resume"):
            run.train(config, tmp_path, resume=step > 7)
        assert load_checkpoint(tmp_path / run.CHECKPOINT)["step"] == step
        # a row that came after the checkpoint, and half a row: what a kill leaves
        with open(tmp_path / "history.jsonl", "ab") as history:
            history.write(b'{"step": 59, "seconds": 1, "n": 1, "n_dog": 0}\n{"step": 4, "event": "\xce')
    with pytest.raises(DataError, match="holds a training that was stopped; add --resume .in Python resume=True. to"):
        run.train(config, tmp_path)
    run.train(config, tmp_path, resume=True)

    rows = history_of(tmp_path)
    assert without_clock(rows) == without_clock(history_of(whole[preset]))
    seconds = [row["seconds"] for row in rows]
    assert seconds == sorted(seconds)
    assert_same_state(tmp_path, whole[preset])
    assert (tmp_path / "point_cloud.ply").read_bytes() == (whole[preset] / "point_cloud.ply").read_bytes()


@pytest.fixture(scope="module")
def whole(data, tmp_path_factory) -> dict[str, Path]:
    """Runs that nobody stops, with a checkpoint after every step: writing one changes nothing."""
    folders = {preset: tmp_path_factory.mktemp(preset) for preset in PRESETS}
    for preset, folder in folders.items():
        run.train(config_of(data, preset=preset), folder)
    rows = history_of(folders["ours"])
    assert all(records(rows, kind) for kind in ("densified", "pruned", "dog_activated"))
    rows = history_of(folders["ours_shifts"])
    for word in ("dog", "slopes", "curvatures", "cuts", "second_cuts", "shifts"):
        assert records(rows, f"{word}_activated")[0]["count"] > 0
    return folders


class Interrupt:
    """``with Interrupt(step)``: Ctrl-C arrives in the middle of the step before ``step`` steps are done."""

    def __init__(self, step: int):
        self.step, self.original = step, Trainer.step

    def __enter__(self):
        interrupt_at, original = self.step, self.original

        def step(self: Trainer):
            if self.step_count + 1 == interrupt_at:
                signal.raise_signal(signal.SIGINT)
            return original(self)

        Trainer.step = step

    def __exit__(self, *_):
        Trainer.step = self.original


def test_checkpoints_come_on_time_whatever_the_distance_of_the_rows(data, tmp_path, monkeypatch):
    saved = []
    monkeypatch.setattr(Checkpoints, "save", lambda self, state: saved.append(int(state()["step"])))
    run.train(config_of(data, steps=5, log_every=1000), tmp_path / "often")
    assert saved == [1, 2, 3, 4, 5]
    saved.clear()
    run.train(config_of(data, steps=5, checkpoint_seconds=1e6), tmp_path / "once")
    assert saved == [5]


def test_checkpoints_that_take_long_become_rare(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("mi_dogsplat.runs.checkpoint.time.monotonic", lambda: now[0])

    def slow_state():
        now[0] += 5
        return {"a": np.zeros(1)}

    checkpoints = Checkpoints(tmp_path / "state.npz", 60)
    for elapsed, due in ((59, False), (60, True)):
        now[0] = 100.0 + elapsed
        assert checkpoints.due() == due
    checkpoints.save(slow_state)
    saved_at = now[0]
    for elapsed, due in ((60, False), (249, False), (250, True)):  # 5 s are 2 % of 250 s
        now[0] = saved_at + elapsed
        assert checkpoints.due() == due


def test_a_checkpoint_waits_while_something_is_broken_for_the_row_that_drops_it(data, tmp_path, monkeypatch):
    """Else the time of checkpoints would decide on when it is dropped, and with it on the bits of the run."""
    saved, original = [], Trainer.step

    def step(self):
        if self.step_count == 12:
            self.optimizer.assign("means", np.full((1, 3), np.nan), np.array([3]))
        return original(self)

    monkeypatch.setattr(Trainer, "step", step)
    monkeypatch.setattr(Checkpoints, "save", lambda self, state: saved.append(int(state()["step"])))
    run.train(config_of(data, steps=22), tmp_path)
    assert saved == [*range(1, 13), *range(20, 23)]


def test_a_run_without_a_checkpoint_yet_is_resumed_from_its_beginning(data, whole, tmp_path):
    config = config_of(data)

    def fail(row: dict) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run.train(config, tmp_path, fail)
    assert (tmp_path / "config.json").exists() and not (tmp_path / run.CHECKPOINT).exists()
    run.train(config, tmp_path, resume=True)
    rows, expected = history_of(tmp_path), history_of(whole["3dgs"])
    assert [row["step"] for row in rows] == [row["step"] for row in expected]
    if lanes_add_in_turn(mi.variant()):
        assert without_clock(rows) == without_clock(expected)


def test_two_runs_never_share_a_folder(data, tmp_path):
    def start_another(row):
        with pytest.raises(DataError, match="another process is training in it"):
            run.train(config_of(data, steps=2), tmp_path)

    run.train(config_of(data, steps=2), tmp_path, start_another)


def test_resuming_needs_the_same_settings(data, tmp_path, monkeypatch):
    run.train(config_of(data), tmp_path)
    with pytest.raises(DataError, match="seed was 0 and is 1 now"):
        run.train(config_of(data, seed=1), tmp_path, resume=True)


@pytest.mark.usefixtures("ordered")
def test_a_run_goes_on_with_its_images_on_disk_to_the_same_bits(data, whole, tmp_path):
    """As it may need to, if it was killed for its memory."""
    with Interrupt(34), pytest.raises(Stopped):
        run.train(config_of(data, preset="ours"), tmp_path)
    run.train(config_of(data, preset="ours", data_on_disk=True), tmp_path, resume=True)
    assert (tmp_path / "point_cloud.ply").read_bytes() == (whole["ours"] / "point_cloud.ply").read_bytes()
    assert without_clock(history_of(tmp_path)) == without_clock(history_of(whole["ours"]))


@pytest.fixture(scope="module")
def begun(data, tmp_path_factory):
    """A run of one step, whose data were named by a relative path, and the folder that this is relative to."""
    folder = tmp_path_factory.mktemp("begun")
    shutil.copytree(data, folder / "photos")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run.train(replace(ONE_STEP, data="photos"), Path("run"))
    return folder


@pytest.mark.parametrize("place, name", [
    (".", "photos/"), (".", "./photos"), (".", "{folder}/photos"), ("photos", "../photos"), (".", "link"),
])  # fmt: skip
def test_data_are_the_same_however_they_are_named(begun, monkeypatch, place, name):
    if name == "link":
        (begun / name).symlink_to(begun / "photos")
    monkeypatch.chdir(begun / place)
    assert resumes(replace(ONE_STEP, data=name.format(folder=begun)), begun / "run")


def test_other_data_of_the_same_name_are_refused(begun, monkeypatch, tmp_path):
    shutil.copytree(begun / "photos", tmp_path / "photos")
    monkeypatch.chdir(tmp_path)
    for data in ("photos", str(tmp_path / "photos")):
        with pytest.raises(DataError, match=f"data was photos and is {re.escape(data)} now"):
            resumes(replace(ONE_STEP, data=data), begun / "run")


def test_data_may_move_with_their_run_and_runs_of_older_versions_go_on(begun, monkeypatch, tmp_path):
    """Which did not keep where their data were."""
    shutil.copytree(begun / "run", tmp_path / "run")
    shutil.copytree(begun / "photos", tmp_path / "photos")
    places = tmp_path / "run" / PLACES
    places.write_text(places.read_text().replace(str(begun), str(begun / "gone")))
    monkeypatch.chdir(tmp_path)
    assert resumes(replace(ONE_STEP, data="photos"), tmp_path / "run")
    places.unlink()
    for data in ("photos", "photos/", str(tmp_path / "photos")):
        assert resumes(replace(ONE_STEP, data=data), tmp_path / "run")
    with pytest.raises(DataError, match="data was photos and is run now"):
        resumes(replace(ONE_STEP, data="run"), tmp_path / "run")


def test_a_run_that_is_killed_before_it_has_noted_its_data_goes_on_where_another_run_was(begun, monkeypatch, tmp_path):
    """Else the settings would be its own, and the place that of the other's data."""
    shutil.copytree(begun / "run", tmp_path / "run")
    shutil.copytree(begun / "photos", tmp_path / "others")
    config = replace(ONE_STEP, data=str(tmp_path / "others"))

    def killed(*_):
        raise ZeroDivisionError

    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr(run, "note_inputs", killed)
        run.train(config, tmp_path / "run")
    assert run.train(config, tmp_path / "run", resume=True)["steps"] == 1


def test_a_run_goes_on_with_the_recipe_that_it_began_with_and_no_other(data, tmp_path):
    """Without ``recipe=`` it went on with that of its preset, and said nothing."""
    config, own = replace(ONE_STEP, data=str(data)), replace(RECIPES["3dgs"], also=(Faint(0.5),))
    other = replace(own, also=(Faint(0.25),))
    of_a_method = {"label": "3DGS, 100 %", "recipe": {}}
    run.train(config, tmp_path, recipe=own)
    assert read_run(tmp_path).method == LABEL
    for recipe, words in (
        (None, "was trained by a recipe of its own and is to go on with the recipe of its preset"),
        (described(other), "was trained by another recipe than this one"),
        (described(replace(own, also=(Fainter(0.5),))), "was trained by another recipe than this one"),
        (of_a_method, "was trained by a recipe of its own and is to go on with 3DGS, 100 %"),
    ):
        with pytest.raises(DataError, match=words):
            resumes(config, tmp_path, recipe)
    with pytest.raises(DataError, match="the recipe of its preset; resume with the recipe of the run"):
        run.train(config, tmp_path, resume=True)
    assert resumes(config, tmp_path, described(own))

    run.train(config, tmp_path)  # in the same folder, by its preset
    assert read_run(tmp_path).method == "preset 3dgs" and resumes(config, tmp_path)
    with pytest.raises(DataError, match="the recipe of its preset and is to go on with a recipe of its own"):
        resumes(config, tmp_path, described(own))


@dataclass(frozen=True)
class Faint(Strategy[None]):
    """Does nothing, with a number."""

    pull: float


class Fainter(Faint):
    """Another one."""


def resumes(config, out, recipe=None) -> bool:
    """Whether a run goes on at its step; its data are read all the same."""
    trainer = SimpleNamespace(config=config, step_count=0, ended=False)
    trainer.restore = lambda state: setattr(trainer, "step_count", int(state["step"]))
    resume_run(cast(Trainer, trainer), out, recipe)
    return trainer.step_count == 1


def test_resuming_without_a_checkpoint_says_so(data, tmp_path):
    with pytest.raises(DataError, match="there is no checkpoint"):
        run.train(config_of(data), tmp_path / "new", resume=True)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a zip", b"\x00" * 200])
def test_a_damaged_checkpoint_says_so(tmp_path, content):
    (tmp_path / "state.npz").write_bytes(content)
    with pytest.raises(DataError, match="not a readable checkpoint"):
        load_checkpoint(tmp_path / "state.npz")


def test_a_truncated_checkpoint_says_so(tmp_path):
    path = tmp_path / "state.npz"
    save_checkpoint(path, {"a": np.arange(1000.0)})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataError, match="not a readable checkpoint"):
        load_checkpoint(path)


def test_a_checkpoint_of_another_kind_of_run_says_so(data, tmp_path):
    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "config.json").write_text("{}")
    save_checkpoint(tmp_path / "checkpoint" / "state.npz", {"a": np.arange(3)})
    with pytest.raises(DataError, match="does not fit this run"):
        run.train(config_of(data), tmp_path, resume=True)


@pytest.mark.parametrize("another", [False, True])
def test_other_training_views_than_those_that_it_began_with_are_refused(data, tmp_path, another):
    """One that has gone ended with a traceback; with one more, it went on without a word."""
    folder = shutil.copytree(data, tmp_path / "photos")
    with Interrupt(3), pytest.raises(Stopped):
        run.train(config_of(folder), tmp_path / "run")
    cameras = json.loads((folder / "transforms.json").read_text())
    frames = cameras["frames"]
    if another:
        shutil.copy(folder / frames[1]["file_path"], folder / "another.png")
        frames.insert(2, frames[1] | {"file_path": "another.png"})
    else:
        del frames[1]
    (folder / "transforms.json").write_text(json.dumps(cameras))
    with pytest.raises(DataError, match="training views are not those of the data now"):
        run.train(config_of(folder), tmp_path / "run", resume=True)


def test_primitives_that_can_never_be_seen_are_left_out_of_the_model(data, tmp_path, monkeypatch):
    original = SplatOptimizer.to_splats

    def with_ghosts(self):
        splats = original(self)
        splats.logit_opacities[:5] = -20
        return splats

    monkeypatch.setattr(SplatOptimizer, "to_splats", with_ghosts)
    metrics = run.train(config_of(data, steps=10), tmp_path)
    assert metrics["n"] == history_of(tmp_path)[-1]["n"] - 5
