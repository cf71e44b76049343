"""Import: attributes, options, errors, and life in a Blender file afterwards."""

import shutil
import time

import bpy
import numpy as np
import pytest
from model_files import datablocks, load

from blender_addon.files.model import sigmoid
from blender_addon.files.ply import read_ply
from blender_addon.import_export import import_operator
from blender_addon.nodes.modifier import EXPRESSIONS, get_input, splat_modifier
from blender_addon.objects.attributes import read_attributes


def values(obj, name, field, width):
    out = np.empty(len(obj.data.vertices) * width, np.float32)
    obj.data.attributes[name].data.foreach_get(field, out)
    return out.reshape(-1, width)


def test_attributes_are_blenders_own_schema(model):
    obj, raw = load(model), read_ply(model)
    n, types = raw.n_splats, {a.name: (a.data_type, a.domain) for a in obj.data.attributes}
    assert types["scale"] == ("FLOAT_VECTOR", "POINT") and types["rotation"] == ("QUATERNION", "POINT")
    assert types["radiance:base"] == ("FLOAT_COLOR", "POINT") and types["radiance:sh_14"] == ("FLOAT_VECTOR", "POINT")
    assert types["dog:opacity_factor"] == ("FLOAT", "POINT") and types["dog:scale_factor"] == ("FLOAT_VECTOR", "POINT")
    assert len(obj.data.vertices) == n
    assert np.array_equal(values(obj, "position", "vector", 3), raw.means)
    assert np.allclose(values(obj, "scale", "vector", 3), np.exp(raw.log_scales), rtol=1e-6)
    base = values(obj, "radiance:base", "color", 4)
    assert np.array_equal(base[:, :3], raw.sh_coeffs[:, 0])
    assert np.allclose(base[:, 3], sigmoid(raw.logit_opacities), rtol=1e-6)
    assert np.array_equal(values(obj, "radiance:sh_6", "vector", 3), raw.sh_coeffs[:, 7])
    quats = values(obj, "rotation", "value", 4)
    assert np.allclose(np.linalg.norm(quats, axis=1), 1, atol=1e-6)
    cosine = np.sum(quats * raw.quats, 1) / np.linalg.norm(raw.quats, axis=1)
    assert np.allclose(cosine, 1, atol=1e-6)
    factor = values(obj, "dog:opacity_factor", "value", 1)[:, 0]
    assert np.allclose(factor[raw.is_dog], sigmoid(raw.dog_logit_opacities[raw.is_dog]), rtol=1e-6)
    assert not factor[~raw.is_dog].any() and 0 < raw.is_dog.sum() < n


def test_the_object_is_visible_at_once_and_remembers_where_it_comes_from(model):
    obj = load(model)
    assert splat_modifier(obj) is not None and obj["dogsplat_source"] == str(model)
    materials = [
        [material.name for material in instance.object.data.materials if material]
        for instance in bpy.context.evaluated_depsgraph_get().object_instances
        if instance.is_instance
    ]
    assert len(materials) > 100 and all(names == ["DoG Splat ellipsoids"] for names in materials)


def test_options_of_the_redo_panel_do_what_they_say(model):
    raw = read_ply(model)
    opacity = sigmoid(raw.logit_opacities)
    assert len(load(model, min_opacity=0.5).data.vertices) == np.count_nonzero(opacity >= 0.5) > 0
    obj = load(model, max_count=20)
    kept = read_attributes(obj.data)
    size = np.sort(np.exp(raw.log_scales), axis=1)
    weight = opacity * size[:, 1] * size[:, 2]
    best = np.sort(np.argsort(-weight)[:20])
    assert np.array_equal(kept.means, raw.means[best])
    assert read_attributes(load(model, sh_degree=1).data).sh_degree == 1
    obj = load(model, use_dog=False, color_mode="DISPLAY", show_as="QUADS", antialiased=True)
    modifier = splat_modifier(obj)
    assert [get_input(modifier, n) for n in ("DoG", "Linear Colors", "Antialiased")] == [False, False, True]
    assert get_input(modifier, "Show As") == "Quads"
    assert obj.matrix_world == load(model).matrix_world
    turned = load(model, up_axis="-Y", scale=2.0)
    assert np.allclose(
        turned.matrix_world @ turned.data.vertices[0].co, 2 * raw.means[0][[0, 2, 1]] * (1, 1, -1), rtol=1e-5
    )


@pytest.mark.parametrize(
    "before, option, after",
    [("SOLID", True, "MATERIAL"), ("SOLID", False, "SOLID"), ("WIREFRAME", True, "WIREFRAME")],
)
def test_a_solid_viewport_is_prepared_for_splats(model, before, option, after):
    areas = bpy.context.window_manager.windows[0].screen.areas
    space = next(area.spaces.active for area in areas if area.type == "VIEW_3D")
    space.shading.type = before
    load(model, prepare_viewports=option)
    assert (space.shading.type, space.overlay.show_outline_selected) == (after, after != "MATERIAL")


