"""The exported camera path: its keys see the model as Blender's camera does, and ``dogsplat film`` takes it."""

import errno
import json
import os
import subprocess

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from edits import PLACED, only_an_instance
from mathutils import Matrix, Vector
from model_files import export, load
from package_command import COMMAND, SECONDS

from blender_addon.evaluated.placed import placed_splats
from blender_addon.objects.attributes import is_native, read_attributes

FRAMES = 1, 9


@pytest.fixture
def animated(scene, model):
    """A model that is moved, turned and scaled, and a camera that goes past it."""
    splats = load(model)
    splats.matrix_world = PLACED
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.frame_start, scene.frame_end = FRAMES
    scene.render.fps, scene.render.resolution_x, scene.render.resolution_y = 8, 64, 48
    for frame, angle in zip(FRAMES, (0.0, 0.7), strict=True):
        camera.location = PLACED @ Vector((8 * np.sin(angle), -8 * np.cos(angle), 1.0))
        camera.rotation_euler = (PLACED.translation - camera.location).to_track_quat("-Z", "Y").to_euler()
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_set(4)
    return splats


def exported(tmp_path, **options) -> list[dict]:
    path = tmp_path / "keys.json"
    assert bpy.ops.export_scene.dogsplat_path(filepath=str(path), **options) == {"FINISHED"}
    return json.loads(path.read_text())["keys"]


def test_every_key_sees_the_model_as_the_camera_does(scene, animated, tmp_path):
    keys = exported(tmp_path)
    assert [key["time"] for key in keys] == [k / 8 for k in range(9)] and scene.frame_current == 4
    points = read_attributes(animated.data).means[:20].astype(np.float64)
    for frame, key in enumerate(keys, FRAMES[0]):
        scene.frame_set(frame)
        w2c = np.array(key["w2c"])
        np.testing.assert_allclose(w2c[:3, :3] @ w2c[:3, :3].T, np.eye(3), atol=1e-5)
        local = points @ w2c[:3, :3].T + w2c[:3, 3]
        pixels = local[:, :2] / local[:, 2:] * (key["fx"], key["fy"]) + (key["cx"], key["cy"])
        seen = [world_to_camera_view(scene, scene.camera, animated.matrix_world @ Vector(p)) for p in points]
        expected = np.array([(s.x * key["width"], (1 - s.y) * key["height"]) for s in seen])
        np.testing.assert_allclose(pixels, expected, atol=1e-2)


@pytest.mark.parametrize("active", [True, False])
def test_a_path_is_in_the_coordinates_of_an_instance(scene, animated, tmp_path, active):
    """Of a model that the scene itself has not; the only one is found without a hint."""
    animated.matrix_world = Matrix.Identity(4)
    maker = only_an_instance(scene, animated)
    if not active:
        bpy.context.view_layer.objects.active = None
    key = exported(tmp_path)[3]
    ((_, placed, _),) = placed_splats(bpy.context.evaluated_depsgraph_get())
    seen = np.linalg.inv(np.array(scene.camera.matrix_world.normalized())) @ placed
    seen[:3] /= np.cbrt(np.linalg.det(placed[:3, :3]))
    np.testing.assert_allclose(np.diag([1, -1, -1, 1]) @ seen, key["w2c"], atol=1e-5)
    assert maker.name in scene.objects and len(scene.objects) == 2


@pytest.mark.parametrize("hidden", ["disabled", "excluded"])
def test_a_model_may_be_hidden_meanwhile_and_move(scene, animated, tmp_path, hidden):
    """As heavy ones are, while a camera is animated; Blender does not evaluate them."""
    holder, collection = bpy.data.objects.new("holder", None), bpy.data.collections.new("models")
    scene.collection.children.link(collection)
    scene.collection.objects.unlink(animated)
    for obj in (animated, holder):
        collection.objects.link(obj)
    animated.parent = holder
    for frame, angle in zip(FRAMES, (0.0, 1.0), strict=True):
        holder.rotation_euler.z = angle
        holder.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_set(4)
    bpy.context.view_layer.objects.active = animated
    expected = exported(tmp_path)
    if hidden == "excluded":
        bpy.context.view_layer.layer_collection.children["models"].exclude = True
    else:
        animated.hide_viewport = holder.hide_viewport = True
    count = len(bpy.data.objects)
    found = exported(tmp_path)
    assert len(bpy.data.objects) == count
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one["w2c"], other["w2c"], atol=1e-5)
    assert np.abs(np.subtract(found[0]["w2c"], found[-1]["w2c"])).max() > 0.1


