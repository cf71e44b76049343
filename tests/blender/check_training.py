"""Any scene to a model: the rig, its renders as a data set, the training, and the model in place of the objects."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from check_panel import Layout
from check_render import EEVEE, psnr
from mathutils import Matrix, Vector
from surroundings import background, body, light, material, plane, sphere

from blender_addon.cameras.json_object import read_json_object
from blender_addon.engine import renderers
from blender_addon.engine.served import RendererError
from blender_addon.training import run as training_run
from blender_addon.training import train_operator
from blender_addon.training.data_set import is_begun, is_complete
from blender_addon.training.panel import DOGSPLAT_PT_train
from blender_addon.training.render_operator import RenderJobs
from blender_addon.training.rendering import Rendering
from blender_addon.training.rig import around, held_out
from blender_addon.training.rig_operator import make_rig, rig_cameras
from blender_addon.training.run import TrainingRun, can_go_on
from blender_addon.training.work import WORK

COMMAND = tuple(json.loads(os.environ["DOGSPLAT_COMMAND"]))
CENTER, RADIUS = (1.0, 2.0, 0.5), 0.8
RED, GREEN = (0.7, 0.15, 0.1, 1), (0.1, 0.5, 0.2, 1)


@pytest.fixture
def subject(scene, monkeypatch, tmp_path):
    """A red ball, selected, with a green one that touches it, in front of a wall; few and tiny pictures."""
    monkeypatch.setattr(train_operator, "process_words", lambda command: list(COMMAND))
    wall = body(plane(40, location=(1, 9, 0), rotation=(1.57, 0, 0)), material("ShaderNodeBsdfDiffuse"))
    wall.name = "Wall"
    ball = body(sphere(RADIUS, location=CENTER), material("ShaderNodeBsdfDiffuse", Color=RED))
    small = body(sphere(0.3, location=(1.0, 1.3, 1.2)), material("ShaderNodeBsdfDiffuse", Color=GREEN))
    ball.name, small.name = "Ball", "Small"
    bpy.ops.object.select_all(action="DESELECT")
    ball.select_set(True)
    background(scene, (0.9, 0.9, 0.9, 1))
    light(scene, "SUN", rotation=(0.6, 0.4, 0), energy=2)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.cycles.transparent_max_bounces = scene.cycles.min_transparent_bounces = 256
    settings = scene.dogsplat_training
    settings.views, settings.size, settings.steps, settings.elevations = 12, (40, 40), 200, (-60, 90)
    settings.folder, settings.max_primitives, settings.preset = str(tmp_path / "training"), 3000, "3dgs"
    return ball


def folder_of(scene):
    return Path(scene.dogsplat_training.folder) / "data"


def state(scene):
    """Every setting that has to be as before."""

    def values(owner):
        read = {p.identifier: getattr(owner, p.identifier) for p in owner.bl_rna.properties if p.type != "POINTER"}
        return {name: tuple(v) if hasattr(v, "__len__") and not isinstance(v, str) else v for name, v in read.items()}

    owners = scene.render, scene.render.image_settings, scene.view_settings, scene.display_settings
    seen = {obj.name: (obj.hide_render, obj.hide_viewport, obj.visible_camera, obj.hide_get()) for obj in scene.objects}
    view = bpy.context.preferences.view.render_display_type
    return [*map(values, owners), seen, scene.camera, view, scene.frame_current]


def made_unlike(scene):
    """Settings that differ from all that views are rendered with."""
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 320, 200, 70
    render.pixel_aspect_x, render.use_border, render.use_motion_blur, render.filepath = 2.0, True, True, "//mine"
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Punchy"
    scene.view_settings.exposure = 1.0
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"


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


CAPTURED = """
import json, sys
import numpy as np
from mi_dogsplat.datasets.camera_paths import circling_shots
from mi_dogsplat.datasets.capture import _tests
from mi_dogsplat.datasets.capture_config import CaptureConfig
config = CaptureConfig(views=12, size=(40, 30), elevations=(-60.0, 90.0), zoom=1.5)
x, y, z, radius = map(float, sys.argv[1:])
cameras = [shot.camera for shot in circling_shots(config, 14, np.array([x, y, z]), radius, "z")]
print(json.dumps({
    "cameras": [{"c2w": camera.c2w.tolist(), "focal": [camera.fx, camera.fy]} for camera in cameras],
    "tests": [(n, sorted(_tests(CaptureConfig(views=n), n + n // 6))) for n in (5, 48, 51)],
}))
"""


def by_package(script, *arguments):
    """What a script prints in the Python that has the package."""
    done = subprocess.run([COMMAND[0], "-c", script, *arguments], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_the_rig_is_that_of_capture(subject, scene):
    scene.dogsplat_training.size, scene.dogsplat_training.zoom = (40, 30), 1.5
    made = Rendering(bpy.context)
    made.close()
    captured = by_package(CAPTURED, *map(str, (*CENTER, RADIUS)))
    for camera, frame in zip(captured["cameras"], made.frames, strict=True):
        assert np.allclose(np.array(frame["transform_matrix"]) * (1, -1, -1, 1), camera["c2w"], atol=1e-4)
        assert np.allclose([frame["fl_x"], frame["fl_y"]], camera["focal"], rtol=1e-5)
    for n, tests in captured["tests"]:
        assert held_out(n + n // 6) == set(tests)


def test_a_camera_that_looks_straight_down_is_upright():
    (pose,) = around(np.zeros(3), 2.0, 1, (90.0, 90.0))
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3)) and np.linalg.det(pose[:3, :3]) > 0
    assert np.allclose(pose[:3, 3], (0, 0, 2)) and np.allclose(pose[:3, 2], (0, 0, 1))


def test_poses_are_those_that_blender_renders_with(subject, scene):
    """A camera that was moved, with lens shift, under a parent: where Blender sees a point, so does the data set."""
    made = make_rig(bpy.context)
    moved = made[3]
    moved.data = moved.data.copy()
    moved.data.lens, moved.data.shift_x, moved.data.shift_y = 31.0, 0.1, -0.07
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    moved.parent, parent.location, parent.rotation_euler = parent, (0.3, 0.1, 0.2), (0.05, 0, 0.1)
    scene.dogsplat_training.size = (60, 40)
    bpy.context.view_layer.update()
    rendering = Rendering(bpy.context)
    try:
        for point in (CENTER, (1.3, 2.2, 0.1), (0.7, 1.6, 0.9)):
            u, v, _ = world_to_camera_view(scene, moved, Vector(point))
            frame = rendering.frames[3]
            x, y, z = (np.linalg.inv(frame["transform_matrix"]) @ (*point, 1))[:3]
            pixel = frame["cx"] - frame["fl_x"] * x / z, frame["cy"] + frame["fl_y"] * y / z
            assert np.allclose(pixel, (60 * u, 40 * (1 - v)), atol=1e-3)
    finally:
        rendering.close()


@pytest.mark.parametrize("engine", ["CYCLES", EEVEE])
def test_all_settings_are_given_back_and_only_the_subject_is_seen(subject, scene, engine):
    """A subject, too, that a model has taken the place of."""
    scene.render.engine = engine
    scene.dogsplat_training.views = 1
    make_rig(bpy.context)
    subject.hide_render = True
    subject.hide_set(True)
    made_unlike(scene)
    before = state(scene)
    bpy.ops.dogsplat.render_views()
    assert state(scene) == before
    image = bpy.data.images.load(str(folder_of(scene) / "images" / "View_000.png"))
    assert tuple(image.size) == (40, 40)
    pixels = np.array(image.pixels[:]).reshape(40, 40, 4)
    seen = pixels[pixels[..., 3] > 0.99][:, :3]
    assert len(seen) > 300 and (pixels[..., 3] < 0.01).mean() > 0.1
    assert (seen[:, 0] > 1.5 * seen[:, 1]).all()  # red: neither the wall nor the green ball


def test_settings_are_given_back_after_an_error(subject, scene, monkeypatch):
    make_rig(bpy.context)
    made_unlike(scene)
    before = state(scene)
    monkeypatch.setattr(Rendering, "keep", lambda self: (_ for _ in ()).throw(ValueError("no view")))
    with pytest.raises(RuntimeError, match="no view"):
        bpy.ops.dogsplat.render_views()
    assert state(scene) == before and not WORK.busy


def test_what_was_rendered_is_kept_when_it_is_stopped(subject, scene):
    make_rig(bpy.context)
    before = state(scene)
    jobs = RenderJobs(bpy.context)
    while jobs.rendering.done < 2:
        assert jobs.tick()
    bpy.app.handlers.render_cancel[-1](scene)  # as Esc does
    assert not jobs.tick()
    jobs.close()
    assert state(scene) == before
    data = folder_of(scene)
    assert is_begun(data) and not is_complete(data) and not bpy.ops.dogsplat.train.poll()
    first = data / "images" / "View_000.png"
    written = first.stat().st_mtime_ns
    rig_cameras(scene.dogsplat_training)[1].location.z += 0.1  # this one has to be rendered again
    second = (data / "images" / "View_001.png").stat().st_mtime_ns
    jobs = RenderJobs(bpy.context)
    assert jobs.rendering.done == 1
    while jobs.tick():
        pass
    jobs.close()
    assert is_complete(data) and first.stat().st_mtime_ns == written
    assert (data / "images" / "View_001.png").stat().st_mtime_ns != second
    again = Rendering(bpy.context)  # of a scene that may be another now
    again.close()
    assert again.done == 0 and is_begun(data)


def test_cameras_that_were_deleted_and_added_are_respected(subject, scene):
    made = make_rig(bpy.context)
    bpy.data.objects.remove(made[0])
    own = made[1].copy()
    own.name = "my own"
    del own["DoG Splat Rig"]
    scene.dogsplat_training.cameras.objects.link(own)
    bpy.context.view_layer.update()
    rendering = Rendering(bpy.context)
    rendering.close()
    names = [frame["file_path"] for frame in rendering.frames]
    assert names[0] == "images/View_001.png" and names[-1] == "images/my_own.png" and len(names) == 14
    assert len(make_rig(bpy.context)) == 15 and own.name in scene.dogsplat_training.cameras.objects


def test_points_are_on_the_surfaces_in_their_colors(subject, scene):
    """What hides the ball from a camera, but is not seen, does not catch the points."""
    bpy.data.objects["SUN"].rotation_euler = (0, 0.9, 0)  # which the small ball does not hide
    bpy.ops.dogsplat.render_views()
    seen = by_package(LOAD, str(folder_of(scene)))
    assert seen["views"] == [12, 2] and seen["channels"] == [4] and seen["white"] == [None]
    points, colors = np.array(seen["points"]), np.array(seen["colors"])
    assert len(points) > 0.97 * seen["solid"] > 2000  # no ray passes by
    assert np.abs(np.linalg.norm(points - CENTER, axis=1) - RADIUS).max() < 0.02  # a ball of facets
    assert (colors[:, 0] > 1.5 * colors[:, 1]).mean() > 0.95
    lit = np.linalg.norm(points - bpy.data.objects["Small"].location, axis=1) > 0.6
    towards_sun = (points - CENTER)[lit] @ np.array(bpy.data.objects["SUN"].matrix_world.col[2][:3])
    assert np.corrcoef(towards_sun, colors[lit, 1])[0, 1] > 0.8  # each has the colour of its own place


LOAD = """
import json, sys
from mi_dogsplat.datasets import load_dataset
data = load_dataset(sys.argv[1])
views = [*data.train, *data.test]
print(json.dumps({
    "views": [len(data.train), len(data.test)], "points": data.points.tolist(), "colors": data.point_colors.tolist(),
    "channels": sorted({view.image.shape[2] for view in views}), "white": sorted({view.white for view in views}),
    "solid": sum(int((view.image[..., 3] > 0.5).sum()) for view in data.train if view.image.shape[2] == 4),
    "brightest": max(float(view.image.max()) for view in views),
}))
"""


def test_linear_views_do_not_end_at_white(subject, scene):
    bpy.data.objects["SUN"].data.energy = 30
    scene.dogsplat_training.linear, scene.dogsplat_training.views = True, 6
    bpy.ops.dogsplat.render_views()
    seen = by_package(LOAD, str(folder_of(scene)))
    assert seen["views"] == [6, 1] and seen["channels"] == [4] and seen["brightest"] > 2
    assert 0 <= np.min(seen["colors"]) and np.max(seen["colors"]) <= 1


def test_cameras_inside_stand_free_and_look_around(scene):
    bpy.ops.mesh.primitive_cube_add(size=6, location=(0, 0, 3))
    room = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(size=2, location=(0, 0, 3))
    cupboard = bpy.context.object
    room.select_set(True)
    settings = scene.dogsplat_training
    settings.rig, settings.views = "INSIDE", 24
    assert tuple(settings.elevations) == (-35, 35)
    made = make_rig(bpy.context)
    places = np.array([obj.matrix_world.translation for obj in made])
    assert len(made) == 28 and (np.abs(places - (0, 0, 3)) < 3 * 0.6 + 1e-5).all()
    assert (np.abs(places - (0, 0, 3)).max(axis=1) > 1).all()  # outside of the cupboard
    ways = -np.array([obj.matrix_world.col[2][:3] for obj in made])
    assert np.linalg.norm(ways.mean(axis=0)) < 0.1
    bpy.data.objects.remove(cupboard)
    room.scale = (1, 1, 0.03)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="there is room for 0 of 28 cameras inside; use fewer"):
        bpy.ops.dogsplat.make_cameras()


def test_a_region_marks_what_is_framed(subject, scene):
    empty = bpy.data.objects.new("Region", None)
    scene.collection.objects.link(empty)
    empty.location, empty.empty_display_size = (5, 5, 5), 2.0
    settings = scene.dogsplat_training
    settings.subject = "REGION"
    with pytest.raises(RuntimeError, match="no region is chosen"):
        bpy.ops.dogsplat.make_cameras()
    settings.region = empty
    bpy.context.view_layer.update()
    places = np.array([obj.matrix_world.translation for obj in make_rig(bpy.context)])
    reach = 2 * np.sqrt(3) / np.sin(np.radians(20))
    assert np.allclose(np.linalg.norm(places - 5, axis=1), reach, rtol=1e-4)


def nothing_selected(scene, tmp_path):
    bpy.ops.object.select_all(action="DESELECT")


def no_faces(scene, tmp_path):
    nothing_selected(scene, tmp_path)
    empty = bpy.data.objects.new("Empty", None)
    scene.collection.objects.link(empty)
    empty.select_set(True)


def no_lens(scene, tmp_path):
    data = bpy.data.cameras.new("Wide")
    data.type = "ORTHO"
    scene.camera = bpy.data.objects.new("Wide", data)


def elevations_the_wrong_way_round(scene, tmp_path):
    scene.dogsplat_training.elevations = (40, 20)


def other_contents(scene, tmp_path):
    folder_of(scene).mkdir(parents=True)
    (folder_of(scene) / "letter.txt").write_text("mine")


def a_file_in_its_place(scene, tmp_path):
    scene.dogsplat_training.folder = str(tmp_path / "file")
    (tmp_path / "file").write_text("mine")


def never_saved(scene, tmp_path):
    scene.dogsplat_training.folder = "//training"


@pytest.mark.parametrize("spoil, message", [
    (nothing_selected, "nothing is selected; select"), (no_faces, "no surfaces; select"),
    (no_lens, "Wide.*perspective camera"), (elevations_the_wrong_way_round, "lowest elevation is above"),
    (other_contents, "is a folder with other contents; choose"), (a_file_in_its_place, "cannot be written.*choose"),
    (never_saved, "save the file, or choose a folder"),
])  # fmt: skip
def test_what_is_wrong_is_said_in_one_line(subject, scene, tmp_path, spoil, message):
    spoil(scene, tmp_path)
    before = state(scene)
    with pytest.raises(RuntimeError, match=message) as caught:
        bpy.ops.dogsplat.render_views()
    assert len(str(caught.value).strip().splitlines()) == 1
    assert state(scene)[:4] == before[:4] and scene.camera == before[5]
    assert not list(tmp_path.rglob("*.png"))


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


def test_without_a_command_the_package_beside_blender_trains(monkeypatch):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: True)
    assert renderers.process_words() == [sys.executable, "-m", "mi_dogsplat"]
    assert renderers.process_words(f"{sys.executable} -m other") == [sys.executable, "-m", "other"]


def a_run(works, message=""):
    """What stands in for a training."""

    def fail():
        raise RendererError(message)

    stopped = []
    return SimpleNamespace(works=works, require_result=fail, stop=lambda: stopped.append(True), stopped=stopped)


def test_the_timer_looks_after_a_training_until_its_end(scene, monkeypatch, model):
    monkeypatch.setattr(WORK, "scene", scene.name)
    monkeypatch.setattr(WORK, "trouble", "")
    monkeypatch.setattr(train_operator, "tell", lambda context: None)  # needs a display
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
    deaf = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('x', flush=True); time.sleep(600)"
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
