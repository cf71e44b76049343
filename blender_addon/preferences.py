"""Preferences of the add-on."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

ADDON = __package__ or ""  # under which Blender keeps the preferences


class DogSplatPreferences(bpy.types.AddonPreferences):
    """Where the exact renderer is."""

    bl_idname = ADDON

    command: StringProperty(
        name="Command dogsplat",
        subtype="FILE_PATH",
        description="Of the package mi_dogsplat, or words: python -m mi_dogsplat. Empty: this Python, else the PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """One field."""
        self.layout.prop(self, "command")


def command_of(context: bpy.types.Context) -> str:
    """The command in the preferences; empty where the add-on is not enabled as such."""
    addon = context.preferences.addons.get(ADDON)
    return addon.preferences.command if addon and addon.preferences else ""