@pytest.mark.parametrize("apply", ["dogsplat.apply_transform", "object.transform_apply"])
def test_a_path_fits_the_file_of_a_model_whose_transform_was_applied(scene, animated, tmp_path, apply):
    """Then it is moved once more. A path that comes back is the camera that went out."""
    before = exported(tmp_path)
    own, _, name = apply.partition(".")
    assert getattr(getattr(bpy.ops, own), name)() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert np.allclose(np.array(animated.matrix_world), np.eye(4))
    for key, expected in zip(exported(tmp_path), before, strict=True):
        np.testing.assert_allclose(key["w2c"], expected["w2c"], atol=1e-4)
    moved = Matrix.Rotation(0.5, 4, "X") @ Matrix.Translation((1, 2, 3))
    animated.matrix_world = moved
    camera = scene.camera
    assert bpy.ops.import_scene.dogsplat_path(filepath=str(tmp_path / "keys.json")) == {"FINISHED"}
    scene.frame_set(FRAMES[1])
    np.testing.assert_allclose(np.array(scene.camera.matrix_world), np.array(moved @ camera.matrix_world), atol=1e-4)


def test_a_stretched_model_whose_transform_was_applied_has_the_path_of_its_export(scene, animated, tmp_path):
    """As the line of a refused export says."""
    animated.scale = (1, 2, 1)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="apply its transform"):
        exported(tmp_path)
    bpy.ops.dogsplat.apply_transform()
    bpy.context.view_layer.update()
    keys = exported(tmp_path)
    scene.frame_set(FRAMES[0])
    seen = world_to_camera_view(scene, scene.camera, Vector(read_attributes(animated.data).means[0]))
    point = export(tmp_path / "applied.ply").means[0].astype(np.float64)
    w2c = np.array(keys[0]["w2c"])
    x, y, z = w2c[:3, :3] @ point + w2c[:3, 3]
    pixel = x / z * keys[0]["fx"] + keys[0]["cx"], y / z * keys[0]["fy"] + keys[0]["cy"]
    assert pixel == pytest.approx((seen.x * keys[0]["width"], (1 - seen.y) * keys[0]["height"]), abs=1e-2)


def test_steps_end_with_the_last_frame(animated, tmp_path):
    assert [key["time"] for key in exported(tmp_path, step=3)] == [0, 3 / 8, 6 / 8, 1]


def test_the_film_of_a_path_is_made(animated, model, tmp_path):
    exported(tmp_path)
    command = [*COMMAND, "film", str(model), "-o", str(tmp_path / "frames")]
    command += ["--path", str(tmp_path / "keys.json"), "--fps", "3"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stderr
    assert "4 frames of 64 x 48, 1.333 s; through 9 key frames" in done.stdout


def test_what_no_camera_can_see_is_refused(animated, tmp_path):
    animated.scale = (1, 1, -1)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="mirrored, sheared or scaled unevenly"):
        bpy.ops.export_scene.dogsplat_path(filepath=str(tmp_path / "keys.json"))
    assert not list(tmp_path.iterdir()) and bpy.context.scene.frame_current == 4


def test_a_path_that_cannot_be_written_leaves_what_was_there(animated, monkeypatch, tmp_path):
    """One line names the file; a disk that is full does not cost the old path."""
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.export_scene.dogsplat_path(filepath=str(tmp_path / "none" / "keys.json"))
    said = str(caught.value).strip()
    assert "keys.json: cannot be written (No such file or directory); check that the folder exists" in said
    assert len(said.splitlines()) == 1
    exported(tmp_path)
    before = (tmp_path / "keys.json").read_bytes()

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(RuntimeError, match="keys.json: cannot be written .No space left on device.; check"):
        exported(tmp_path, step=2)
    assert [path.name for path in tmp_path.iterdir()] == ["keys.json"]
    assert (tmp_path / "keys.json").read_bytes() == before


def test_an_exported_path_comes_back_as_the_same_camera(scene, animated, tmp_path):
    """Frame by frame, with the lens, beside the model as it is placed."""
    scene.camera.data.lens = 35
    scene.camera.data.keyframe_insert("lens", frame=1)
    scene.camera.data.lens, scene.camera.data.shift_x = 60, 0.1
    scene.camera.data.keyframe_insert("lens", frame=9)
    exported(tmp_path)
    before = scene.camera
    bpy.context.view_layer.objects.active = animated
    assert bpy.ops.import_scene.dogsplat_path(filepath=str(tmp_path / "keys.json")) == {"FINISHED"}
    assert scene.camera is not before and (scene.frame_start, scene.frame_end) == FRAMES
    for frame in (1, 4, 9):
        scene.frame_set(frame)
        np.testing.assert_allclose(scene.camera.matrix_world, before.matrix_world, atol=1e-4)
        size = scene.camera.data.sensor_width / before.data.sensor_width
        assert scene.camera.data.lens == pytest.approx(before.data.lens * size, rel=1e-4)
        assert scene.camera.data.shift_x == pytest.approx(before.data.shift_x, abs=1e-4)


