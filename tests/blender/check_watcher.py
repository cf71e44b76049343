"""Several viewports, and what undo, other scenes and the end of the add-on meet in the middle of a movement."""

import time
from types import SimpleNamespace

import bpy
import pytest
from live_views import OTHER_REGION, REGION, always, view_of_camera
from model_files import load
from references import place_camera
from scattering import only_as_instance

from blender_addon.nodes.modifier import get_input, splat_modifier
from blender_addon.viewport import handlers
from blender_addon.viewport.handlers import WATCHER
from blender_addon.viewport.pace import REST
from blender_addon.viewport.watcher import INTERVAL, Shown, Watcher


def test_viewports_of_different_views_come_to_rest(scene, model):
    """A change of the models has Blender draw both again, though nobody moves them."""
    place_camera(scene, "dog")
    modifier, watcher, few = splat_modifier(load(model)), Watcher(), always(Shown(count=30))
    first = view_of_camera(scene)
    views = {REGION: first, OTHER_REGION: first._replace(size=(2, 2))}
    now, shares = 0.0, [get_input(modifier, "Moving Share")]
    moved = [watcher.see(region, scene, view, now) for region, view in views.items()]
    while watcher.tick(now, few) is not None and now < 5:
        now += INTERVAL
        if (share := get_input(modifier, "Moving Share")) != shares[-1]:
            shares.append(share)
            moved += [watcher.see(region, scene, view, now) for region, view in views.items()]
    shares.append(get_input(modifier, "Moving Share"))
    assert moved == [True, True, False, False] and now < 2 * REST and shares == [1, pytest.approx(0.2), 1]


def test_the_viewport_that_moved_last_is_followed(scene, model):
    place_camera(scene, "dog")
    modifier, watcher, few = splat_modifier(load(model)), Watcher(), always(Shown())
    scene.dogsplat_follow_view, first = True, view_of_camera(scene)
    watcher.see(OTHER_REGION, scene, first, now=0.0)
    watcher.see(REGION, scene, first._replace(size=(2, 2)), now=0.0)
    watcher.see(OTHER_REGION, scene, first, now=0.1)  # is drawn
    watcher.tick(0.1, few)
    assert tuple(get_input(modifier, "View Size"))[:2] == (2, 2)
    watcher.see(OTHER_REGION, scene, first._replace(size=(3, 3)), now=0.2)
    watcher.tick(0.2, few)
    assert tuple(get_input(modifier, "View Size"))[:2] == (3, 3)


def test_a_model_that_is_only_an_instance_shows_fewer_splats_and_follows_no_view(scene, model):
    """It may have another place than its object, for which alone quads could be made."""
    place_camera(scene, "dog")
    own, inner, watcher = load(model), only_as_instance(scene, load(model)), Watcher()
    modifiers, scene.dogsplat_follow_view = [splat_modifier(obj) for obj in (own, inner)], True
    watcher.see(REGION, scene, view_of_camera(scene), now=0.0)
    watcher.tick(0.0, always(Shown(count=30)))
    assert [get_input(modifier, "Moving Share") for modifier in modifiers] == [pytest.approx(0.1)] * 2
    assert [get_input(modifier, "View") for modifier in modifiers] == [True, False]


def test_a_viewport_that_moves_shows_fewer_splats_in_its_own_scene(scene, model, monkeypatch):
    """Whatever the first window shows, by which a timer goes."""
    place_camera(scene, "dog")
    monkeypatch.setattr(handlers.gpu, "platform", SimpleNamespace(renderer_get=lambda: "some card"))
    view, of_first, other = view_of_camera(scene), splat_modifier(load(model)), bpy.data.scenes.new("Other")
    obj = load(model)
    scene.collection.objects.unlink(obj)
    other.collection.objects.link(obj)
    other.dogsplat_moving_count = 30
    WATCHER.see(REGION, other, view, time.monotonic())
    assert handlers._tick() is not None and bpy.context.scene == scene
    assert get_input(splat_modifier(obj), "Moving Share") == pytest.approx(0.2)
    assert get_input(of_first, "Moving Share") == 1


def test_undo_to_the_middle_of_a_movement_leaves_no_coarse_pixels(scene, model):
    load(model)
    scene.render.preview_pixel_size = "2"
    WATCHER.show(scene, Shown(30, True))
    bpy.ops.ed.undo_push(message="ends while a viewport moves")
    WATCHER.show(bpy.context.scene, Shown())
    bpy.context.scene.frame_end = 77
    bpy.ops.ed.undo_push(message="another step")
    bpy.ops.ed.undo()
    for shown in (Shown(), Shown(30, True), Shown()):  # at rest, and after the next movement
        WATCHER.show(bpy.context.scene, shown)
        pixels = bpy.context.scene.render.preview_pixel_size
        assert (bpy.context.scene.frame_end, pixels) == (250, "4" if shown.points else "2")
    bpy.ops.ed.redo()
    assert (bpy.context.scene.frame_end, bpy.context.scene.render.preview_pixel_size) == (77, "2")


def test_disabling_the_add_on_ends_a_movement(scene, model):
    import addon_utils

    obj, scene.render.preview_pixel_size = load(model), "2"
    WATCHER.show(scene, Shown(30, True))
    addon_utils.disable("blender_addon")
    assert get_input(splat_modifier(obj), "Moving Share") == 1 and scene.render.preview_pixel_size == "2"
    assert not any(name.startswith("dogsplat_preview") for name in scene.keys())
