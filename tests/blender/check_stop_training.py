"""Stop Training: Blender goes on at once, and the training has the time that it needs to save what it has."""

import subprocess
import sys
import time

import bpy
import pytest
from model_files import load

from blender_addon.training import run as training_run
from blender_addon.training import train_operator
from blender_addon.training.run import TrainingRun, can_go_on
from blender_addon.training.work import WORK

SAVES = """
import sys, time
from pathlib import Path
run = Path(sys.argv[sys.argv.index("-o") + 1])
assert "--until-input-ends" in sys.argv
print("ready", flush=True)
sys.stdin.read()
(run / "asked").touch()
while not (run / "go").exists():
    time.sleep(0.01)
(run / "config.json").write_text("{}")
sys.exit(143)
"""
MAKES = "import shutil, sys; shutil.copy({model!r}, sys.argv[4] + '/point_cloud.ply'); print('done')"
IS_DEAF = "import time; print('x', flush=True); time.sleep(600)"


@pytest.fixture
def begun(tmp_path, monkeypatch):
    """Starts a program in the place of a training, which is the one at work."""
    monkeypatch.setattr(train_operator, "tell", lambda _, trouble: pytest.fail(trouble))  # it needs a display
    runs = []

    def begin(program: str) -> TrainingRun:
        (tmp_path / "run").mkdir(exist_ok=True)
        run = TrainingRun([sys.executable, "-c", program], tmp_path, tmp_path / "run", {"steps": "9"}, False)
        runs.append(run)
        while not (tmp_path / "training.log").stat().st_size:
            time.sleep(0.01)
        WORK.begin_training(run, bpy.context.scene)
        return run

    yield begin
    monkeypatch.setattr(training_run, "PATIENCE", 0.2)  # for those that do not listen
    for run in runs:
        run.stop()
    WORK.end_training()


def ask(run: TrainingRun) -> None:
    """Press the button; the training has noticed it afterwards."""
    assert bpy.ops.dogsplat.stop_training() == {"FINISHED"}
    while not (run.folder / "asked").exists():
        time.sleep(0.01)


def looked_after() -> None:
    """As the timer does, until it has nothing to look after."""
    while train_operator.look_after() is not None:
        time.sleep(0.01)


def test_stopping_waits_for_nothing_and_loses_nothing(begun):
    """The training saves after the operator is done, also where it is asked once more."""
    run = begun(SAVES)
    ask(run)
    assert run.works and WORK.busy and not bpy.ops.dogsplat.stop_training.poll()
    assert train_operator.look_after() == train_operator.INTERVAL and not can_go_on(run.folder)
    run.ask_to_stop()
    (run.folder / "go").touch()
    looked_after()
    assert can_go_on(run.folder) and not WORK.busy and not WORK.stopping and WORK.trouble == ""


def test_whoever_leaves_waits_until_a_training_that_stops_is_saved(begun):
    """The add-on is disabled, or another file opened, right after the button."""
    run = begun(SAVES)
    ask(run)
    later = f"import pathlib, time; time.sleep(0.3); pathlib.Path({str(run.folder / 'go')!r}).touch()"
    with subprocess.Popen([sys.executable, "-c", later]):
        train_operator.stop()
    assert can_go_on(run.folder) and not run.works and not WORK.busy


def test_a_training_is_stopped_on_windows_too(begun, monkeypatch):
    """There, all that Python can send to a process ends it at once."""
    for name in ("terminate", "send_signal"):
        monkeypatch.setattr(subprocess.Popen, name, subprocess.Popen.kill)
    run = begun(SAVES)
    ask(run)
    (run.folder / "go").touch()
    looked_after()
    assert can_go_on(run.folder) and run._process.poll() == 143


def test_a_training_that_does_not_listen_is_killed(begun, monkeypatch):
    monkeypatch.setattr(training_run, "PATIENCE", 0.2)
    run = begun(IS_DEAF)
    assert bpy.ops.dogsplat.stop_training() == {"FINISHED"}
    assert run.works
    looked_after()
    assert not run.works and not WORK.busy and WORK.trouble == ""


def test_the_model_is_for_the_scene_that_it_was_trained_for_whatever_its_name(begun, scene, model):
    """And for no other that has this name now."""
    begun(MAKES.format(model=str(model))).wait()
    name, scene.name = scene.name, "Renamed"
    bpy.data.scenes.new(name)
    looked_after()
    assert scene.dogsplat_training.result is not None and WORK.trouble == ""


def test_a_model_is_not_brought_into_what_is_edited(begun, scene, model):
    obj = load(model)
    bpy.ops.object.mode_set(mode="EDIT")
    begun(MAKES.format(model=str(model))).wait()
    assert train_operator.look_after() == train_operator.INTERVAL and obj.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    looked_after()
    assert scene.dogsplat_training.result not in (None, obj)


def test_a_training_that_is_done_by_then_is_imported(begun, model):
    """Its model would be lost otherwise: nothing can go on."""
    run = begun(MAKES.format(model=str(model)))
    run.wait()
    assert bpy.ops.dogsplat.stop_training() == {"FINISHED"}
    looked_after()
    result = bpy.context.scene.dogsplat_training.result
    assert result is not None and len(result.data.vertices) == 150 and not WORK.busy


def test_a_training_begun_anew_gives_up_what_a_stopped_one_has_saved(begun, tmp_path):
    """Else the package would refuse the folder."""
    checkpoint = tmp_path / "run" / "checkpoint" / "state.npz"
    checkpoint.parent.mkdir(parents=True)
    checkpoint.touch()
    begun(IS_DEAF)
    assert not checkpoint.exists()
