"""Crop, limits and painting: live, nothing lost, and what they show is what is exported and rendered."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from edits import PLACED, cropped, local, paint, shown
from model_files import export, load
from model_values import assert_equal
from references import place_camera

from blender_addon import render_engine
from blender_addon.editing.stand_in import stand_in_of
from blender_addon.evaluated.edited import edited_model
from blender_addon.files.model import importance, sigmoid
from blender_addon.files.ply import read_ply
from blender_addon.files.sh import C0
from blender_addon.nodes.modifier import edit_modifiers, input_property, set_input
from blender_addon.objects.attributes import read_attributes

INSIDE = {
    "BOX": lambda p: np.abs(p).max(axis=1) <= 1,
    "SPHERE": lambda p: np.linalg.norm(p, axis=1) <= 1,
    "MESH": lambda p: np.abs(p).max(axis=1) <= 1,  # a cube
}


@pytest.mark.parametrize("shape", INSIDE)
@pytest.mark.parametrize("invert", [False, True])
def test_a_crop_keeps_what_its_object_holds_and_follows_it(model, shape, invert):
    obj = load(model)
    obj.matrix_world = PLACED
    raw = read_attributes(obj.data)
    _, target = cropped(obj, shape, invert=invert)
    kept = []
    for _ in range(2):
        keep = INSIDE[shape](local(obj, target, raw.means)) != invert
        assert 5 < keep.sum() < raw.n_splats - 5
        assert_equal(shown(obj), raw.select(keep))
        kept.append(keep)
        target.location.x += 0.5
        target.rotation_euler.z += 0.4
        bpy.context.view_layer.update()
    assert (kept[0] != kept[1]).any() and len(obj.data.vertices) == raw.n_splats


def test_a_crop_by_a_selected_mesh_that_is_animated(scene, model):
    obj = load(model)
    raw = read_attributes(obj.data)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=1.5, location=raw.means.mean(axis=0))
    sphere, middle = bpy.context.object, raw.means.mean(axis=0)
    for frame, x in ((1, 0.0), (11, 1.0)):
        sphere.location.x = middle[0] + x
        sphere.keyframe_insert("location", frame=frame)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.dogsplat.add_crop(shape="MESH")
    for frame, x in ((1, 0.0), (11, 1.0)):
        scene.frame_set(frame)
        distance = np.linalg.norm(raw.means - middle - (x, 0, 0), axis=1)
        found = {tuple(p) for p in shown(obj).means.tolist()}
        inner, outer = (raw.means[distance < r] for r in (1.4, 1.5))
        assert {tuple(p) for p in inner.tolist()} <= found <= {tuple(p) for p in outer.tolist()} and len(inner) > 5


def test_without_its_object_a_crop_hides_nothing(model):
    obj = load(model)
    raw = read_attributes(obj.data)
    _, target = cropped(obj, "BOX")
    bpy.data.objects.remove(target)
    assert_equal(shown(obj), raw)


@pytest.mark.parametrize(
    "settings, rule",
    [
        ({"Minimum Opacity": 0.5}, lambda m: sigmoid(m.logit_opacities) >= 0.5),
        ({"Minimum Size": 0.3}, lambda m: np.exp(m.log_scales).max(axis=1) >= 0.3),
        ({"Maximum Size": 0.3}, lambda m: np.exp(m.log_scales).max(axis=1) <= 0.3),
        ({"Maximum Count": 40}, lambda m: np.isin(np.arange(150), np.argsort(-importance(m))[:40])),
        (
            {"Maximum Count": 40, "Count By": "Opacity"},
            lambda m: np.isin(np.arange(150), np.argsort(-m.logit_opacities, kind="stable")[:40]),
        ),
    ],
)
def test_limits_leave_out_what_they_say(model, settings, rule):
    obj = load(model)
    bpy.ops.dogsplat.add_limits()
    raw = read_attributes(obj.data)
    assert_equal(shown(obj), raw)
    for name, value in settings.items():
        set_input(edit_modifiers(obj)[0], name, value)
    keep = rule(raw)
    assert 5 < keep.sum() < raw.n_splats - 5
    assert_equal(shown(obj), raw.select(keep))


def test_sliders_can_be_keyed(scene, model):
    obj = load(model)
    bpy.ops.dogsplat.add_limits()
    modifier = edit_modifiers(obj)[0]
    for frame, count in ((1, 20), (21, 120)):
        set_input(modifier, "Maximum Count", count)
        owner, key = input_property(modifier, "Maximum Count")
        owner.keyframe_insert(key, frame=frame)
    for frame, count in ((1, 20), (21, 120)):
        scene.frame_set(frame)
        assert edited_model(obj, bpy.context.evaluated_depsgraph_get()).n_splats == count


def test_painting_erases_and_tints_while_it_goes_on_and_afterwards(model):
    obj = load(model)
    raw = read_attributes(obj.data)
    erased, tinted = np.arange(0, 40), np.arange(60, 90)
    assert bpy.ops.dogsplat.paint(what="ERASE") == {"FINISHED"}
    stand_in = stand_in_of(obj)
    assert bpy.context.object == stand_in and stand_in.mode == "WEIGHT_PAINT"
    assert len(stand_in.data.polygons) == 4 * raw.n_splats  # brushes paint on faces
    assert_equal(shown(obj), raw)
    paint(stand_in, erased, weight=1.0)
    kept = np.setdiff1d(np.arange(raw.n_splats), erased)
    assert_equal(shown(obj), raw.select(kept))

    assert bpy.ops.dogsplat.paint(what="TINT") == {"FINISHED"} and stand_in.mode == "VERTEX_PAINT"
    linear = (1.0, 0.2, 0.0, 1.0)
    paint(stand_in, tinted, color=linear)
    live = shown(obj)
    untouched = ~np.isin(kept, tinted)
    assert_equal(live.select(untouched), raw.select(kept[untouched]))
    before, after = raw.select(tinted), live.select(~untouched)
    factor = np.array([1.0, 1.055 * 0.2 ** (1 / 2.4) - 0.055, 0.0])  # as sRGB values, which are blended
    assert np.allclose(after.sh_coeffs[:, 0] * C0 + 0.5, (before.sh_coeffs[:, 0] * C0 + 0.5) * factor, atol=1e-5)
    assert np.allclose(after.sh_coeffs[:, 1:], before.sh_coeffs[:, 1:] * factor, atol=1e-5)
    assert np.array_equal(after.logit_opacities, before.logit_opacities)

    assert bpy.ops.dogsplat.finish_painting() == {"FINISHED"}
    assert bpy.context.object == obj and obj.mode == "OBJECT" and stand_in_of(obj) is None
    assert [other.name for other in bpy.data.objects] == [obj.name]
    assert_equal(shown(obj), live)
    assert bpy.ops.dogsplat.paint(what="ERASE") == {"FINISHED"}  # goes on where it was
    assert_equal(shown(obj), live)


def test_a_stand_in_that_was_deleted_or_hidden_comes_back_to_be_painted(model):
    """The modifier keeps it, and what was painted."""
    obj = load(model)
    raw = read_attributes(obj.data)
    for hide in (bpy.ops.object.delete, lambda: bpy.context.object.hide_set(True)):
        bpy.ops.dogsplat.paint(what="ERASE")
        paint(stand_in_of(obj), np.arange(40), weight=1.0)
        bpy.ops.object.mode_set(mode="OBJECT")
        hide()
        obj.select_set(True)
        bpy.context.view_layer.objects.active = obj
    assert bpy.ops.dogsplat.paint(what="TINT") == {"FINISHED"} and bpy.context.object == stand_in_of(obj)
    assert_equal(shown(obj), raw.select(np.arange(40, raw.n_splats)))


def test_a_stand_in_that_has_lost_points_is_refused_in_one_line(model):
    obj = load(model)
    bpy.ops.dogsplat.paint(what="ERASE")
    stand_in = stand_in_of(obj)
    bpy.ops.object.mode_set(mode="OBJECT")
    stand_in.data.vertices.foreach_set("select", np.arange(len(stand_in.data.vertices)) < 4)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.select_set(True)
    for operator in (bpy.ops.dogsplat.finish_painting, bpy.ops.dogsplat.apply_edits, bpy.ops.dogsplat.apply_transform):
        with pytest.raises(RuntimeError, match="^Error: .dog paint.: the number of its points has changed.*\n$"):
            operator()
    assert stand_in_of(obj) == stand_in


def test_a_duplicate_of_a_model_that_is_painted_keeps_what_is_painted(model):
    obj = load(model)
    raw = read_attributes(obj.data)
    bpy.ops.dogsplat.paint(what="ERASE")
    paint(stand_in_of(obj), np.arange(40), weight=1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    copies = [obj.copy(), obj.copy()]  # one of them linked
    copies[0].data = obj.data.copy()
    for copy in copies:
        bpy.context.collection.objects.link(copy)
    assert bpy.ops.dogsplat.finish_painting() == {"FINISHED"}
    for other in (obj, *copies):
        assert stand_in_of(other) is None
        assert_equal(shown(other), raw.select(np.arange(40, raw.n_splats)))


def test_a_model_that_lost_an_attribute_cannot_be_painted_and_says_so(model):
    obj = load(model)
    obj.data.attributes.remove(obj.data.attributes["scale"])
    with pytest.raises(RuntimeError, match='^Error: the mesh "dog" has no usable attribute "scale"'):
        bpy.ops.dogsplat.paint(what="ERASE")


def test_exports_write_what_is_shown_and_if_asked_what_is_hidden(model, tmp_path):
    obj, raw = load(model, up_axis="-Y", scale=2.0), read_ply(model)
    _, target = cropped(obj, "SPHERE")
    keep = INSIDE["SPHERE"](local(obj, target, raw.means))
    bpy.ops.dogsplat.paint(what="TINT")
    paint(stand_in_of(obj), np.flatnonzero(keep)[:3], color=(0.5, 0.5, 0.5, 1.0))
    bpy.ops.dogsplat.finish_painting()
    found = export(tmp_path / "shown.ply")
    assert found.n_splats == keep.sum()
    assert_equal(found.select(np.arange(3, found.n_splats)), raw.select(np.flatnonzero(keep)[3:]))
    assert not np.array_equal(found.sh_coeffs[:3], raw.sh_coeffs[keep][:3])
    assert_equal(export(tmp_path / "all.ply", hidden=True), raw)


def test_the_engine_renders_what_is_shown(scene, model, monkeypatch, tmp_path):
    place_camera(scene, "dog")
    obj, raw = load(model), read_ply(model)
    _, target = cropped(obj, "SPHERE")
    keep = INSIDE["SPHERE"](local(obj, target, raw.means))
    given = []

    class Renderer:
        name, folder = "none", tmp_path

        def render(self, request, *rest):
            given.append(read_ply(Path(request["model"])))
            size = request["camera"]["height"], request["camera"]["width"]
            return {"color": np.zeros((*size, 3)), "alpha": np.zeros(size)}

    monkeypatch.setattr(render_engine, "choose_renderer", lambda command: Renderer())
    scene.render.engine = render_engine.ENGINE
    bpy.ops.render.render()
    assert_equal(given[0], raw.select(keep))
    edit_modifiers(obj)[0].show_render = False
    bpy.ops.render.render()
    assert_equal(given[1], raw)


def test_everything_hidden_is_said(model, tmp_path):
    obj = load(model)
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(obj)[0], "Minimum Size", 1e6)
    obj.update_tag()
    with pytest.raises(RuntimeError, match="out.ply: there is no splat to export; .*open its crop"):
        export(tmp_path / "out.ply")
    with pytest.raises(RuntimeError, match='"dog": no splat is left'):
        bpy.ops.dogsplat.apply_edits()


def test_applied_edits_are_real_and_the_rest_keeps_its_bits(model):
    obj = load(model)
    raw = read_attributes(obj.data)
    _, target = cropped(obj, "BOX", invert=True)
    keep = ~INSIDE["BOX"](local(obj, target, raw.means))
    assert bpy.ops.dogsplat.apply_edits() == {"FINISHED"}
    assert [modifier.name for modifier in obj.modifiers] == ["DoG Splat"] and obj.data.name == "dog"
    assert len(bpy.data.meshes) == 1
    assert_equal(read_attributes(obj.data), raw.select(keep))
