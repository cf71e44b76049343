"""Viewports that our engine draws, without the window that they would be in: views, requests and pictures."""

from types import SimpleNamespace

import bpy
import numpy as np
from drawn_panels import viewport
from mathutils import Matrix
from package_command import never

from blender_addon.engine.order import Stage, make_stage
from blender_addon.viewport import rendered
from blender_addon.viewport.region import Seen, seen_by
from blender_addon.viewport.rendered import Rendered
from blender_addon.viewport.view import View, view_of
from blender_addon.viewport.watcher import Shown, ShownIn

SIZE = 96, 64
REGION, OTHER_REGION = 1, 2  # stand for two viewports
PERSPECTIVE = (1.5, 0, 0, 0), (0, 2.2, 0, 0), (0, 0, -1.002, -0.2002), (0, 0, -1, 0)  # as a person looks


def space_of_camera(scene, width: int, height: int) -> SimpleNamespace:
    """The ``RegionView3D`` of a region of that size that looks through the camera."""
    camera, render, depsgraph = scene.camera, scene.render, bpy.context.evaluated_depsgraph_get()
    aspect = {"scale_x": render.pixel_aspect_x, "scale_y": render.pixel_aspect_y}
    projection = camera.calc_matrix_camera(depsgraph, x=width, y=height, **aspect)
    view = camera.matrix_world.normalized().inverted()
    return SimpleNamespace(view_matrix=view, window_matrix=projection, is_perspective=True)


def context_of_camera(scene, width: int, height: int) -> SimpleNamespace:
    """Of a viewport of that size that looks through the camera, whose picture is in its middle, pixel by pixel."""
    size, space = (scene.render.resolution_x, scene.render.resolution_y), viewport()
    space.camera = scene.camera
    view = space_of_camera(scene, *size)
    view.view_perspective = "CAMERA"
    view.window_matrix = Matrix.Diagonal((size[0] / width, size[1] / height, 1, 1)) @ view.window_matrix
    region = SimpleNamespace(width=width, height=height, as_pointer=lambda: REGION)
    return SimpleNamespace(scene=scene, region=region, region_data=view, space_data=space,
                           preferences=bpy.context.preferences)  # fmt: skip


def through_the_camera(scene) -> Seen:
    """What a region of the size of the picture sees through the camera."""
    size = scene.render.resolution_x, scene.render.resolution_y
    return seen_by(space_of_camera(scene, *size), *size)


def view_of_camera(scene) -> View:
    """What a small region shows that looks through the camera, as plain numbers."""
    return view_of(space_of_camera(scene, *SIZE), *SIZE)


def always(shown: Shown) -> ShownIn:
    """That, in every scene."""
    return lambda scene: shown


def staged(folder, camera, hidden=frozenset()) -> Stage:
    """What stands before a camera now, but for hidden objects."""
    return make_stage(bpy.context.evaluated_depsgraph_get(), folder, camera, hidden)


def last(renderer, request) -> np.ndarray:
    """The finished picture."""
    (*_, (share, picture)) = renderer.pictures(request, never)
    assert share == 1
    return picture


def a_context() -> SimpleNamespace:
    """Of a viewport that is drawn."""
    space = SimpleNamespace(view_matrix=Matrix.Identity(4), window_matrix=Matrix(PERSPECTIVE),
                            is_perspective=True, view_perspective="PERSP")  # fmt: skip
    region = SimpleNamespace(width=SIZE[0], height=SIZE[1])
    return SimpleNamespace(region=region, region_data=space, space_data=viewport(), preferences=bpy.context.preferences)


def drawn_viewport(monkeypatch, folder) -> Rendered:
    """One that was drawn once, and whose package draws nothing."""
    package = SimpleNamespace(folder=folder, pictures=never, close=never)
    monkeypatch.setattr(rendered, "live_renderer", lambda command: package)
    viewport = Rendered()
    viewport.draw(a_context(), bpy.context.evaluated_depsgraph_get())
    return viewport


def update(thing, geometry=False, transform=False, shading=False) -> SimpleNamespace:
    """What Blender tells about a thing that it has evaluated again."""
    flags = {"is_updated_geometry": geometry, "is_updated_transform": transform, "is_updated_shading": shading}
    return SimpleNamespace(id=thing, **flags)


def tell(*listeners) -> None:
    """Let Blender evaluate what has changed, and tell it to each while it does, as it tells its render engines."""

    def note(scene, depsgraph):
        for listener in listeners:
            listener(depsgraph)

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
