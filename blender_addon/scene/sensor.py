"""The camera of a scene as a sensor: lens shift, sensor fit, clipping, depth of field."""

from __future__ import annotations

import math

import bpy
import numpy as np

from ..cameras.camera import Camera
from .export import Plugin, matrix

STDDEV_OF_WIDTH = 0.14  # of the Blackman-Harris filter that Blender's engines have
SHARP = 0.05  # pixels of a filter that is none
MITSUBA_FROM_OPENCV = np.diag([-1.0, -1.0, 1.0, 1.0])  # both look along z; x and y are turned


def sensor(scene: bpy.types.Scene, obj: bpy.types.Object, camera: Camera) -> Plugin:
    """Of an evaluated camera object with these numbers, whose pixels are square."""
    data = obj.data
    to_world = np.linalg.inv(camera.w2c) @ MITSUBA_FROM_OPENCV
    radius = 0.0 if camera.orthographic else _lens_radius(data)
    film: Plugin = {"type": "hdrfilm", "pixel_format": "rgba", "component_format": "float32"}
    blur = STDDEV_OF_WIDTH * scene.render.filter_size
    film["rfilter"] = {"type": "gaussian", "stddev": blur} if blur > SHARP else {"type": "box"}
    common = {"near_clip": data.clip_start, "far_clip": data.clip_end, "to_world": matrix(to_world), "film": film}
    whole = _whole(camera) if radius == 0 else _centered(_whole(camera))
    film |= _window(whole, camera)
    camera, width, height = whole, whole.width, whole.height
    if camera.orthographic:  # the axis is in the middle of the film, half of whose width is 1
        middle = np.eye(4)
        middle[:2, 3] = (camera.cx - width / 2) / camera.fx, (camera.cy - height / 2) / camera.fy
        half = width / 2 / camera.fx
        common["to_world"] = matrix(to_world @ middle @ np.diag([half, half, 1.0, 1.0]))
        return {"type": "orthographic", **common}
    if radius == 0:
        shift = {"principal_point_offset_x": 0.5 - camera.cx / width}
        shift["principal_point_offset_y"] = 0.5 - camera.cy / height
        return {"type": "perspective", "fov_axis": "x", "fov": _degrees(width, camera.fx), **shift, **common}
    lens = {"aperture_radius": radius, "focus_distance": _focus(obj)}
    return {"type": "thinlens", "fov_axis": "x", "fov": _degrees(width, camera.fx), **lens, **common}


def _whole(camera: Camera) -> Camera:
    """The camera of all of the picture of which it sees a part, to whole pixels."""
    return camera if camera.film is None else camera.window(*map(round, camera.film))


def _centered(camera: Camera) -> Camera:
    """The camera of a larger picture, whose axis is in its middle: a lens of Mitsuba has no other."""
    right, below = round(2 * camera.cx - camera.width), round(2 * camera.cy - camera.height)
    return camera.window(min(right, 0), min(below, 0), camera.width + max(right, 0), camera.height + max(below, 0))


def _window(whole: Camera, part: Camera) -> dict[str, int]:
    """The size of the film of a picture, and the window of it that a part of the picture is."""
    found = {"width": whole.width, "height": whole.height}
    if (whole.width, whole.height) != (part.width, part.height):
        found |= {"crop_width": part.width, "crop_height": part.height}
        found |= {"crop_offset_x": round(whole.cx - part.cx), "crop_offset_y": round(whole.cy - part.cy)}
    return found


def _degrees(pixels: int, focal: float) -> float:
    return math.degrees(2 * math.atan(pixels / (2 * focal)))


def _lens_radius(data: bpy.types.Camera) -> float:
    """0: a pinhole. The focal length is in millimetres, units of the scene are metres."""
    return data.lens / 1000 / (2 * data.dof.aperture_fstop) if data.dof.use_dof else 0.0


def _focus(obj: bpy.types.Object) -> float:
    """Along the axis, to the object in focus where there is one, or to its bone."""
    target, bone = obj.data.dof.focus_object, obj.data.dof.focus_subtarget
    if target is None:
        return max(obj.data.dof.focus_distance, 1e-4)
    place = target.matrix_world
    if bone and target.pose and bone in target.pose.bones:
        place = place @ target.pose.bones[bone].matrix
    offset = np.array(place.translation) - np.array(obj.matrix_world.translation)
    axis = -np.array(obj.matrix_world.normalized())[:3, 2]
    return max(float(offset @ axis), 1e-4)
