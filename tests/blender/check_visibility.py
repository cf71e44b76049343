"""What is hidden where: renders obey *Disable in Renders* and the view layer, viewports what they show themselves."""

from types import SimpleNamespace

import bpy
import pytest
from drawn_panels import viewport
from live_views import a_context, drawn_viewport, staged, through_the_camera
from model_files import load
from references import place_camera
from surroundings import body, material, plane

from blender_addon import render_engine
from blender_addon.evaluated.visible import hidden_in
from blender_addon.package.served import Cancelled
from blender_addon.viewport import rendered

RENDERS, VIEWPORTS = {"render"}, {"viewport"}


def in_collection(obj: bpy.types.Object) -> bpy.types.LayerCollection:
    """Put an object into a collection of its own in the scene."""
    collection = bpy.data.collections.new("Own")
    for old in list(obj.users_collection):
        old.objects.unlink(obj)
    collection.objects.link(obj)
    bpy.context.scene.collection.children.link(collection)
    return bpy.context.view_layer.layer_collection.children[collection.name]


def hide_object_in_renders(obj):
    obj.hide_render = True


def hide_object_in_viewports(obj):
    obj.hide_viewport = True


def close_eye_of_object(obj):
    obj.hide_set(True)


def hide_collection_in_renders(obj):
    in_collection(obj).collection.hide_render = True


def hide_collection_in_viewports(obj):
    in_collection(obj).collection.hide_viewport = True


def close_eye_of_collection(obj):
    in_collection(obj).hide_viewport = True


def exclude_collection(obj):
    in_collection(obj).exclude = True


HIDING = [
    (hide_object_in_renders, VIEWPORTS),
    (hide_object_in_viewports, RENDERS),
    (close_eye_of_object, RENDERS),
    (hide_collection_in_renders, VIEWPORTS),
    (hide_collection_in_viewports, RENDERS),
    (close_eye_of_collection, RENDERS),
    (exclude_collection, set()),
]


def rendered_order(scene, monkeypatch, folder):
    """What F12 asks of the package."""
    orders = []
    make = render_engine.make_order

    def render(*_):
        raise Cancelled

    renderer = SimpleNamespace(name="none", folder=folder, render=render)
    monkeypatch.setattr(render_engine, "choose_renderer", lambda command: renderer)
    monkeypatch.setattr(render_engine, "make_order", lambda *values: orders.append(make(*values)) or orders[-1])
    scene.render.engine = render_engine.ENGINE
    bpy.ops.render.render()
    return orders[-1]


def shown_in_viewport(scene, folder) -> set[str]:
    """Names of what a viewport in Rendered shading asks for."""
    bpy.context.view_layer.update()
    hidden = hidden_in(viewport(), bpy.context.evaluated_depsgraph_get())
    return set(staged(folder, through_the_camera(scene).camera, hidden).objects)


@pytest.mark.parametrize("hide, seen", HIDING, ids=lambda value: getattr(value, "__name__", ""))
def test_what_is_hidden_is_hidden_where_blender_hides_it(scene, monkeypatch, tmp_path, model, hide, seen):
    """As with EEVEE and Cycles: splats and a mesh, beside some that are not."""
    place_camera(scene, "dog")
    hidden, shown = ([load(model), body(plane(5), material("ShaderNodeBsdfDiffuse"))] for _ in range(2))
    others = {obj.name for obj in shown}
    every = others | {obj.name for obj in hidden}
    assert len(every) == 4 and shown_in_viewport(scene, tmp_path) == every
    for obj in hidden:
        hide(obj)
    assert shown_in_viewport(scene, tmp_path) == (every if seen & VIEWPORTS else others)
    assert set(rendered_order(scene, monkeypatch, tmp_path).objects) == (every if seen & RENDERS else others)


def test_an_instance_of_splats_is_hidden_with_what_makes_it(scene, monkeypatch, tmp_path, model):
    place_camera(scene, "dog")
    load(model)
    obj = load(model)
    obj.name = "Inner"
    in_collection(obj).exclude = True
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", bpy.data.collections["Own"]
    scene.collection.objects.link(empty)
    assert "Inner" in shown_in_viewport(scene, tmp_path)
    empty.hide_render = True
    assert "Inner" in shown_in_viewport(scene, tmp_path)
    assert "Inner" not in rendered_order(scene, monkeypatch, tmp_path).objects
    empty.hide_render = False
    empty.hide_set(True)
    assert "Inner" not in shown_in_viewport(scene, tmp_path)
    assert "Inner" in rendered_order(scene, monkeypatch, tmp_path).objects


def test_a_viewport_has_another_stage_when_the_eye_of_a_collection_closes(scene, monkeypatch, tmp_path, model):
    """Which neither hides its objects nor changes them."""
    place_camera(scene, "dog")
    load(model)
    layer_collection, seen, stages = in_collection(load(model)), drawn_viewport(monkeypatch, tmp_path), []
    make = rendered.make_stage
    monkeypatch.setattr(rendered, "PAUSE", 0.0)
    monkeypatch.setattr(rendered, "make_stage", lambda *values: stages.append(make(*values)) or stages[-1])
    for closed, count in ((False, 2), (False, 2), (True, 1), (False, 2)):
        layer_collection.hide_viewport = closed
        bpy.context.view_layer.update()
        seen.draw(a_context(), bpy.context.evaluated_depsgraph_get())
        seen.restage()
        assert len(stages[-1].objects) == count
    assert len(stages) == 3


@pytest.mark.parametrize("by_collection", [False, True])
def test_a_render_says_that_a_holdout_is_drawn(scene, monkeypatch, tmp_path, model, by_collection):
    place_camera(scene, "dog")
    obj = load(model)
    assert not rendered_order(scene, monkeypatch, tmp_path).notes
    if by_collection:
        in_collection(obj).holdout = True
    else:
        obj.is_holdout = True
    (note,) = rendered_order(scene, monkeypatch, tmp_path).notes
    assert note == f'"{obj.name}" is a holdout, but is drawn as it is'
    if by_collection:
        in_layer = bpy.context.view_layer.layer_collection.children["Own"]
        in_layer.holdout, in_layer.indirect_only = False, True
        (note,) = rendered_order(scene, monkeypatch, tmp_path).notes
        assert note == f'"{obj.name}" is indirect only, but cameras see it too'