def test_a_path_leaves_the_scene_between_two_frames(scene, animated, tmp_path):
    scene.frame_set(4, subframe=0.5)
    exported(tmp_path)
    assert scene.frame_current_final == 4.5
    assert bpy.ops.import_scene.dogsplat_path(filepath=str(tmp_path / "keys.json")) == {"FINISHED"}
    assert scene.frame_current_final == 4.5


def test_a_path_is_placed_beside_a_point_cloud_of_splats(scene, model, animated, tmp_path):
    """As it is exported."""
    if bpy.app.version < (4, 5):
        pytest.skip("this Blender makes no point cloud of a mesh")
    obj = load(model, up_axis="-Y", scale=2.0)
    obj.modifiers.clear()
    obj.location = (1, 2, 3)
    for other in bpy.context.selected_objects:
        other.select_set(other == obj)
    bpy.ops.object.convert(target="POINTCLOUD")
    before, cloud = scene.camera, bpy.context.object
    assert is_native(cloud)
    exported(tmp_path)
    assert bpy.ops.import_scene.dogsplat_path(filepath=str(tmp_path / "keys.json")) == {"FINISHED"}
    scene.frame_set(4)
    assert scene.camera is not before
    np.testing.assert_allclose(scene.camera.matrix_world, before.matrix_world, atol=1e-4)


def test_keys_that_look_at_a_point_are_imported(scene, tmp_path):
    path = tmp_path / "orbit.json"
    keys = [{"time": 0, "position": [3, 0, 1], "look_at": [0, 0, 0], "fov": 30}]
    keys += [{"time": 2, "position": [0, 3, 1], "rotation": [0, 0, 0, 1]}]
    path.write_text(json.dumps({"keys": keys}))
    scene.render.resolution_x, scene.render.resolution_y, scene.render.fps = 64, 48, 10
    assert bpy.ops.import_scene.dogsplat_path(filepath=str(path)) == {"FINISHED"}
    scene.frame_set(1)
    seen = world_to_camera_view(scene, scene.camera, Vector((0, 0, 0)))
    assert (seen.x, seen.y) == pytest.approx((0.5, 0.5), abs=1e-4) and seen.z == pytest.approx(10**0.5, rel=1e-5)
    edge = scene.camera.matrix_world @ Vector((0, np.tan(np.radians(15)), -1))
    assert world_to_camera_view(scene, scene.camera, edge).y == pytest.approx(1, abs=1e-4)
    assert scene.frame_end == 21
    scene.frame_set(21)
    assert scene.camera.matrix_world.to_3x3() @ Vector((0, 0, -1)) == Vector((0, 0, 1))  # OpenCV's z


def test_a_file_that_leaves_things_out_is_read_as_by_the_package(scene, model, tmp_path):
    """Upright is what is up in Blender now; the field of view is that of the camera before; editors of Windows begin a
    text with a mark."""
    load(model, up_axis="-Y")
    camera = {"w2c": np.eye(4).tolist(), "fx": 90.0, "width": 60, "height": 40, "time": 0}
    keys = [camera, {"time": 1, "position": [3, 1, 2], "look_at": [0, 0, 0]}]
    (tmp_path / "keys.json").write_text(json.dumps({"keys": keys}), encoding="utf-8-sig")
    scene.render.resolution_x, scene.render.resolution_y, scene.render.fps = 60, 40, 10
    assert bpy.ops.import_scene.dogsplat_path(filepath=str(tmp_path / "keys.json")) == {"FINISHED"}
    scene.frame_set(11)
    assert abs(scene.camera.matrix_world.to_3x3().col[0].z) < 1e-6 < scene.camera.matrix_world.to_3x3().col[1].z
    edge = scene.camera.matrix_world @ Vector((0, 20 / 90, -1))
    assert world_to_camera_view(scene, scene.camera, edge).y == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize("content, message", [
    ("{", "JSON"), ('{"keys": []}', "no list of keys"), ('[{"position": [0, 0, 0]}]', "key 0 cannot be used"),
    ('[{"position": [0, 0, 0], "look_at": [0, 0, 1]}]', "straight above"),
    ('[{"w2c": [], "fx": 9, "cx": 0.5, "cy": 0.5, "width": 40, "height": 30}]', "40x30 are shares of its sides"),
])  # fmt: skip
def test_a_path_that_cannot_be_read_is_one_line_and_no_camera(scene, tmp_path, content, message):
    path = tmp_path / "keys.json"
    path.write_text(content)
    with pytest.raises(RuntimeError, match=f"keys.json.*{message}"):
        bpy.ops.import_scene.dogsplat_path(filepath=str(path))
    assert not bpy.data.cameras
