"""Settings of a scene that views are rendered with, all of which are given back."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import bpy

from ..evaluated.masks import UNSEEN
from ..files.errors import told
from ..objects.working_space import OURS
from .surrounding_collections import chains, rendered_objects

OFF = (
    "use_border", "use_multiview", "use_motion_blur", "use_compositing", "use_sequencer", "use_stamp",
    "use_placeholder", "use_single_layer",
)  # fmt: skip


class Borrowed:
    """``with Borrowed() as borrowed``: what is set through it has its old value again afterwards."""

    def __init__(self):
        self._before: dict[tuple[int, str], tuple[Any, str, Any]] = {}
        self._undo: list[Callable[[], None]] = []

    def __enter__(self) -> Borrowed:
        return self

    def __exit__(self, *_: object) -> None:
        self.give_back()

    def set(self, owner: Any, **values: Any) -> None:
        """Set properties of numbers, names and objects, as far as this Blender has them.

        What one of them changes of the others is given back too: all are looked at before the first is set.
        """
        known = {name: value for name, value in values.items() if hasattr(owner, name)}
        for name in known:
            self._before.setdefault((owner.as_pointer(), name), (owner, name, getattr(owner, name)))
        for name, value in known.items():
            setattr(owner, name, value)

    def give_back(self) -> None:
        """In the order in which they were set: what a view transform or a file format allows depends on it."""
        for owner, name, value in self._before.values():
            try:
                setattr(owner, name, value)
            except (AttributeError, ReferenceError, TypeError):
                continue  # of something that is not there any more
        for undo in self._undo:
            undo()
        self._before.clear()
        self._undo.clear()

    def keep(self, owner: Any, name: str) -> None:
        """Have a property as it is now again at the very end: Blender itself changes it with others."""
        if hasattr(owner, name):
            value = getattr(owner, name)

            def give() -> None:
                with suppress(AttributeError, ReferenceError, TypeError):  # TypeError: it had no value that can be set
                    setattr(owner, name, value)

            self._undo.append(give)

    def set_size(self, scene: bpy.types.Scene) -> None:
        """Pictures as large as the settings of the training say, with square pixels."""
        render, (width, height) = scene.render, scene.dogsplat_training.size
        self.set(render, resolution_x=width, resolution_y=height, resolution_percentage=100)
        self.set(render, pixel_aspect_x=1.0, pixel_aspect_y=1.0)

    def set_picture(self, scene: bpy.types.Scene) -> None:
        """Display values of sRGB, which models are trained in, or linear radiance; nothing on top of the render."""
        render, settings = scene.render, scene.dogsplat_training
        image = render.image_settings
        self.keep(image, "views_format")  # a file format may have no such views
        self.keep(image.linear_colorspace_settings, "name")  # each file format begins with one of its own
        # Files that override the scene's color management lose their own once they follow the scene
        managed = image if image.color_management == "OVERRIDE" else scene
        self.set(render, **dict.fromkeys(OFF, False), use_persistent_data=True, dither_intensity=0.0)
        self.set(render, use_overwrite=True, use_file_extension=True, film_transparent=settings.transparent)
        self.set(managed.display_settings, display_device="sRGB")
        self.set(
            managed.view_settings, view_transform="Standard", look="None", exposure=0.0, gamma=1.0,
            use_curve_mapping=False, use_white_balance=False,
        )  # fmt: skip
        self.set(
            image,
            media_type="IMAGE",
            file_format="OPEN_EXR" if settings.linear else "PNG",
            color_mode="RGBA" if settings.transparent else "RGB",
            color_depth="16" if settings.linear else "8",
        )
        if settings.linear:  # in whatever space the file is
            self.set(image, color_management="OVERRIDE")
            self.set(image.linear_colorspace_settings, name=OURS)

    def set_visible(self, scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> None:
        """The subject, even where a model has taken its place, without the others if it is to be alone.

        Raises ``ValueError`` where it was deleted, or where its collections hide it from renders: these may hold more
        than the subject.
        """
        settings = scene.dogsplat_training
        subject, rendered = settings.objects(), rendered_objects(layer)
        if settings.subjects and not subject:
            raise ValueError("the objects that the cameras were made for are deleted; select others, make new cameras")
        for other in scene.view_layers:  # of several, a picture is that of the first
            self.set(other, use=other == layer)
        for obj in subject:
            if obj not in rendered:
                problem = '"{name}" is in no collection that this view layer renders; show one, or make new cameras'
                raise ValueError(told(problem, name=obj.name))
            self.set(obj, hide_render=False, hide_viewport=False)
            self._show(layer, obj)
        self._show_collections(layer, set(subject))
        if settings.result is not None:
            self.set(settings.result, hide_render=True)
        for obj in hidden_objects(scene):
            if obj.type == "EMPTY":  # what it makes cannot light without being seen
                self.set(obj, hide_render=True)
            else:
                self.set(obj, visible_camera=False)

    def _show(self, layer: bpy.types.ViewLayer, obj: bpy.types.Object) -> None:
        """In the view layer, for what asks where its surfaces are."""
        if obj.name in layer.objects and obj.hide_get(view_layer=layer):
            obj.hide_set(False, view_layer=layer)
            self._undo.append(lambda: obj.hide_set(True, view_layer=layer))

    def _show_collections(self, layer: bpy.types.ViewLayer, subject: set[bpy.types.Object]) -> None:
        """For the same; renders have them anyway."""
        for chain in chains(layer):
            if subject.isdisjoint(chain[-1].collection.objects):
                continue
            for owner in (owner for part in chain for owner in (part, part.collection) if owner.hide_viewport):
                self.set(owner, hide_viewport=False)


def hidden_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Those that cameras are not to see."""
    settings = scene.dogsplat_training
    if not settings.alone or settings.subject != "SELECTED":
        return []
    subject = settings.objects()
    others = [obj for obj in scene.objects if obj not in subject and obj.type not in UNSEEN]
    return [obj for obj in others if obj.type != "EMPTY" or obj.instance_type != "NONE"]
