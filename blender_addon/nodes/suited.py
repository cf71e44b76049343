"""Modifiers have the trees for the working space of their file, whatever that was when they were made.

It changes when somebody chooses another one. Objects come from files that have others.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..objects.attributes import can_edit, is_splats
from ..objects.working_space import working_space
from .groups import SPACE, is_current
from .modifier import tree_name
from .paint import NAME as PAINT
from .paint import paint_tree
from .space import space_of
from .tree import NAME, splat_tree

MAKERS = {NAME: splat_tree, PAINT: paint_tree}  # of trees with colours in them


def suit(obj: bpy.types.Object) -> None:
    """Give the modifiers of an object other trees, with the same inputs, where theirs are for another space."""
    if not is_suited(obj) and can_edit(obj):
        space = space_of(obj)
        for modifier in obj.modifiers:
            name = tree_name(modifier) or ""
            if name in MAKERS and is_current(modifier.node_group, name):
                modifier.node_group = MAKERS[name](space)
        obj.update_tag()


def is_suited(obj: bpy.types.Object) -> bool:
    """Whether Blender's engines draw the colours of an object's splats as they are in this file."""
    space = space_of(obj)
    return all(modifier.node_group.get(SPACE, "") == space for modifier in obj.modifiers
               if tree_name(modifier) in MAKERS)  # fmt: skip


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
    """Another space is chosen, or objects have come from another file."""
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
