"""A viewport in *Rendered* shading with the engine *DoG Splat (Mitsuba)*: what it shows, and when it asks for more."""

from __future__ import annotations

import math
import time
import weakref
from typing import Any

import bpy
import numpy as np

from ..engine.order import Stage, camera_request, make_stage, near_clip_of, square, tidy
from ..engine.passes import background
from ..evaluated.masks import masks_in
from ..evaluated.visible import hidden_in
from ..package.live import live_renderer
from ..package.served import RendererError
from ..preferences import command_of
from .blit import Blit
from .changes import Changes
from .looking_through import corners_of, looked_through
from .pace import Level, Pace
from .region import Part, Seen, rendered_part, seen_by
from .stream import Stream

INTERVAL = 0.01  # seconds between two looks for a new picture
PAUSE = 2.0  # between two stages, of the time that the former took: Blender needs some for itself
PATIENCE = 3.0  # seconds in which a viewport is drawn that is on the screen at all
_SHOWN: weakref.WeakSet = weakref.WeakSet()


class Rendered:
    """One viewport. It shows the newest picture that is finished and asks for the one of its view."""

    def __init__(self):
        self._pace, self._blit, self._changes = Pace(), Blit(), Changes()
        self._stream: Stream | None = None
        self._folder: Any = None  # of what the stream reads
        self._files: set[str] = set()  # in it, of the latest stage that was written whole
        self._command = ""  # of the preferences, that the stream is for
        self._stage: Stage | None = None
        self._seen: Seen | None = None
        self._asked: tuple[dict[str, Any], bool] | None = None  # the latest request, and whether the view was at rest
        self._drawn = self._timed = 0  # of the news of the stream
        self._place = "", ""  # names of scene and view layer
        self._hidden: frozenset[str] = frozenset()  # full names of objects that are not shown
        self._masks: frozenset[tuple[str, str]] = frozenset()  # how cameras see objects
        self._problem, self._redraws = "", False
        self._next = -math.inf  # time before which no other stage is written
        self._undrawn = math.inf  # since when there has been something to draw
        _SHOWN.add(self)

    @property
    def error(self) -> str:
        """Why there is no picture, one line; empty where nothing is wrong."""
        return self._problem or (self._stream.error if self._stream else "")

    @property
    def news(self) -> int:
        """How many pictures, and errors instead of them, there were."""
        return self._stream.news if self._stream else 0

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """What has changed since the last drawing."""
        self._changes.note(depsgraph)

    def draw(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Draw into the region of the context."""
        region, now = context.region, time.monotonic()
        seen = seen_by(context.region_data, region.width, region.height)
        corners, border = border_of(context, depsgraph)
        part = rendered_part(seen, corners, border)
        seen = seen.of_picture(corners).window(*part)
        if not seen.same(self._seen):
            self._seen = seen
            self._pace.moved(now)
        self._place = depsgraph.scene.name, depsgraph.view_layer.name
        self._changes.compare(depsgraph)
        if (hidden := hidden_in(context.space_data, depsgraph)) != self._hidden:
            self._hidden, self._changes.pending = hidden, True
        if (masks := masks_in(depsgraph)) != self._masks:
            self._masks, self._changes.pending = masks, True
        if (command := command_of(context)) != self._command:
            self._leave(command)
        if not bpy.app.timers.is_registered(look):
            bpy.app.timers.register(look, first_interval=0)
        self._redraws, self._undrawn = False, math.inf
        if self._stream is None or self._stage is None:
            return
        self._learn(self._stream)
        self._ask(self._stream, depsgraph.scene, seen, part, now)
        frame, self._drawn = self._stream.frame, self._stream.news
        if frame is not None:
            left, top, right, bottom = frame.tag[0]
            linear = self._stage.whole or depsgraph.scene.dogsplat_colors == "LINEAR"
            self._blit.draw(frame.pixels, left, region.height - bottom, right - left, bottom - top, linear)

    def _leave(self, command: str) -> None:
        """Another command is to draw: it gets a stream and a stage of its own."""
        if self._stream is not None:
            self._stream.close()
        self._command, self._changes.pending, self._next = command, True, -math.inf
        self._stream, self._stage, self._asked, self._files = None, None, None, set()
        self._drawn = self._timed = 0

    def restage(self) -> None:
        """Write what has changed since it was drawn, which cannot be done while drawing."""
        start = time.monotonic()
        if self._seen is None or not self._changes.pending or start < self._next:
            return
        self._changes.pending = False
        try:
            self._restage()
        finally:
            now = time.monotonic()
            self._next = now + PAUSE * (now - start)

    def _restage(self) -> None:
        scene = bpy.data.scenes.get(self._place[0])
        layer = scene and scene.view_layers.get(self._place[1])
        if layer is None:
            return
        self._redraws, self._problem = True, ""
        self._stage = None
        try:
            if self._stream is None:
                renderer = live_renderer(self._command)
                self._folder, self._stream = renderer.folder, Stream(renderer.pictures, renderer.close)
                weakref.finalize(self, self._stream.close)
            layer.depsgraph.update()
            assert self._seen
            self._stage = make_stage(layer.depsgraph, self._folder, self._seen.camera, self._hidden)
        except (ValueError, OSError, RendererError) as error:
            self._problem = str(error)
            return
        tidy(self._folder, self._stage.files | self._files)  # the stream may still read those
        self._files = self._stage.files

    def _learn(self, stream: Stream) -> None:
        """What the latest picture of a moving view took, once."""
        if stream.news != self._timed and stream.frame is not None:
            self._timed = stream.news
            _, level = stream.frame.tag
            if level is not None:
                self._pace.took(level, stream.frame.seconds)

    def _ask(self, stream: Stream, scene: bpy.types.Scene, seen: Seen, part: Part, now: float) -> None:
        """Have the picture made that is due, unless it is the one that was asked for last."""
        assert self._stage
        level, rests = self._pace.level(now), self._pace.rests(now)
        request = request_of(self._stage, scene, seen.scaled(level.pixels), level, rests)
        if self._asked is None or request != self._asked[0]:
            stream.ask(request, (part, None if rests else level))
        self._asked = request, rests

    def has_news(self, now: float) -> bool:
        """Whether it shall be drawn again: there is another picture or stage, or the view has come to rest."""
        news = self._redraws
        if not news and self._stream is not None and self._asked is not None:
            news = self._stream.news != self._drawn or (self._pace.rests(now) and not self._asked[1])
        if not news:
            return False
        self._undrawn = min(self._undrawn, now)
        return now - self._undrawn < PATIENCE

    def waits(self, now: float) -> bool:
        """Whether something is still to come."""
        busy = self._stream is not None and self._stream.busy()
        return busy or self._changes.pending or not self._pace.rests(now) or self.has_news(now)


def request_of(stage: Stage, scene: bpy.types.Scene, seen: Seen, level: Level, rests: bool) -> dict[str, Any]:
    """The picture of a stage as ``dogsplat serve`` is asked for it."""
    request = stage.request | {"clip": list(seen.clip), "near_clip": near_clip_of(stage, seen.camera, seen.clip[0])}
    if stage.whole:
        settings = scene.dogsplat
        how = {"samples": settings.samples if rests else 0, "denoise": settings.denoise}
        return request | camera_request(square(seen.camera)) | how
    linear = scene.dogsplat_colors == "LINEAR"
    if not scene.render.film_transparent:
        request["background"] = np.asarray(background(scene, stage.light)).tolist()
    return request | camera_request(seen.camera) | {"share": level.splats, "linear": linear}


def border_of(context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray | None, Any]:
    """What ``rendered_part`` asks for: corners of the camera's picture, and the border of what is rendered.

    Of an object that is no camera there is no picture, and all of the region is drawn.
    """
    scene, space = depsgraph.scene, context.space_data
    if (camera := looked_through(context)) is None:
        return None, _border(space, "render_border") if space.use_render_border else None
    corners = corners_of(scene, camera.evaluated_get(depsgraph))
    return corners, None if corners is None or not scene.render.use_border else _border(scene.render, "border")


def _border(settings: Any, prefix: str) -> tuple[float, ...]:
    return tuple(getattr(settings, f"{prefix}_{end}_{axis}") for axis in "xy" for end in ("min", "max"))


def viewports() -> tuple[Rendered, ...]:
    """Those that there are."""
    return tuple(_SHOWN)


def look() -> float | None:
    """A timer: has viewports drawn again that have news, until none waits for anything."""
    for view in viewports():
        view.restage()
    now = time.monotonic()
    if any(view.has_news(now) for view in viewports()):
        for window in bpy.context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D" and area.spaces.active.shading.type == "RENDERED":
                    area.tag_redraw()
    return INTERVAL if any(view.waits(now) for view in viewports()) else None
