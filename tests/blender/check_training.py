"""From a scene to a model in its place: the training, how it ends, and the panel."""

import json
import shutil
import sys
import time
from pathlib import Path
from types import MethodType, SimpleNamespace

import bpy
import numpy as np
import pytest
from blender_pictures import psnr
from drawn_panels import Layout
from mathutils import Matrix, Vector
from training_scene import CENTER, folder_of

from blender_addon.cameras.json_object import read_json_object
from blender_addon.package import renderers
from blender_addon.package.served import RendererError
from blender_addon.training import render_operator, train_operator
from blender_addon.training import run as training_run
from blender_addon.training.panel import DOGSPLAT_PT_train
from blender_addon.training.render_jobs import RenderJobs
from blender_addon.training.render_operator import DOGSPLAT_OT_render_views
from blender_addon.training.rig_operator import make_rig
from blender_addon.training.run import TrainingRun, can_go_on
from blender_addon.training.work import WORK


def seen_by(scene, location, folder):
    """[H, W, 3] of sRGB values over black, from a place that looks at the subject."""
    direction = (Vector(CENTER) - Vector(location)).to_track_quat("-Z", "Y")
    camera = bpy.data.objects.new("New", bpy.data.cameras.new("New"))
    scene.collection.objects.link(camera)
    camera.matrix_world = Matrix.LocRotScale(Vector(location), direction, None)
    scene.camera = camera
    render = scene.render
    render.resolution_x = render.resolution_y = 48
    render.film_transparent, render.image_settings.file_format = True, "PNG"
    scene.view_settings.view_transform, render.filepath = "Standard", str(folder / "seen.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    pixels = np.array(image.pixels[:]).reshape(48, 48, 4)
    bpy.data.images.remove(image)
    return pixels[..., :3] * pixels[..., 3:]


def middle(picture):
    """Row and column [2] of what is brighter than half of the picture's maximum, its mean."""
    return np.argwhere(picture.max(axis=2) > picture.max() / 2).mean(axis=0)


def test_from_a_scene_to_a_model_in_its_place(subject, scene, tmp_path):
    """Cameras, views, a training that is stopped and goes on, and a picture from where no camera was."""
    assert bpy.ops.dogsplat.make_cameras() == {"FINISHED"}
    assert bpy.ops.dogsplat.render_views() == {"FINISHED"}
    content = read_json_object(folder_of(scene) / "transforms.json")
    assert len(content["frames"]) == 14 and len(content["test_filenames"]) == 2
    run = train_operator.start(bpy.context, resume=False)
    while run.works and run.step < 5:
        time.sleep(0.02)
    run.stop()
    assert not run.works and 5 <= run.step < 200 and can_go_on(run.folder)
    assert bpy.ops.dogsplat.train(resume=True) == {"FINISHED"}
    steps = [json.loads(line)["step"] for line in (run.folder / "history.jsonl").read_text().splitlines()]
    assert steps == sorted(set(steps)) and steps[-1] == 200 and not can_go_on(run.folder)
    result = scene.dogsplat_training.result
    assert result.name == "Ball Splats" and result == bpy.context.object
    assert subject.hide_render and subject.hide_get() and not bpy.data.objects["Small"].hide_render

    for name in ("Small", "Wall"):
        bpy.data.objects[name].hide_render = True
    place = (3.5, 0.2, 1.8)
    trained = seen_by(scene, place, tmp_path)
    result.hide_render, subject.hide_render = True, False
    original = seen_by(scene, place, tmp_path)
    assert original.std() > 0.1 and psnr(trained, original) > 17
    assert np.abs(middle(trained) - middle(original)).max() < 0.5  # pixels, of 32 that the ball is wide


def a_data_set(scene):
    (folder_of(scene) / "images").mkdir(parents=True)
    (folder_of(scene) / "transforms.json").write_text('{"frames": []}')


@pytest.mark.parametrize("words, message", [
    ((str(Path("/no/such/dogsplat")),), "/no/such/dogsplat cannot be started"),
    ((sys.executable, "-c", "import sys; sys.exit('dogsplat: data: broken; mend it')"), "data: broken; mend it"),
    ((sys.executable, "-c", "import sys; sys.exit(3)"), "ended with status 3; see"),
])  # fmt: skip
def test_a_training_that_fails_says_why_in_one_line(subject, scene, monkeypatch, words, message):
    monkeypatch.setattr(train_operator, "process_words", lambda command: list(words))
    a_data_set(scene)
    with pytest.raises(RuntimeError, match=message) as caught:
        bpy.ops.dogsplat.train()
    assert len(str(caught.value).strip().splitlines()) == 1 and not WORK.busy


@pytest.mark.parametrize("command, message", [("", "pip install"), ("/no/such/dogsplat", "correct or clear it")])
def test_a_missing_command_is_said_in_one_line(subject, scene, monkeypatch, command, message):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(train_operator, "process_words", lambda words: renderers.process_words(command))
    a_data_set(scene)
    with pytest.raises(RuntimeError, match=message) as caught:
        bpy.ops.dogsplat.train()
    assert len(str(caught.value).strip().splitlines()) == 1


def test_render_and_train_says_in_one_line_that_no_training_starts(subject, scene, monkeypatch):
    """Whether a script waits for it, or Blender's own jobs are done."""
    monkeypatch.setattr(train_operator, "process_words", lambda command: ["/no/such/dogsplat"])
    a_data_set(scene)
    done = SimpleNamespace(frames=[], done=0, advance=lambda: False, complete=lambda: None, close=lambda: None)
    monkeypatch.setattr(render_operator, "Rendering", lambda context: done)
    with pytest.raises(RuntimeError, match="/no/such/dogsplat cannot be started") as caught:
        bpy.ops.dogsplat.render_views(train=True)
    assert len(str(caught.value).strip().splitlines()) == 1
    said = []
    operator = modal_operator(said, train=True)
    jobs = SimpleNamespace(rendering=done, tick=lambda: False, stopped=False, close=lambda: None)
    monkeypatch.setattr(WORK, "rendering", jobs)
    assert DOGSPLAT_OT_render_views.modal(operator, a_window(), SimpleNamespace(type="TIMER")) == {"CANCELLED"}
    assert said[-1][0] == {"ERROR"} and said[-1][1].startswith("/no/such/dogsplat") and "\n" not in said[-1][1]


def test_an_error_that_nobody_expects_gives_the_settings_back(monkeypatch):
    closed, timers = [], []
    jobs = SimpleNamespace(tick=lambda: {}["no"], stopped=False, close=lambda: closed.append(True))
    WORK.begin_rendering(jobs, "timer")
    with pytest.raises(KeyError):
        DOGSPLAT_OT_render_views.modal(modal_operator([]), a_window(timers), SimpleNamespace(type="TIMER"))
    assert closed and timers == ["timer"] and not WORK.busy and WORK.timer is None


def modal_operator(said, train=False):
    """What Blender makes of the operator, and what it reports."""
    operator = SimpleNamespace(train=train, report=lambda kind, text: said.append((kind, text)))
    for name in ("_trained", "_refused"):
        setattr(operator, name, MethodType(getattr(DOGSPLAT_OT_render_views, name), operator))
    return operator


def a_window(removed=None):
    """The context of one: here there is none. ``removed``: its timers that were."""
    windows = SimpleNamespace(windows=[], event_timer_remove=([] if removed is None else removed).append)
    return SimpleNamespace(window_manager=windows, workspace=SimpleNamespace(status_text_set=lambda text: None))


def test_without_a_command_the_package_beside_blender_trains(monkeypatch):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: True)
    assert renderers.process_words() == [sys.executable, "-m", "mi_dogsplat"]
    assert renderers.process_words(f"{sys.executable} -m other") == [sys.executable, "-m", "other"]


