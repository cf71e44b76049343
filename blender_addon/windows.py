"""What Blender's windows show while something is at work that they do not wait for."""

from __future__ import annotations

import bpy


def redraw(context: bpy.types.Context) -> None:
    """The panels of all viewports, which show how far it is."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def is_edited(window: bpy.types.Window) -> bool:
    """Whether a window is in a mode whose steps of undo have no new objects."""
    active = window.view_layer.objects.active
    return active is not None and active.mode != "OBJECT"


def tell(context: bpy.types.Context, trouble: str) -> None:
    """Show what went wrong at the mouse: a timer has no reports."""

    def draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
        menu.layout.label(text=trouble, translate=False)

    for window in list(context.window_manager.windows)[:1]:
        with context.temp_override(window=window):
            context.window_manager.popup_menu(draw, title="DoG Splat", icon="ERROR")
