"""Panels of the add-on, drawn into what stands in for Blender's layout, which needs a window."""

from functools import partial
from types import SimpleNamespace

import bpy

from blender_addon.panel import DOGSPLAT_PT_panel

NO_CAMERA = "Colors need an active camera, or Follow View"


class Layout:
    """Stands in for Blender's layout; it checks what it is asked to draw."""

    def __init__(self):
        self.drawn = []

    def operator(self, name, **options):
        category, _, function = name.partition(".")
        getattr(getattr(bpy.ops, category), function).get_rna_type()  # raises where there is none
        self.drawn.append(name)
        return SimpleNamespace()

    def progress(self, factor, text, translate=True):
        assert 0 <= factor <= 1
        self.drawn.append(text)

    def prop(self, data, name, **options):
        data.path_resolve(name)
        self.drawn.append(options.get("text", name))

    def prop_enum(self, data, name, value, **options):
        assert value in data.bl_rna.properties[name].enum_items
        self.drawn.append(options["text"])

    def label(self, **options):
        self.drawn.append(options["text"])

    def row(self, **options):
        return self

    column = box = row

    def operator_menu_enum(self, name, menu, **options):
        self.operator(name)
        category, _, function = name.partition(".")
        assert menu in getattr(getattr(bpy.ops, category), function).get_rna_type().properties

    def separator(self):
        pass


def viewport():
    """The space of a viewport of the file: there is one, though no window shows it."""
    spaces = [area.spaces.active for screen in bpy.data.screens for area in screen.areas]
    return next(space for space in spaces if space.type == "VIEW_3D")


def drawn() -> list[str]:
    """What the panel of the add-on shows in that viewport, of what is active."""
    layout = Layout()
    panel = SimpleNamespace(layout=layout)
    for part in ("_model", "_viewport"):
        setattr(panel, part, partial(getattr(DOGSPLAT_PT_panel, part), panel))
    context = SimpleNamespace(object=bpy.context.object, scene=bpy.context.scene, space_data=viewport())
    DOGSPLAT_PT_panel.draw(panel, context)
    return layout.drawn
