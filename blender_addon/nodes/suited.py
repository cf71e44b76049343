"""Modifiers have the trees of this version of the add-on, for the working space of their file.

That space changes when somebody chooses another one. Objects come from files that have others, or that an older version
has saved.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..objects.attributes import can_edit, is_splats
from ..objects.working_space import working_space
from .crop import NAME as CROP
from .crop import crop_tree
from .groups import SPACE, version_of
from .limits import NAME as LIMITS
from .limits import limits_tree
from .material import VERSION
from .modifier import drive, is_driven, tree_name
from .paint import NAME as PAINT
from .paint import paint_tree
from .space import space_of
from .tree import NAME, splat_tree

COLORED = {NAME: splat_tree, PAINT: paint_tree}  # by working space
PLAIN = {CROP: crop_tree, LIMITS: limits_tree}


def suit(obj: bpy.types.Object) -> None:
    """Give the modifiers of an object other trees, with the same inputs, where theirs are older or for another space.

    The identifiers of inputs are the same in all versions, but for those that viewports write. So values, drivers and
    keys stay; those drivers that tell of the camera are made anew. They are also where they have gone: Blender's own
    Clear Animation Data and Link Animation Data take them along, and a copied modifier comes without. Trees of a newer
    version are left alone.
    """
    if not can_edit(obj):
        return
    space, changed = space_of(obj), False
    for modifier in obj.modifiers:
        name = tree_name(modifier)
        if name in COLORED and _gives_way(modifier.node_group, space):
            older = version_of(modifier.node_group) < VERSION
            modifier.node_group, changed = COLORED[name](space), True
            if older and name == NAME:
                drive(modifier)
        elif name in PLAIN and _gives_way(modifier.node_group, ""):
            modifier.node_group, changed = PLAIN[name](), True
        if name == NAME and version_of(modifier.node_group) == VERSION and not is_driven(modifier):
            drive(modifier)
            changed = True
    if changed:
        obj.update_tag()


def _gives_way(group: bpy.types.NodeTree, space: str) -> bool:
    version = version_of(group)
    return version < VERSION or version == VERSION and group.get(SPACE, "") != space


def is_suited(obj: bpy.types.Object) -> bool:
    """Whether Blender's engines draw the colours of an object's splats as they are in this file."""
    space = space_of(obj)
    return all(modifier.node_group.get(SPACE, "") == space for modifier in obj.modifiers
               if tree_name(modifier) in COLORED)  # fmt: skip


def suit_all() -> None:
    """All of this file."""
    for obj in bpy.data.objects:
        if is_splats(obj):
            suit(obj)


_latest = ""  # the working space for which all are suited


@persistent
def _loaded(*_: Any) -> None:
    global _latest
    _latest = working_space()
    suit_all()


@persistent
def _changed(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Another space is chosen, or objects have come from another file, which may be an older one."""
    if working_space() != _latest:
        _loaded()
        return
    for update in depsgraph.updates:
        if isinstance(update.id, bpy.types.Object) and is_splats(update.id.original):
            suit(update.id.original)


def register() -> None:
    """The handlers."""
    bpy.app.handlers.load_post.append(_loaded)
    bpy.app.handlers.depsgraph_update_post.append(_changed)


def unregister() -> None:
    """The same backwards."""
    bpy.app.handlers.depsgraph_update_post.remove(_changed)
    bpy.app.handlers.load_post.remove(_loaded)