def test_a_command_is_read_as_people_write_it(monkeypatch, tmp_path):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: True)
    assert renderers.words_of("  ") == ()  # as an empty one
    for platform in ("linux", "win32"):
        monkeypatch.setattr(renderers, "sys", SimpleNamespace(platform=platform, executable=sys.executable))
        assert renderers.words_of(f' "{sys.executable}" -m other ') == (sys.executable, "-m", "other")
        for wrong in (f'"{sys.executable} -m other', '""'):
            with pytest.raises(RendererError, match="correct or clear it") as caught:
                renderers.words_of(wrong)
            assert wrong in str(caught.value)


def test_a_command_may_begin_in_the_home_folder(monkeypatch, tmp_path):
    """Alone or with words behind it, and in a home whose name has a space."""
    home = tmp_path / "John Doe"
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(home))
    home.mkdir()
    shutil.copy(sys.executable, home / "python")
    for words in ((), ("-m", "mi_dogsplat")):
        program, *rest = renderers.words_of(" ".join(["~/python", *words]))
        assert Path(program) == home / "python" and tuple(rest) == words
    for wrong in ("~/other -m mi_dogsplat", "~nobody_here/python"):
        with pytest.raises(RendererError, match="correct or clear it"):
            renderers.words_of(wrong)


def a_run(works, message=""):
    """What stands in for a training."""

    def fail():
        raise RendererError(message)

    stopped = []
    return SimpleNamespace(works=works, require_result=fail, stop=lambda: stopped.append(True), stopped=stopped)