def test_several_files_become_several_objects_that_share_trees_and_materials(model, tmp_path):
    for name in ("a.ply", "b.ply"):
        shutil.copy(model, tmp_path / name)
    files = [{"name": "a.ply"}, {"name": "b.ply"}]
    bpy.ops.import_scene.dogsplat(filepath=str(tmp_path / "a.ply"), directory=str(tmp_path), files=files)
    assert sorted(obj.name for obj in bpy.context.selected_objects) == ["a", "b"]
    load(model)
    trees = [g for g in bpy.data.node_groups if g.name.split(".")[0] == "DoG Splat"]
    assert len(trees) == 1 and len(bpy.data.materials) == 4


@pytest.mark.parametrize(
    "content, message",
    [
        (b"", "not a PLY file"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty float x\nend_header\n", "ends inside"),
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 9999999999999999\nproperty float x\nend_header\n",
            "ends",
        ),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 9999999999999999999\nend_header\n", "makes no sense"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", 'no property "y"'),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\none\n", "not a number"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty floot x\nend_header\n1\n", "floot"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float x\nend_header\n1 2\n",
            'property "x" is declared twice',
        ),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nelement vertex 1\nend_header\n", '"vertex" is declared twice'),
    ],
)
def test_a_bad_file_is_one_line_and_leaves_nothing(model, tmp_path, content, message):
    (tmp_path / "bad.ply").write_bytes(content)
    shutil.copy(model, tmp_path / "good.ply")
    before = datablocks()
    with pytest.raises(RuntimeError) as caught:  # how operators report errors to Python
        bpy.ops.import_scene.dogsplat(
            filepath=str(tmp_path / "good.ply"),
            directory=str(tmp_path),
            files=[{"name": "good.ply"}, {"name": "bad.ply"}],
        )
    line = str(caught.value).strip()
    assert "\n" not in line and "bad.ply" in line and message in line and "Traceback" not in line
    assert datablocks() == before


def test_a_model_does_not_go_into_a_collection_of_another_file(scene, model, tmp_path):
    """Which may be the active one, and cannot be changed."""
    import addon_utils

    scene.collection.children.link(bpy.data.collections.new("library"))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("blender_addon")
    with bpy.data.libraries.load(str(tmp_path / "source.blend"), link=True) as (_, target):
        target.collections = ["library"]
    collection, layer = bpy.context.scene.collection, bpy.context.view_layer
    collection.children.link(target.collections[0])
    layer.active_layer_collection = layer.layer_collection.children[0]
    assert bpy.context.collection.library is not None
    assert load(model).users_collection == (collection,)


def test_a_failure_while_building_leaves_nothing(model, monkeypatch):
    def broken(obj):
        raise RuntimeError("no memory")

    monkeypatch.setattr(import_operator, "add_modifier", broken)
    before = datablocks()
    with pytest.raises(RuntimeError, match="no memory"):
        load(model)
    assert datablocks() == before


def test_undo_takes_an_import_back(model):
    bpy.ops.ed.undo_push(message="before")
    load(model)
    bpy.ops.ed.undo_push(message="import")
    assert len(bpy.data.objects) == 1
    bpy.ops.ed.undo()
    assert len(bpy.data.objects) == 0


def test_a_saved_file_reopens_as_it_was(model, tmp_path):
    expected = read_attributes(load(model, color_mode="DISPLAY").data)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    obj = bpy.data.objects["dog"]
    assert np.array_equal(read_attributes(obj.data).sh_coeffs, expected.sh_coeffs)
    assert get_input(splat_modifier(obj), "Linear Colors") is False
    assert len(obj.animation_data.drivers) == len(EXPRESSIONS) and obj.modifiers[0].node_group.nodes


def test_append_to_another_file_brings_everything(model, tmp_path, scene):
    load(model)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.append(directory=str(tmp_path / "source.blend" / "Object"), filename="dog")
    obj = bpy.data.objects["dog"]
    assert splat_modifier(obj).node_group.name == "DoG Splat" and len(bpy.data.materials) == 4
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    camera.data.lens = 18.0
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 500, 400
    bpy.context.view_layer.update()
    seen = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert get_input(splat_modifier(seen), "Focal X") == pytest.approx(250)


def test_a_large_model_imports(shared):
    start = time.process_time()
    obj = load(shared / "models" / "playbot_lod2_sh2.ply")
    print(f"125,000 splats: {time.process_time() - start:.2f} s of processor time")
    assert len(obj.data.vertices) == 125_000
