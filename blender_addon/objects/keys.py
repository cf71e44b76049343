"""What animates an object: its keys, in the action and in tracks of the nonlinear animation, and its drivers."""

from __future__ import annotations

import bpy

_Owner = bpy.types.AnimData | bpy.types.NlaStrip
# Of a transform, by what a rotation is given as; every other rotation mode is an order of Euler angles.
_ROTATIONS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}


def moves_by_itself(obj: bpy.types.Object) -> bool:
    """Whether keys or drivers that are not muted give the object its location, rotation or scale."""
    rotation = _ROTATIONS.get(obj.rotation_mode, "rotation_euler")
    names = {"location", "scale", rotation}
    names |= {f"delta_{name}" for name in names}
    curves = [curve for owner in _owners(obj) for curve in _curves(owner)]
    curves += obj.animation_data.drivers if obj.animation_data is not None else ()
    return any(curve.data_path in names and not _is_mute(curve) for curve in curves)


def scale_keys(obj: bpy.types.Object, path: str, factor: float) -> None:
    """Multiply the keys of a property, handles included, but for those of an action that other objects have too."""
    for owner in _owners(obj):
        if not _is_own(owner):
            continue
        for curve in _curves(owner):
            if curve.data_path == path:
                for key in curve.keyframe_points:
                    for name in ("co", "handle_left", "handle_right"):
                        setattr(key, name, (getattr(key, name)[0], getattr(key, name)[1] * factor))
                curve.update()


def _owners(obj: bpy.types.Object) -> list[_Owner]:
    """Who has an action that plays on the object."""
    animation = obj.animation_data
    if animation is None:
        return []
    tracks = animation.nla_tracks if animation.use_nla else ()
    strips = [strip for track in tracks if not track.mute for strip in track.strips if not strip.mute]
    return [owner for owner in (animation, *strips) if owner.action is not None]


def _curves(owner: _Owner) -> list[bpy.types.FCurve]:
    """The curves through the keys that are the object's: from Blender 4.4 on, those of its slot."""
    action = owner.action
    if not hasattr(action, "slots"):
        return list(action.fcurves)
    if owner.action_slot is None:
        return []
    bags = [strip.channelbag(owner.action_slot) for layer in action.layers for strip in layer.strips]
    return [curve for bag in bags if bag is not None for curve in bag.fcurves]


def _is_own(owner: _Owner) -> bool:
    action = owner.action
    users = len(owner.action_slot.users()) if hasattr(action, "slots") else action.users - action.use_fake_user
    return action.library is None and users == 1


def _is_mute(curve: bpy.types.FCurve) -> bool:
    return curve.mute or (curve.group is not None and curve.group.mute)
