"""Tells moving viewports from resting ones, and the models what to show in each.

A viewport that is drawn tells its view. Nothing may be changed while drawing, so a timer does it: as long as views
come that differ from the last one of their viewport, models show a share of their splats; a little after the last such
view they show all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import bpy

from ..evaluated.placed import objects_in
from ..nodes.modifier import get_input, has_input, set_input, splat_modifier
from ..nodes.tree import VIEW_MIRROR
from ..objects.attributes import is_splats
from .pace import REST
from .tagged import TAGGED
from .view import View, view_inputs

TICKS = 3  # of the timer without another view: a drawing may take longer than REST
INTERVAL = 0.03  # of the timer
COARSE = "4"  # pixels of the window to a drawn one, along each axis
OWN_PIXELS = "dogsplat_preview_pixel_size"  # a coarse scene's own setting, kept in it: undo takes both back


class Shown(NamedTuple):
    """What viewports show: so many splats (0: all), as points and in coarse pixels where drawing is slow."""

    count: int = 0
    points: bool = False


ALL = Shown()
ShownIn = Callable[[bpy.types.Scene], Shown]


def everything(scene: bpy.types.Scene) -> Shown:
    """All splats, in any scene."""
    return ALL


class Watcher:
    """The state of all viewports. Each is known by its region: what is drawn in another one moves none."""

    def __init__(self) -> None:
        self.changed = float("-inf")
        self.ticks = TICKS
        self._seen: dict[int, tuple[str, View]] = {}  # by region: the name of its scene, and the view that was drawn
        self._ours: dict[int, bool] = {}  # by region: whether our engine draws it
        self._followed: dict[str, View] = {}  # by scene: the view of the viewport that moved last
        self._due: set[str] = set()  # names of the scenes that the timer brings up to date

    def see(self, region: int, scene: bpy.types.Scene, view: View, now: float) -> bool:
        """Note the view that is drawn in a region; whether it is another one, so that the timer is needed."""
        seen = scene.name, view
        if self._seen.get(region) == seen:
            return False
        self._seen[region], self._followed[scene.name] = seen, view
        self.changed, self.ticks = now, 0
        self._due.add(scene.name)
        return True

    def draws(self, region: int, scene: bpy.types.Scene, ours: bool) -> bool:
        """Note whether our engine draws a region; whether that is new, so that the timer is needed."""
        new = ours != self._ours.get(region, False)
        self._ours[region] = ours
        if ours or new:
            self._due.add(scene.name)
        return new

    def tick(self, now: float, while_moving: ShownIn, at_rest: ShownIn = everything) -> float | None:
        """Bring the models of those scenes up to date; seconds until the next time, None at rest."""
        self.ticks += 1
        moving = now - self.changed < REST or self.ticks < TICKS
        for scene in filter(None, map(bpy.data.scenes.get, self._due)):
            self.show(scene, (while_moving if moving else at_rest)(scene))
        if moving:
            return INTERVAL
        self._due.clear()
        return None

    def show(self, scene: bpy.types.Scene, shown: Shown) -> None:
        """Let a scene show that, made for the view where it follows it, else for the camera."""
        if shown.points and OWN_PIXELS not in scene:
            scene[OWN_PIXELS] = scene.render.preview_pixel_size
            scene.render.preview_pixel_size = COARSE
        elif not shown.points and OWN_PIXELS in scene:
            scene.render.preview_pixel_size = scene.pop(OWN_PIXELS)
        show_models(scene, shown, self._followed.get(scene.name) if scene.dogsplat_follow_view else None)

    def forget(self) -> None:
        """Another file was read: its viewports have not been drawn yet."""
        for known in (self._seen, self._ours, self._followed, self._due):
            known.clear()


def show_models(scene: bpy.types.Scene, shown: Shown, view: View | None) -> None:
    """Let the models of a scene show their most important splats, made for a view or the camera."""
    models, own = list(drawn_models(scene)), set(scene.objects)
    total = sum(len(obj.data.vertices) for obj, _ in models)
    share = min(1.0, shown.count / total) if shown.count and total else 1.0
    for obj, modifier in models:
        inputs = {"Moving Share": share, "Moving Points": shown.points}
        # Quads that are made for a view would stand wrong where instances have other places than their objects
        inputs |= view_inputs(view) if view is not None and obj in own else {"View": False}
        changed = [name for name, value in inputs.items() if not _same(get_input(modifier, name), value)]
        for name in changed:
            set_input(modifier, name, inputs[name])
        if changed:
            TAGGED.tag(obj)


def drawn_models(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, bpy.types.Modifier]]:
    """Models of this file that a viewport can show, with the modifiers that draw them."""
    for obj in objects_in(scene):
        if is_splats(obj) and obj.library is None and not obj.hide_viewport:
            modifier = splat_modifier(obj)
            if modifier is not None and has_input(modifier, VIEW_MIRROR):  # trees of older versions have none
                yield obj, modifier


def _same(a: Any, b: Any) -> bool:
    if isinstance(b, Iterable):
        return all(abs(x - y) <= 1e-6 * max(1.0, abs(y)) for x, y in zip(a, b, strict=True))
    return abs(a - b) <= 1e-6
