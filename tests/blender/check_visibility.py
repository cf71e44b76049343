"""What is hidden where: renders obey *Disable in Renders* and the view layer, viewports what they show themselves."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from blender_pictures import of_fine_pixels, with_alpha
from drawn_panels import viewport
from live_views import a_context, drawn_viewport, staged, through_the_camera
from model_files import load
from references import REFERENCES, place_camera, reference
from surroundings import GREY, background, blocks, body, camera, material, plane

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


def names(stage) -> list[str]:
    """Of its objects, by their numbers."""
    return [shown.name for shown in stage.objects]


def shown_in_viewport(scene, folder) -> set[str]:
    """Names of what a viewport in Rendered shading asks for."""
    bpy.context.view_layer.update()
    hidden = hidden_in(viewport(), bpy.context.evaluated_depsgraph_get())
    return set(names(staged(folder, through_the_camera(scene).camera, hidden)))


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
    assert set(names(rendered_order(scene, monkeypatch, tmp_path))) == (every if seen & RENDERS else others)


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
    assert "Inner" not in names(rendered_order(scene, monkeypatch, tmp_path))
    empty.hide_render = False
    empty.hide_set(True)
    assert "Inner" not in shown_in_viewport(scene, tmp_path)
    assert "Inner" in names(rendered_order(scene, monkeypatch, tmp_path))


@pytest.mark.parametrize("shown", [True, False])
def test_what_points_repeat_is_hidden_with_the_collection_of_these(scene, tmp_path, model, shown):
    """Splats and bodies; also where an object shows only what it repeats, and not itself."""
    place_camera(scene, "dog")
    load(model)  # is there all the time
    layer, inner = None, set()
    for obj in (load(model), body(plane(0.1), material("ShaderNodeBsdfDiffuse"))):
        square = plane(2)
        square.instance_type, obj.parent = "VERTS", square
        square.show_instancer_for_viewport = shown
        if layer is None:
            layer = in_collection(square)
        else:
            scene.collection.objects.unlink(square)
            layer.collection.objects.link(square)
        obj.hide_set(True)  # itself, not what the points show of it
        inner.add(obj.name)
    assert shown_in_viewport(scene, tmp_path) >= inner
    layer.hide_viewport = True
    assert not shown_in_viewport(scene, tmp_path) & inner


def by_object(obj, mask):
    if mask == "holdout":
        obj.is_holdout = True
    else:
        obj.visible_camera = False


def by_collection(obj, mask):
    setattr(in_collection(obj), mask, True)


MASKS = ["holdout", "indirect_only"]


@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("mark", [by_object, by_collection])
def test_a_render_and_a_viewport_ask_for_masks(scene, monkeypatch, tmp_path, model, mark, mask):
    """By the numbers of the objects; a mesh follows the splats."""
    place_camera(scene, "dog")
    first, second, wall = load(model), load(model), body(plane(5), material("ShaderNodeBsdfDiffuse"))
    order = rendered_order(scene, monkeypatch, tmp_path)
    assert names(order) == [first.name, second.name, wall.name] and not order.request.keys() & set(MASKS)
    mark(second, mask)
    mark(wall, mask)
    order = rendered_order(scene, monkeypatch, tmp_path)
    assert order.notes == [] and {name: order.request.get(name) for name in MASKS} == {
        name: [names(order).index(obj.name) for obj in (second, wall)] if name == mask else None for name in MASKS
    }
    bpy.context.view_layer.update()
    stage = staged(tmp_path, through_the_camera(scene).camera)
    assert sorted(names(stage)[number] for number in stage.request[mask]) == sorted([second.name, wall.name])
    scene.dogsplat.send = "SPLATS"
    order = rendered_order(scene, monkeypatch, tmp_path)
    assert [names(order)[number] for number in order.request[mask]] == [second.name]


def test_instances_are_masked_with_what_makes_them(scene, monkeypatch, tmp_path, model):
    place_camera(scene, "dog")
    objects = [load(model), plane(5)]
    for obj in objects:
        obj.name = f"Inner {obj.type}"
    collection = in_collection(objects[0]).collection
    scene.collection.objects.unlink(objects[1])
    collection.objects.link(objects[1])
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection, empty.is_holdout = "COLLECTION", collection, True
    scene.collection.objects.link(empty)
    order = rendered_order(scene, monkeypatch, tmp_path)
    held = [names(order)[number] for number in order.request["holdout"]]
    assert sorted(held) == sorted(obj.name for obj in objects)
    assert sorted(names(order)) == sorted(2 * held)


OF_COLLECTIONS = {
    "hide_viewport": (lambda stage: len(stage.objects), {False: 2, True: 1}),
    "holdout": (lambda stage: "holdout" in stage.request, {False: False, True: True}),
}
"""What the stage says of a setting, by the setting."""


@pytest.mark.parametrize("setting", OF_COLLECTIONS)
def test_a_viewport_has_another_stage_when_a_collection_changes(scene, monkeypatch, tmp_path, model, setting):
    """By its eye or its mask, which neither hide its objects nor change them."""
    place_camera(scene, "dog")
    load(model)
    layer_collection, seen, stages = in_collection(load(model)), drawn_viewport(monkeypatch, tmp_path), []
    make, (said, expected) = rendered.make_stage, OF_COLLECTIONS[setting]
    monkeypatch.setattr(rendered, "PAUSE", 0.0)
    monkeypatch.setattr(rendered, "make_stage", lambda *values: stages.append(make(*values)) or stages[-1])
    for value in (False, False, True, True, False):
        setattr(layer_collection, setting, value)
        bpy.context.view_layer.update()
        seen.draw(a_context(), bpy.context.evaluated_depsgraph_get())
        seen.restage()
        assert said(stages[-1]) == expected[value]
    assert len(stages) == 3


@pytest.mark.parametrize("transparent", [False, True])
@pytest.mark.parametrize("mask", ["", *MASKS])
def test_masks_of_meshes_are_those_of_cycles(scene, by_command, tmp_path, mask, transparent):
    """A square before the left part of a wall, and another before both; each stands for an area of the picture."""
    camera(scene, (0, 0, 8))
    background(scene)
    scene.render.film_transparent = transparent
    body(plane(4), material("ShaderNodeBsdfDiffuse", Color=(0.9, 0.2, 0.2, 1)))
    masked = body(plane(2, location=(-2, 0, 1)), material("ShaderNodeBsdfDiffuse", Color=GREY))
    body(plane(1, location=(-1.5, 0, 2)), material("ShaderNodeBsdfDiffuse", Color=(0.2, 0.2, 0.9, 1)))
    if mask:
        by_collection(masked, mask)
    cycles, ours = (blocks(of_fine_pixels(scene, name, tmp_path)) for name in ("CYCLES", render_engine.ENGINE))
    assert np.abs(ours - cycles).mean() < 0.01
    assert np.percentile(np.abs(ours - cycles), 95) < 0.05  # noise, and edges that filters blur
    if mask == "holdout":
        assert cycles[..., 3].min() < 0.5


@pytest.mark.parametrize("transparent", [False, True])
def test_a_holdout_of_splats_is_a_hole(scene, by_command, tmp_path, transparent):
    """In the world behind it too; what is indirect only is not there."""
    place_camera(scene, "square")
    obj, scene.render.film_transparent = load(REFERENCES / "square.ply"), transparent
    background(scene, (0.2, 0.4, 0.6, 1))
    before = with_alpha(scene, render_engine.ENGINE, tmp_path)
    obj.is_holdout = True
    after, alpha = with_alpha(scene, render_engine.ENGINE, tmp_path), reference("square")["alpha"]
    assert np.allclose(before[..., 3], alpha if transparent else 1, atol=1e-5)
    assert np.allclose(after[..., 3], 0 if transparent else 1 - alpha, atol=1e-4)
    assert np.allclose(after[..., :3], after[..., 3:] * (0.2, 0.4, 0.6), atol=1e-4)
    by_object(obj, "indirect_only")
    empty = with_alpha(scene, render_engine.ENGINE, tmp_path)
    assert np.allclose(empty, (0, 0, 0, 0) if transparent else (0.2, 0.4, 0.6, 1), atol=1e-5)
