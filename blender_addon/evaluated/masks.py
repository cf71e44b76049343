"""How cameras see objects, as Cycles has it: of instances, what makes them says so."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from .visible import all_objects

HOLDOUT, INDIRECT_ONLY = "holdout", "indirect_only"  # as requests call them; what has neither is seen as it is
UNSEEN = ("LIGHT", "CAMERA", "LIGHT_PROBE", "SPEAKER")  # kinds of objects that cameras never see


def mask_of(owner: bpy.types.Object, obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> str:
    """One of the above, or nothing. ``owner``: the original object, or that which makes the instance ``obj``.

    Keys count as they are in the frame, which in Render Animation only the evaluated objects know.
    """
    owner, obj, layer = owner.evaluated_get(depsgraph), obj.evaluated_get(depsgraph), depsgraph.view_layer_eval
    if not (owner.visible_camera and obj.visible_camera):
        return INDIRECT_ONLY
    if owner.holdout_get(view_layer=layer):
        return HOLDOUT
    return INDIRECT_ONLY if owner.indirect_only_get(view_layer=layer) else ""


def masks_in(depsgraph: bpy.types.Depsgraph) -> frozenset[tuple[str, str]]:
    """(full name, mask) of the objects that have one."""
    originals = [obj.original for obj in all_objects(depsgraph)]
    return frozenset((obj.name_full, mask) for obj in originals if (mask := mask_of(obj, obj, depsgraph)))


def numbered(masks: Iterable[str]) -> dict[str, list[int]]:
    """The fields of a request, of the masks of all objects by their numbers; none where all are seen as they are."""
    found: dict[str, list[int]] = {}
    for number, mask in enumerate(masks):
        if mask:
            found.setdefault(mask, []).append(number)
    return found
