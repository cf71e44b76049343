"""Cameras of data sets as Blender cameras, and Blender cameras as numbers."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ..files.errors import told, type_name
from ..files.transform import mean_scale
from ..objects.conventions import remember
from .camera import OPENCV_FROM_OPENGL, Camera, unsheared

SENSOR = 36.0  # mm
SIZE = "dogsplat_image_size"  # width, height in pixels, and the aspect of a pixel (fy / fx)
CLIP_START, CLIP_END = 0.01, 1e4  # a model has no far end
Eye = tuple[Matrix, float]  # pose and shift along x that one of several views has in place of the camera's own
CONVENTION = "OpenCV world-to-camera; the centre of the first pixel is (0.5, 0.5)"


def build_camera(
    collection: bpy.types.Collection, camera: Camera, matrix: Matrix, source: str, with_image: bool
) -> bpy.types.Object:
    """A camera object in a collection.

    ``matrix`` goes from the coordinates of the data set to Blender's. Raises ``RuntimeError`` for an image that Blender
    cannot open.
    """
    data = bpy.data.cameras.new(camera.name)
    obj = bpy.data.objects.new(camera.name, data)
    aspect = camera.fy / camera.fx
    data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR
    data.lens = camera.fx * SENSOR / camera.width
    data.shift_x = 0.5 - camera.cx / camera.width  # in widths of the picture, and so is shift_y
    data.shift_y = (camera.cy - camera.height / 2) / aspect / camera.width
    scale = mean_scale(np.array(matrix, np.float64)[:3, :3])  # positive of a mirrored model too
    data.clip_start, data.clip_end = CLIP_START * scale, CLIP_END * scale
    data.display_size = 0.1 * scale
    obj[SIZE] = [camera.width, camera.height, aspect]
    obj.matrix_world = (matrix @ Matrix(np.linalg.inv(camera.w2c) @ OPENCV_FROM_OPENGL)).normalized()
    remember(obj, source, CONVENTION, matrix)
    collection.objects.link(obj)
    if with_image and camera.image:
        background = data.background_images.new()
        background.image = bpy.data.images.load(str(camera.image), check_existing=True)
        background.alpha, background.frame_method = 0.5, "STRETCH"
        data.show_background_images = True
    return obj


def look_through(scene: bpy.types.Scene, obj: bpy.types.Object) -> None:
    """Make a camera the active one, and the render as large as its photograph where it has one."""
    scene.camera = obj
    if SIZE in obj:
        width, height, aspect = obj[SIZE]
        render = scene.render
        render.resolution_x, render.resolution_y, render.resolution_percentage = int(width), int(height), 100
        render.pixel_aspect_x, render.pixel_aspect_y = max(aspect, 1.0), max(1 / aspect, 1.0)


def picture_size(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Width and height of a render in pixels, as Blender rounds them; at least one."""
    percent = render.resolution_percentage
    return max(render.resolution_x * percent // 100, 1), max(render.resolution_y * percent // 100, 1)


def camera_numbers(scene: bpy.types.Scene, obj: bpy.types.Object, eye: Eye | None = None) -> Camera:
    """The camera of a camera object at the resolution of the render. Raises ``ValueError`` for panoramas and others."""
    data, render = obj.data, scene.render
    if obj.type != "CAMERA" or data.type not in ("PERSP", "ORTHO"):  # Blender looks through any object
        problem = 'the camera "{name}" has the type {kind}; splats need a perspective or orthographic camera'
        raise ValueError(told(problem, name=obj.name, kind=type_name(data if obj.type == "CAMERA" else obj)))
    pose, shift_x = eye or (obj.matrix_world.normalized(), data.shift_x)
    width, height = picture_size(render)
    ax, ay = render.pixel_aspect_x, render.pixel_aspect_y
    horizontal = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and width * ax >= height * ay)
    size = width * ax if horizontal else height * ay
    sensor, parallel = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width, data.type == "ORTHO"
    focal = size / data.ortho_scale if parallel else data.lens / sensor * size
    cx, cy = width / 2 - shift_x * size / ax, height / 2 + data.shift_y * size / ay
    c2w = unsheared(np.array(pose, np.float64)) @ OPENCV_FROM_OPENGL
    numbers = focal / ax, focal / ay, cx, cy, width, height
    return Camera(obj.name, np.linalg.inv(c2w), *numbers, orthographic=parallel)


def is_sheared(obj: bpy.types.Object) -> bool:
    """Whether Blender shows a camera's picture sheared, as its parents are scaled unevenly."""
    pose = np.array(obj.matrix_world.normalized(), np.float64)
    return unsheared(pose) is not pose


def pinhole_numbers(scene: bpy.types.Scene, obj: bpy.types.Object) -> Camera:
    """The same, for what only pinholes can be used for. Raises ``ValueError`` for all others."""
    camera = camera_numbers(scene, obj)
    if camera.orthographic:
        problem = 'the camera "{name}" is orthographic; this needs a perspective camera'
        raise ValueError(told(problem, name=obj.name))
    if is_sheared(obj):
        raise ValueError(told('the camera "{name}" is sheared by its parents; apply their scale', name=obj.name))
    if np.linalg.det(camera.w2c[:3, :3]) < 0:
        raise ValueError(told('the camera "{name}" is mirrored; make its scale, and those of its parents, positive',
                              name=obj.name))  # fmt: skip
    return camera


def rendered_part(render: bpy.types.RenderSettings, camera: Camera) -> Camera:
    """The camera of the region that is rendered, where there is one, cut off where Blender cuts it."""
    if not render.use_border:
        return camera
    size = np.array((camera.width, camera.height), np.float32)  # single precision, as in Blender
    left, low = (size * np.float32((render.border_min_x, render.border_min_y))).astype(int).tolist()
    right, high = (size * np.float32((render.border_max_x, render.border_max_y))).astype(int).tolist()
    return camera.window(left, camera.height - high, right, camera.height - low)
