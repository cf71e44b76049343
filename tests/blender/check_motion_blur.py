"""Motion blur of Cycles, whose quads are in another order at every time of the shutter."""

import math

import bpy
import numpy as np
from blender_pictures import picture, psnr
from mathutils import Matrix
from model_files import load
from references import REFERENCES

from blender_addon.nodes.modifier import add_modifier

SHUTTER, TIMES = 0.5, 9


def orbiting_camera(scene, center) -> None:
    """A camera that turns around a point by two degrees in a frame."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = 64
    for frame, angle in ((1, -2), (2, 0), (3, 2)):
        turn = Matrix.Rotation(math.radians(angle), 4, "Y")
        camera.matrix_world = Matrix.Translation(center) @ turn @ Matrix.Translation((0, 0, 7))
        for path in ("location", "rotation_euler"):
            camera.keyframe_insert(path, frame=frame)


def test_a_turning_camera_blurs_a_model_as_the_mean_over_the_shutter(scene, tmp_path):
    """Oracle: pictures without blur at times of the shutter."""
    load(REFERENCES / "plain.ply")
    bpy.ops.dogsplat.exact_settings()
    orbiting_camera(scene, (0, 0, 3.2))
    sharp = []
    for time in np.linspace(-SHUTTER / 2, SHUTTER / 2, TIMES):
        scene.frame_set(2 + math.floor(time), subframe=time % 1)
        sharp.append(picture(scene, "CYCLES", tmp_path))
    assert psnr(sharp[0], sharp[-1]) < 40
    scene.frame_set(2)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter, scene.cycles.samples = True, SHUTTER, 64
    blurred = picture(scene, "CYCLES", tmp_path)
    assert psnr(blurred, np.mean(sharp, axis=0)) > 45


def test_blur_of_objects_stays_and_that_of_deformation_is_off(scene, model):
    """Of imported models, and wherever else our modifier is added."""
    obj, other = load(model), bpy.data.objects.new("other", bpy.data.meshes.new("other"))
    add_modifier(other)
    for made in (obj, other):
        assert made.cycles.use_motion_blur and not made.cycles.use_deform_motion
