"""Objects from one kind of splats to the other: in the same place, under the same name, for all that refers to them."""

from __future__ import annotations

import bpy

from ..files.model import Model
from ..nodes.modifier import SHOWN, add_modifier, get_input, has_input, set_input, splat_modifier
from ..objects.attributes import NATIVE_OPACITY, NATIVE_SCALE, write_attributes
from ..objects.cloud import write_cloud
from ..objects.columns import POINT_FIELDS, Geometry, get_column, put_column
from ..objects.conventions import DRAWING

# TIMES: of a strip, in the order in which they can be set. DERIVED: what a name, other properties or the data decide
DERIVED = ("name", "dimensions", "matrix_world", "matrix_local", "matrix_basis", "use_fake_user",
           "active_material_index", "active_shape_key_index")  # fmt: skip
TIMES = ("action_frame_start", "action_frame_end", "frame_start", "frame_end", "scale", "repeat")
VALUES = ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM")


def drawing_of(obj: bpy.types.Object) -> dict:
    """How our modifier draws the splats of an object, or drew them before they became native."""
    modifier = splat_modifier(obj)
    if modifier is None:
        return dict(obj.get(DRAWING, {}))
    return {name: get_input(modifier, name) for name in SHOWN if has_input(modifier, name)}


def native_object(obj: bpy.types.Object, shown: bpy.types.Mesh, model: Model, plain: Model) -> bpy.types.Object:
    """A native object of ``model``, drawn as ``plain``; other attributes of its points are those of ``shown``."""
    cloud = bpy.data.pointclouds.new(obj.data.name)
    write_cloud(cloud, model, plain)
    _copy_attributes(shown, cloud)
    drawing = drawing_of(obj)
    new = successor(obj, cloud)
    new[DRAWING] = drawing
    return new


def dog_object(obj: bpy.types.Object, shown: bpy.types.PointCloud, model: Model) -> bpy.types.Object:
    """An object that our modifier draws, of the splats of a native one."""
    mesh = bpy.data.meshes.new(obj.data.name)
    write_attributes(mesh, model)
    _copy_attributes(shown, mesh, but=(NATIVE_SCALE, NATIVE_OPACITY, "radius"))
    drawing = drawing_of(obj)
    new = successor(obj, mesh)
    modifier = add_modifier(new)
    for name, value in drawing.items():
        set_input(modifier, name, value)
    if DRAWING in new:
        del new[DRAWING]
    return new


def replace_object(old: bpy.types.Object, new: bpy.types.Object) -> None:
    """Put an object in the place of another one, in collections, parents, constraints, drivers; the other one goes."""
    names = old.name, old.data.name
    old.user_remap(new)
    remove_object(old)
    new.name, new.data.name = names


def remove_object(obj: bpy.types.Object) -> None:
    """Remove an object, and its data where no other one has them."""
    data = obj.data
    bpy.data.objects.remove(obj)
    if not data.users:
        (bpy.data.meshes if isinstance(data, bpy.types.Mesh) else bpy.data.pointclouds).remove(data)


def successor(obj: bpy.types.Object, data: Geometry) -> bpy.types.Object:
    """An object of other data, in no collection yet, with the place and the properties of the old one."""
    new = bpy.data.objects.new(obj.name, data)
    new.parent, new.rotation_mode = obj.parent, obj.rotation_mode  # first: Blender turns rotations into another mode
    _copy_values(obj, new, DERIVED)
    for constraint in obj.constraints:
        new.constraints.copy(constraint)
    for key, value in obj.items():
        new[key] = value
    if obj.animation_data is not None:
        _copy_animation(obj.animation_data, new.animation_data_create())
    return new


def _copy_values(old: bpy.types.bpy_struct, new: bpy.types.bpy_struct, but: tuple[str, ...] = ()) -> None:
    """Properties of Blender's own that can be set, and are no other things."""
    for known in old.bl_rna.properties:
        name = known.identifier
        if known.type in VALUES and not known.is_readonly and not known.is_runtime and name not in but:
            if getattr(new, name) != (value := getattr(old, name)):
                setattr(new, name, value)


def _copy_animation(old: bpy.types.AnimData, new: bpy.types.AnimData) -> None:
    """Keys, tracks and drivers, but for drivers of modifiers, which the other has by itself or not at all."""
    if old.action is not None:
        new.action = old.action
        if hasattr(new, "action_slot"):  # from Blender 4.4 on
            new.action_slot = old.action_slot
    for track in old.nla_tracks:
        other = new.nla_tracks.new()
        for strip in track.strips:
            if strip.action is not None:
                copied = other.strips.new(strip.name, round(strip.frame_start), strip.action)
                if hasattr(copied, "action_slot"):
                    copied.action_slot = strip.action_slot
                _copy_values(strip, copied, TIMES)
                for name in TIMES:
                    setattr(copied, name, getattr(strip, name))
        _copy_values(track, other)
    for driver in old.drivers:
        if not driver.data_path.startswith("modifiers"):
            new.drivers.from_existing(src_driver=driver)


def _copy_attributes(source: Geometry, target: Geometry, but: tuple[str, ...] = ()) -> None:
    """Attributes of points that the other one has not got."""
    for attribute in source.attributes:
        name, kind = attribute.name, attribute.data_type
        fits = attribute.domain == "POINT" and kind in POINT_FIELDS and not name.startswith(".")
        if fits and name not in target.attributes and name not in but:
            put_column(target, name, get_column(source, name, POINT_FIELDS[kind][1]), kind)
