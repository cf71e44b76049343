"""Cameras around or inside of the subject, as objects that may be moved, deleted and added to before they render."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ..cameras.camera import Camera
from ..cameras.objects import pinhole_numbers
from ..files.errors import told
from .borrowed import Borrowed
from .rig import around, distance, held_out, inside
from .room import is_free
from .settings import DogSplatTrainingSettings
from .subject import framed, sphere, subject_objects

RIG = "DoG Splat Rig"  # the collection, and a mark on the cameras that were not made by hand
FOV = 40.0  # degrees, of a scene without camera
NEAR, FAR = 1e-3, 1e3  # clipping distances, times the distance of the cameras
LENS = ("lens", "sensor_width", "sensor_height", "sensor_fit")


class DOGSPLAT_OT_make_cameras(bpy.types.Operator):
    """Make the cameras of the rig. You can move, delete and add cameras before rendering"""

    bl_idname = "dogsplat.make_cameras"
    bl_label = "Make Cameras"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """In object mode, where the subject is what it will be."""
        return context.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """In place of those that it made before."""
        try:
            made = make_rig(context)
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        n_test = len(held_out(len(made)))
        self.report({"INFO"}, told("{n} cameras, {n_test} of them for testing", n=len(made), n_test=n_test))
        return {"FINISHED"}


def rig_cameras(settings: DogSplatTrainingSettings) -> list[bpy.types.Object]:
    """In the order of their names."""
    if (rig := _own_rig(settings)) is None:
        return []
    return sorted((obj for obj in rig.objects if obj.type == "CAMERA"), key=lambda obj: obj.name)


def make_rig(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The cameras of a new rig, which the settings know. Raises ``ValueError``."""
    scene, settings = context.scene, context.scene.dogsplat_training
    if settings.elevations[0] > settings.elevations[1]:
        raise ValueError("the lowest elevation is above the highest; exchange them")
    objects = subject_objects(context, settings)
    points = framed(context, settings, objects)
    data = _lens(scene)
    try:
        poses, reach = _poses(context, points, _numbers(scene, data))
    except ValueError:
        bpy.data.cameras.remove(data)
        raise
    data.clip_start, data.clip_end = NEAR * reach, FAR * reach
    data.display_size = 0.1 * reach
    seen_through = scene.camera is not None and RIG in scene.camera
    collection = _emptied(scene, settings)
    for i, pose in enumerate(poses):
        obj = bpy.data.objects.new(f"View {i:03d}", data)
        obj.matrix_world = Matrix(pose)
        obj[RIG] = True
        collection.objects.link(obj)
    settings.subjects.clear()
    for obj in objects:
        settings.subjects.add().object = obj
    if seen_through and scene.camera is None:  # it was one of those that are gone
        scene.camera = rig_cameras(settings)[0]
    context.view_layer.update()
    return rig_cameras(settings)


def _lens(scene: bpy.types.Scene) -> bpy.types.Camera:
    """A camera with the lens of the scene's own, without its shift and depth of field. Raises ``ValueError``."""
    data = bpy.data.cameras.new(RIG)
    if scene.camera is None or scene.camera.type != "CAMERA":
        data.angle = np.radians(FOV)
        return data
    own = scene.camera.data
    data.type = own.type
    for name in LENS:
        setattr(data, name, getattr(own, name))
    return data


def _numbers(scene: bpy.types.Scene, data: bpy.types.Camera) -> Camera:
    """Of this lens at the size of the pictures. Raises ``ValueError`` for one that is no pinhole."""
    probe = bpy.data.objects.new(scene.camera.name if scene.camera else RIG, data)
    try:
        with Borrowed() as borrowed:
            borrowed.set_size(scene)
            return pinhole_numbers(scene, probe)
    finally:
        bpy.data.objects.remove(probe)


def _poses(context: bpy.types.Context, points: np.ndarray, lens: Camera) -> tuple[list[np.ndarray], float]:
    """(camera-to-world matrices [4, 4], how far the cameras see at most what they are for)."""
    settings = context.scene.dogsplat_training
    n, band = settings.views + settings.views // 6, tuple(settings.elevations)
    center, radius = sphere(points)
    if settings.rig == "AROUND":
        reach = distance(radius, lens, settings.zoom)
        return around(center, reach, n, band), reach
    low, high = points.min(axis=0), points.max(axis=0)
    depsgraph = context.evaluated_depsgraph_get()
    return inside(low, high, n, band, lambda place: is_free(context.scene, depsgraph, place, low, high)), radius


def _emptied(scene: bpy.types.Scene, settings: DogSplatTrainingSettings) -> bpy.types.Collection:
    """The rig's collection without the cameras that were made before; those that were added by hand stay."""
    settings.cameras = _own_rig(settings) or bpy.data.collections.new(RIG)
    if not _has(scene, settings.cameras):
        scene.collection.children.link(settings.cameras)
    for obj in [obj for obj in settings.cameras.objects if RIG in obj]:
        data = obj.data
        bpy.data.objects.remove(obj)
        if not data.users:
            bpy.data.cameras.remove(data)
    return settings.cameras


def _own_rig(settings: DogSplatTrainingSettings) -> bpy.types.Collection | None:
    """The rig's collection; None for that of another scene, whose settings a new scene may have copied."""
    rig, scene = settings.cameras, settings.id_data
    if rig is None or _has(scene, rig):
        return rig
    return None if any(_has(other, rig) for other in bpy.data.scenes) else rig


def _has(scene: bpy.types.Scene, collection: bpy.types.Collection) -> bool:
    return collection in scene.collection.children_recursive
