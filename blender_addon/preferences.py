"""Preferences of the add-on."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, StringProperty

ADDON = __package__ or ""  # under which Blender keeps the preferences


class DogSplatPreferences(bpy.types.AddonPreferences):
    """Where the exact renderer is, and what follows by itself."""

    bl_idname = ADDON

    command: StringProperty(
        name="Command dogsplat",
        subtype="FILE_PATH",
        description="Path of the command dogsplat of the package mi_dogsplat, or words such as python -m mi_dogsplat. "
        "If empty: the package in Blender's Python, else the command on the PATH",
    )

    follow_vertices: BoolProperty(
        name="Splats Follow Their Points",
        default=True,
        description="Rotate and scale splats when Apply Transform, Join or edit mode moves their points",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """All fields."""
        self.layout.prop(self, "command")
        self.layout.prop(self, "follow_vertices")


def command_of(context: bpy.types.Context) -> str:
    """The command in the preferences; empty where the add-on is not enabled as such."""
    preferences = _preferences(context)
    return preferences.command if preferences else ""


def follows_vertices(context: bpy.types.Context) -> bool:
    """Whether splats turn and scale with vertices that other tools moved."""
    preferences = _preferences(context)
    return preferences is None or preferences.follow_vertices


def _preferences(context: bpy.types.Context) -> bpy.types.AddonPreferences | None:
    addon = context.preferences.addons.get(ADDON)
    return addon.preferences if addon else None