def test_the_timer_looks_after_a_training_until_its_end(scene, monkeypatch, model):
    monkeypatch.setattr(WORK, "scene", scene.session_uid)
    monkeypatch.setattr(WORK, "trouble", "")
    monkeypatch.setattr(train_operator, "tell", lambda *_: None)  # needs a display
    monkeypatch.setattr(WORK, "training", a_run(True))
    assert train_operator.look_after() == train_operator.INTERVAL
    WORK.training = a_run(False, "no\nmemory")
    assert train_operator.look_after() is None
    assert WORK.training is None and WORK.trouble == "no memory"
    assert train_operator.look_after() is None
    WORK.training, WORK.trouble = SimpleNamespace(works=False, require_result=lambda: model), ""
    assert train_operator.look_after() is None
    assert WORK.trouble == "" and len(scene.dogsplat_training.result.data.vertices) == 150


def test_another_file_ends_a_training(monkeypatch):
    run = a_run(True)
    monkeypatch.setattr(WORK, "training", run)
    assert bpy.ops.dogsplat.stop_training.poll()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert run.stopped and WORK.training is None and not bpy.ops.dogsplat.stop_training.poll()


def test_a_training_ends_with_its_owner(tmp_path, monkeypatch):
    """Even one that does not listen."""
    monkeypatch.setattr(training_run, "PATIENCE", 0.2)
    deaf = "import time; print('x', flush=True); time.sleep(600)"
    run = TrainingRun([sys.executable, "-c", deaf], tmp_path, tmp_path / "run", {"steps": "9"}, False)
    while not (tmp_path / "training.log").stat().st_size:
        time.sleep(0.02)
    process = run._process
    del run
    assert process.poll() is not None


def test_the_panel_offers_what_can_be_done(subject, scene, monkeypatch):
    def drawn():
        layout = Layout()
        DOGSPLAT_PT_train.draw(type("Panel", (), {"layout": layout}), bpy.context)
        return layout.drawn

    assert {"views", "steps", "target"} - set(drawn()) == {"target"}  # of the preset 3dgs
    scene.dogsplat_training.preset = "ours"
    assert "target" in drawn() and drawn()[-3:] == ["dogsplat.render_views"] * 2 + ["dogsplat.train"]
    make_rig(bpy.context)
    assert "14 cameras in the rig" in drawn()
    jobs = RenderJobs(bpy.context)
    monkeypatch.setattr(WORK, "rendering", jobs)
    assert drawn()[0] == "0 of 14 views" and not bpy.ops.dogsplat.render_views.poll()
    jobs.close()
    monkeypatch.setattr(WORK, "rendering", None)
    monkeypatch.setattr(WORK, "training", SimpleNamespace(step=30, steps=200))
    assert drawn() == ["Step 30 of 200", "dogsplat.stop_training"]
    monkeypatch.setattr(WORK, "training", None)
    run = Path(scene.dogsplat_training.folder) / "run"
    run.mkdir(parents=True)
    (run / "config.json").write_text("{}")
    (folder_of(scene) / "transforms.json").write_text("{}")
    assert drawn()[-2:] == ["dogsplat.train"] * 2
    scene.dogsplat_training.folder = "//training"
    assert "save the file" in drawn()[-1]
