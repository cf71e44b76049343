"""Viewports: a share while they move, quads and colours made for the view; the drawing itself would need a window."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from edits import shown
from live_views import OTHER_REGION, REGION, always, view_of_camera
from mathutils import Matrix, Vector
from model_files import load
from model_values import assert_equal
from references import place_camera

from blender_addon.engine.settings import ENGINE
from blender_addon.files.model import importance
from blender_addon.nodes.modifier import edit_modifiers, get_input, set_input, splat_modifier
from blender_addon.objects.attributes import RANK, read_attributes
from blender_addon.objects.columns import get_column
from blender_addon.viewport.handlers import BEHIND_OURS, WATCHER, at_rest, while_moving
from blender_addon.viewport.pace import REST
from blender_addon.viewport.view import view_of
from blender_addon.viewport.watcher import Shown, Watcher, show_models


def drawn(obj) -> np.ndarray:
    """The positions of what is drawn in a viewport: corners of quads, or points."""
    obj.update_tag()
    geometry = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = geometry.to_mesh()
    points = np.array([vertex.co for vertex in mesh.vertices])
    geometry.to_mesh_clear()
    return points


def test_ranks_put_the_most_important_splats_first(model):
    obj = load(model)
    raw = read_attributes(obj.data)
    ranks = get_column(obj.data, RANK, 1)[:, 0]
    order = np.argsort(ranks)
    assert np.array_equal(np.sort(ranks), np.arange(150, dtype=np.float32) / np.float32(150))
    assert (np.diff(importance(raw)[order]) <= 0).all()


def test_what_applied_edits_leave_is_ranked_anew(model):
    """Else a share of the splats would show none of what is left where the most important ones are gone."""
    obj = load(model)
    large = np.exp(read_attributes(obj.data).log_scales).max(axis=1)
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(obj)[0], "Maximum Size", float(np.median(large)))
    obj.update_tag()
    assert bpy.ops.dogsplat.apply_edits() == {"FINISHED"}
    ranks, left = get_column(obj.data, RANK, 1)[:, 0], read_attributes(obj.data)
    assert left.n_splats == 75 and np.array_equal(np.sort(ranks), np.arange(75, dtype=np.float32) / np.float32(75))
    assert (np.diff(importance(left)[np.argsort(ranks)]) <= 0).all()


def test_what_is_left_in_edit_mode_is_ranked_anew(model):
    """Of the most important half that was deleted, a share of a half showed none of the rest."""
    obj = load(model)
    before = get_column(obj.data, RANK, 1)[:, 0]
    obj.data.vertices.foreach_set("select", before < 0.5)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    ranks = get_column(obj.data, RANK, 1)[:, 0]
    assert np.array_equal(np.sort(ranks), np.arange(75, dtype=np.float32) / np.float32(75))
    assert np.array_equal(np.argsort(ranks), np.argsort(before[before >= 0.5]))


def test_a_view_has_the_intrinsics_of_the_camera_that_it_looks_through(scene, model):
    place_camera(scene, "dog")
    obj = load(model)
    view = view_of_camera(scene)
    seen = splat_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    names = ("Focal X", "Focal Y", "Center X", "Center Y", "Width", "Height")
    expected = [get_input(seen, name) for name in names]
    assert np.allclose([*view.focal, *view.center, *view.size], expected, rtol=1e-4)
    assert np.allclose(np.array(view.matrix), np.array(scene.camera.matrix_world), atol=1e-5)


def test_an_orthographic_view_sees_points_where_blender_draws_them():
    pose = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.7, 4, (1, 2, 3))
    projection = Matrix(((0.4, 0, 0, 0.1), (0, 0.6, 0, -0.2), (0, 0, -0.01, 0), (0, 0, 0, 1)))
    space = SimpleNamespace(view_matrix=pose.inverted(), window_matrix=projection, is_perspective=False)
    view = view_of(space, 300, 200)
    assert view.parallel
    for point in ((0.3, -0.2, -5.0), (-0.5, 0.8, -5.2)):
        clip = projection @ Vector((*point, 1.0))
        local = Matrix(view.matrix).inverted() @ (pose @ Vector(point))
        pixel = [f * p + c for f, p, c in zip(view.focal, (local.x, -local.y), view.center, strict=True)]
        assert np.allclose(pixel, (150 * (1 + clip.x), 100 * (1 - clip.y)), atol=1e-3)


def test_quads_and_colors_made_for_a_view_are_those_of_a_camera_there(scene, model):
    place_camera(scene, "dog")
    obj = load(model)
    obj.matrix_world = Matrix.Rotation(0.3, 4, "Z") @ Matrix.Scale(1.2, 4)
    bpy.context.view_layer.update()
    set_input(splat_modifier(obj), "Show As", "Quads")
    of_camera, view = drawn(obj), view_of_camera(scene)
    scene.camera.location.x += 5
    bpy.context.view_layer.update()
    assert not np.allclose(drawn(obj)[:20], of_camera[:20], atol=1e-2)
    show_models(scene, Shown(), view)
    found = drawn(obj)
    assert len(found) == len(of_camera) > 400 and np.allclose(found, of_camera, atol=1e-4)
    set_input(splat_modifier(obj), "Show As", "Automatic")
    assert np.array_equal(drawn(obj), found)


def test_a_moving_view_shows_the_most_important_splats_and_a_resting_one_all(scene, model):
    place_camera(scene, "dog")
    obj = load(model)
    raw, modifier = read_attributes(obj.data), splat_modifier(obj)
    set_input(modifier, "Show As", "Quads")
    everything = len(drawn(obj))
    watcher, view, few = Watcher(), view_of_camera(scene), always(Shown(count=30))
    assert watcher.see(REGION, scene, view, now=10.0) and not watcher.see(REGION, scene, view, now=10.1)
    assert watcher.tick(10.1, few) is not None
    assert get_input(modifier, "Moving Share") == pytest.approx(0.2)
    assert 60 < len(drawn(obj)) <= 4 * 30
    assert_equal(shown(obj), raw)  # what is exported and rendered is not what moves
    watcher.see(REGION, scene, view._replace(size=(2, 2)), now=11.0)
    assert watcher.tick(15.0, few) is not None  # it took so long to draw
    assert watcher.tick(15.1, few) is not None and get_input(modifier, "Moving Share") < 1
    assert watcher.tick(15.1 + REST, few) is None
    assert get_input(modifier, "Moving Share") == 1 and len(drawn(obj)) == everything


def test_where_a_processor_draws_a_moving_view_shows_points_in_coarse_pixels(scene, model):
    obj = load(model)
    scene.dogsplat_moving_count, scene.render.preview_pixel_size = 30, "2"
    points = while_moving(scene, "llvmpipe (LLVM 19.1.7, 256 bits)")
    assert points == (30, True) and while_moving(scene, "NVIDIA GeForce RTX 4070/PCIe/SSE2") == (30, False)
    watcher = Watcher()
    watcher.show(scene, points)
    watcher.show(scene, points)
    obj.update_tag()
    bpy.context.view_layer.update()
    instances = [i for i in bpy.context.evaluated_depsgraph_get().object_instances if i.is_instance]
    assert len(instances) <= 1 and scene.render.preview_pixel_size == "4"
    watcher.show(scene, Shown())
    bpy.context.view_layer.update()
    instances = [i for i in bpy.context.evaluated_depsgraph_get().object_instances if i.is_instance]
    assert len(instances) > 100 and scene.render.preview_pixel_size == "2"
    scene.dogsplat_moving = "ALL"
    assert while_moving(scene, "llvmpipe") == (0, False)


def test_a_file_saved_while_a_view_moves_has_all_splats(scene, model, tmp_path):
    obj = load(model)
    WATCHER.show(scene, Shown(30, True))
    assert get_input(splat_modifier(obj), "Moving Share") < 1
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert get_input(splat_modifier(bpy.data.objects["dog"]), "Moving Share") == 1
    assert bpy.context.scene.render.preview_pixel_size == "AUTO"
    WATCHER.show(bpy.context.scene, Shown(30, True))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))  # in the middle of a movement
    WATCHER.show(bpy.context.scene, Shown(30, True))
    assert bpy.context.scene.render.preview_pixel_size == "4"
    WATCHER.show(bpy.context.scene, Shown())
    assert bpy.context.scene.render.preview_pixel_size == "AUTO"


def test_following_is_switched_on_and_off_at_once(scene, model):
    place_camera(scene, "dog")
    modifier = splat_modifier(load(model))
    WATCHER.see(REGION, scene, view_of_camera(scene), now=0.0)
    scene.dogsplat_follow_view = True
    assert get_input(modifier, "View")
    scene.dogsplat_follow_view = False
    assert not get_input(modifier, "View")


def test_blender_draws_few_splats_itself_where_our_engine_draws_every_viewport(scene):
    def window(*kinds, scene=scene):
        spaces = [SimpleNamespace(shading=SimpleNamespace(type=kind)) for kind in kinds]
        areas = [SimpleNamespace(type="VIEW_3D", spaces=SimpleNamespace(active=space)) for space in spaces]
        return SimpleNamespace(screen=SimpleNamespace(areas=areas), scene=scene)

    assert at_rest(scene, [window("RENDERED")]) == Shown()
    scene.render.engine = ENGINE
    assert at_rest(scene, [window("RENDERED"), window("RENDERED")]) == Shown(BEHIND_OURS)
    assert at_rest(scene, [window("RENDERED", "MATERIAL")]) == at_rest(scene, []) == Shown()
    of_another = window("MATERIAL", scene=bpy.data.scenes.new("Other"))
    assert at_rest(scene, [window("RENDERED"), of_another]) == Shown(BEHIND_OURS)


def test_blender_shows_its_own_splats_again_when_our_engine_leaves(scene, model):
    modifier, watcher = splat_modifier(load(model)), Watcher()
    assert watcher.draws(REGION, scene, True) and not watcher.draws(REGION, scene, True)
    assert not watcher.draws(OTHER_REGION, scene, False)
    assert watcher.tick(100.0, always(Shown()), always(Shown(30))) is None
    assert get_input(modifier, "Moving Share") == pytest.approx(0.2)
    assert watcher.draws(REGION, scene, False)
    watcher.tick(101.0, always(Shown()), always(Shown()))
    assert get_input(modifier, "Moving Share") == 1
