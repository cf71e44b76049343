"""A trained model in place of what it was trained on."""

from __future__ import annotations

from pathlib import Path

import bpy

from .deleted import is_there


def place_result(context: bpy.types.Context, model: Path) -> bpy.types.Object:
    """Import a model, whose coordinates are those of the world, and hide what it shows if that is wanted.

    Raises ``RuntimeError``, as operators do.
    """
    settings = context.scene.dogsplat_training
    subject = settings.objects()
    bpy.ops.import_scene.dogsplat(filepath=str(model), place=False)
    obj = context.view_layer.objects.active
    obj.name = f"{subject[0].name if len(subject) == 1 else context.scene.name} Splats"
    earlier = settings.result if is_there(settings.result, context.scene) else None
    settings.result = obj
    for hidden in [*(subject if settings.hide_originals else []), *([earlier] if earlier else [])]:
        hidden.hide_render = True
        if hidden.name in context.view_layer.objects:
            hidden.hide_set(True)
    return obj
