"""What stands before the camera, as the files of a request: what is written, named and removed."""

from pathlib import Path

import bpy
import pytest
from live_views import staged, through_the_camera
from model_files import load
from references import REFERENCES, place_camera
from surroundings import body, material, plane

from blender_addon.editing.stand_in import build_stand_in
from blender_addon.engine.order import make_order, tidy
from blender_addon.nodes.modifier import get_input, splat_modifier
from blender_addon.viewport.changes import Changes


def whole_scene(folder, camera):
    """What stands before a camera now, and that it is more than splats."""
    stage = staged(folder, camera)
    assert stage.whole
    return stage


def test_the_same_scene_is_the_same_file(scene, tmp_path):
    """The package then reads nothing again; what earlier scenes were goes."""
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    wall, camera = plane(5), through_the_camera(scene).camera
    body(wall, material("ShaderNodeBsdfDiffuse"))
    first = whole_scene(tmp_path, camera)
    path = Path(first.request["scene"])
    before = path.stat().st_mtime_ns
    wall.update_tag()
    bpy.context.view_layer.update()
    assert whole_scene(tmp_path, camera).request == first.request and path.stat().st_mtime_ns == before
    wall.location.x += 1
    bpy.context.view_layer.update()
    other = whole_scene(tmp_path, camera)
    assert other.request["scene"] != str(path)
    tidy(tmp_path, other.files)
    assert {file.name for file in tmp_path.iterdir()} == other.files


def test_the_same_splats_are_the_same_file(scene, model, tmp_path):
    place_camera(scene, "dog")
    obj = load(model)
    camera = through_the_camera(scene).camera
    first = staged(tmp_path, camera).request["model"]
    assert staged(tmp_path, camera).request["model"] == first and len(list(tmp_path.iterdir())) == 1
    obj.location.x += 1
    bpy.context.view_layer.update()
    assert staged(tmp_path, camera).request["model"] != first


@pytest.mark.parametrize("helper", ["crop", "stand-in"])
def test_what_renders_do_not_show_is_no_body_of_a_viewport(scene, model, tmp_path, helper):
    """The mesh of a crop, and what brushes paint; a mesh that renders show again is."""
    place_camera(scene, "dog")
    obj, changes = load(model), Changes()
    if helper == "crop":
        assert bpy.ops.dogsplat.add_crop(shape="MESH") == {"FINISHED"}
        made = get_input(obj.modifiers[0], "Object")
    else:
        made = build_stand_in(obj)
    bpy.context.view_layer.update()
    depsgraph, camera = bpy.context.evaluated_depsgraph_get(), through_the_camera(scene).camera
    assert depsgraph.mode == "VIEWPORT" and made.name in {seen.name for seen in depsgraph.objects}
    assert not staged(tmp_path, camera).whole
    plane(5)
    assert [of for of in whole_scene(tmp_path, camera).objects if of.name == made.name] == []
    changes.note(bpy.context.evaluated_depsgraph_get())
    changes.pending, made.hide_render = False, False
    changes.note(bpy.context.evaluated_depsgraph_get())
    assert changes.pending and made.name in {of.name for of in whole_scene(tmp_path, camera).objects}


def test_another_world_of_the_view_layer_is_said(model, scene, tmp_path):
    layer = bpy.context.view_layer
    if not hasattr(layer, "world_override"):
        pytest.skip("this Blender has none")
    place_camera(scene, "dog")
    load(model)
    layer.world_override = bpy.data.worlds.new("Another")
    (note,) = staged(tmp_path, through_the_camera(scene).camera).notes
    assert "world" in note


@pytest.mark.parametrize("name", ["use_sky", "use_solid"])
def test_a_filter_of_the_view_layer_is_said(model, scene, tmp_path, name):
    place_camera(scene, "dog")
    load(model)
    camera = through_the_camera(scene).camera
    assert staged(tmp_path, camera).notes == []
    setattr(bpy.context.view_layer, name, False)
    (note,) = staged(tmp_path, camera).notes
    assert "filter is left out" in note


def test_a_file_that_cannot_be_removed_stays(monkeypatch, tmp_path):
    """As one that is being read on Windows; others go."""
    for name in ("a.ply", "b.ply"):
        (tmp_path / name).touch()
    remove = Path.unlink

    def unlink(path, *args, **options):
        if path.name == "a.ply":
            raise PermissionError("in use")
        remove(path, *args, **options)

    monkeypatch.setattr(Path, "unlink", unlink)
    tidy(tmp_path, set())
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]


def test_a_final_picture_is_ordered_as_before(scene, tmp_path):
    place_camera(scene, "dog")
    obj = load(REFERENCES / "dog.ply")
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, ["depth"])
    assert order.request["passes"] == ["depth"] and order.request["counts"] == [150]
    assert [of.name for of in order.objects] == [obj.name]
    assert order.request["near_clip"] == pytest.approx(get_input(splat_modifier(obj), "Near Clip"))
    assert order.camera.width == scene.render.resolution_x and "samples" not in order.request
