"""Cameras that their objects or parents mirror or shear."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from blender_pictures import EEVEE, psnr, rendered
from live_views import PERSPECTIVE, through_the_camera
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera, reference
from surroundings import background, body, camera, material, plane

from blender_addon.cameras.objects import camera_numbers, pinhole_numbers
from blender_addon.engine.order import make_order
from blender_addon.engine.settings import ENGINE
from blender_addon.viewport.region import seen_by


def sheared(scene):
    """The camera, turned in a parent that is stretched: somewhat to the left of where it was."""
    parent = bpy.data.objects.new("Rig", None)
    scene.collection.objects.link(parent)
    parent.scale = (1.5, 1, 1)
    scene.camera.parent = parent
    scene.camera.rotation_euler.rotate_axis("Z", 0.4)
    bpy.context.view_layer.update()


@pytest.mark.parametrize("engine, name, bound", [(ENGINE, "dog", 60), ("CYCLES", "dog", 60), (EEVEE, "plain", 50)])
def test_a_mirrored_camera_sees_the_mirror_image_of_splats(scene, by_command, tmp_path, engine, name, bound):
    place_camera(scene, name)
    load(REFERENCES / f"{name}.ply")
    bpy.ops.dogsplat.exact_settings()
    scene.dogsplat_colors = "DISPLAY"
    scene.camera.matrix_world @= Matrix.Diagonal((-1, 1, 1, 1))
    scene.camera.data.shift_x *= -1  # the principal point is mirrored too
    assert psnr(rendered(scene, engine, tmp_path), reference(name)["color"][:, ::-1]) > bound


@pytest.mark.parametrize("splats", [False, True])
def test_a_camera_that_its_parents_shear_does_not_stop_an_animation(scene, by_command, tmp_path, splats):
    """It looks where it would, and a note says what is not as in Blender."""
    if splats:
        place_camera(scene, "square")
        load(REFERENCES / "square.ply")
    else:
        camera(scene, (0, 0, 8))
        background(scene, (0, 0, 0, 1))
        body(plane(2), material("ShaderNodeEmission", Strength=1.0))
    sheared(scene)
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert any("without the shear" in note for note in order.notes)
    rotation = order.camera.w2c[:3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
    assert rendered(scene, ENGINE, tmp_path).std() > 0.05


def test_data_of_sheared_cameras_are_refused(scene):
    """Views of a training, and paths, would have another camera than their file says."""
    place_camera(scene, "square")
    pinhole_numbers(scene, scene.camera)
    sheared(scene)
    with pytest.raises(ValueError, match="sheared by its parents; apply their scale"):
        pinhole_numbers(scene, scene.camera)


def test_data_of_mirrored_cameras_are_refused(scene, tmp_path):
    """The package takes no such pose for a training or a film, and says so when all is rendered or written."""
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    scene.camera.matrix_world @= Matrix.Diagonal((-1, 1, 1, 1))
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="is mirrored; make its scale"):
        bpy.ops.export_scene.dogsplat_path(filepath=str(tmp_path / "keys.json"))
    assert not any(tmp_path.iterdir())


def test_a_viewport_looks_through_such_a_camera_as_a_render_does(scene):
    place_camera(scene, "square")
    sheared(scene)
    pose = through_the_camera(scene).camera.w2c
    assert np.allclose(pose, camera_numbers(scene, scene.camera).w2c, atol=1e-5)


def test_a_camera_that_is_scaled_to_nothing_raises_nothing(scene):
    place_camera(scene, "square")
    scene.camera.scale = (0, 0, 0)
    bpy.context.view_layer.update()
    space = SimpleNamespace(view_matrix=Matrix.Diagonal((0, 0, 0, 1)), window_matrix=PERSPECTIVE, is_perspective=True)
    for found in (seen_by(space, 96, 64).camera, camera_numbers(scene, scene.camera)):
        assert np.allclose(found.w2c[:3, :3] @ found.w2c[:3, :3].T, np.eye(3))
