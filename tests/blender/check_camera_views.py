"""Viewports that look through a camera show splats as its render does, whatever part of the picture they see."""

import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from blender_pictures import EEVEE
from live_views import context_of_camera, last
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera, reference

from blender_addon.engine.settings import ENGINE
from blender_addon.nodes.modifier import get_input, set_input, splat_modifier
from blender_addon.viewport import handlers, rendered
from blender_addon.viewport.rendered import Rendered
from blender_addon.viewport.watcher import Shown

SIZES = [(150, 100), (30, 20)]  # of a region: larger than the picture of 96 x 64, and smaller


def asked_for(context, folder, monkeypatch) -> dict:
    """What a viewport in Rendered shading asks the package for."""
    asked = []
    package = SimpleNamespace(folder=folder, pictures=lambda request, left: asked.append(request) or (), close=list)
    monkeypatch.setattr(rendered, "live_renderer", lambda command: package)
    viewport, limit = Rendered(), time.monotonic() + 10
    viewport.draw(context, bpy.context.evaluated_depsgraph_get())
    viewport.restage()
    viewport.draw(context, bpy.context.evaluated_depsgraph_get())
    while not asked and time.monotonic() < limit:
        time.sleep(0.01)
    return asked[0]


@pytest.mark.parametrize("width, height", SIZES)
def test_a_rendered_viewport_shows_the_picture_of_its_camera(scene, live_command, monkeypatch, tmp_path, width, height):
    """Also of splats far off the picture, whose shapes are held near its sides and not near those of the region."""
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.render.engine, scene.render.film_transparent, scene.dogsplat_colors = ENGINE, True, "DISPLAY"
    request = asked_for(context_of_camera(scene, width, height), tmp_path, monkeypatch)
    expected, found = reference("dog")["color"], last(live_command, request)[..., :3]
    x, y = (width - 96) // 2, (height - 64) // 2
    found, expected = found[max(y, 0) :, max(x, 0) :][:64, :96], expected[max(-y, 0) :, max(-x, 0) :][:height, :width]
    assert found.shape == expected.shape and np.abs(found - expected).max() < 2e-3


def quads(obj) -> np.ndarray:
    """The corners of what a viewport shows."""
    obj.update_tag()
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    return np.array([vertex.co for vertex in mesh.vertices])


@pytest.mark.parametrize("width, height", [*SIZES, (96, 64)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_quads_that_follow_a_view_are_those_of_the_camera(scene, monkeypatch, width, height, mirrored):
    """A mirrored camera among them."""
    place_camera(scene, "dog")
    if mirrored:
        scene.camera.matrix_world @= Matrix.Diagonal((-1, 1, 1, 1))
    obj, scene.render.engine = load(REFERENCES / "dog.ply"), EEVEE
    obj.matrix_world = Matrix.Rotation(0.3, 4, "Z") @ Matrix.Scale(1.2, 4)
    bpy.context.view_layer.update()
    set_input(splat_modifier(obj), "Show As", "Quads")
    of_camera, scene.dogsplat_follow_view = quads(obj), True
    context = context_of_camera(scene, width, height)
    monkeypatch.setattr(handlers, "bpy", SimpleNamespace(app=bpy.app, context=context))
    handlers._drawn()
    bpy.app.timers.unregister(handlers._tick)
    handlers.WATCHER.show(scene, Shown())
    assert get_input(splat_modifier(obj), "View")
    found = quads(obj)
    assert len(found) == len(of_camera) > 400 and np.allclose(found, of_camera, atol=1e-4)
