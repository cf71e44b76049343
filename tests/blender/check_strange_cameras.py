"""Cameras that their objects or parents mirror."""

from blender_pictures import psnr, rendered
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera, reference

from blender_addon.engine.settings import ENGINE


def test_a_mirrored_camera_sees_the_mirror_image_of_splats(scene, by_command, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.view_settings.view_transform, scene.dogsplat_colors = "Raw", "DISPLAY"
    scene.camera.matrix_world @= Matrix.Diagonal((-1, 1, 1, 1))
    scene.camera.data.shift_x *= -1  # the principal point is mirrored too
    assert psnr(rendered(scene, ENGINE, tmp_path), reference("dog")["color"][:, ::-1]) > 60
