"""Which of the objects that Blender has evaluated are shown.

The graph of a render holds what renders show. That of a viewport holds more than a viewport shows: collections whose
eye is closed, and what is outside of its local view. As with Blender's own engines, *Disable in Renders* is for renders
alone, and a viewport in *Rendered* shading shows what it shows in any shading.
"""

from __future__ import annotations

import bpy

from ..objects.attributes import has_splats


def all_objects(depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """Those of a graph, and those that show what they repeat and not themselves, which its ``objects`` lack.

    Others that it lacks, as those with a closed eye, show nothing.
    """
    shows_itself = f"show_instancer_for_{'render' if depsgraph.mode == 'RENDER' else 'viewport'}"
    objects = [thing for thing in depsgraph.ids if isinstance(thing, bpy.types.Object)]
    return [*depsgraph.objects, *(obj for obj in objects if not getattr(obj, shows_itself))]


def hidden_in(space: bpy.types.SpaceView3D, depsgraph: bpy.types.Depsgraph) -> frozenset[str]:
    """Full names of the objects of a viewport's graph that it does not show."""
    return frozenset(obj.name_full for obj in all_objects(depsgraph) if not obj.visible_in_viewport_get(space))


def is_shown(
    instance: bpy.types.DepsgraphObjectInstance, depsgraph: bpy.types.Depsgraph, hidden: frozenset[str]
) -> bool:
    """Whether a picture has it: not where what makes it is ``hidden``, nor what only helps to edit in a viewport."""
    owner = (instance.parent if instance.is_instance else instance.object).original
    if owner.name_full in hidden:
        return False
    return depsgraph.mode == "RENDER" or not (_helps(owner) or _helps(instance.object.original))


def _helps(obj: bpy.types.Object) -> bool:
    """What renders do not show and Blender draws as lines: a crop. Or what brushes paint in the place of splats."""
    return obj.hide_render and (obj.display_type in ("WIRE", "BOUNDS") or has_splats(obj.parent))
