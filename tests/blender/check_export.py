"""Export: the very bits of what nobody touched, and edits that arrive."""

import os

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from model_files import export, load
from model_values import assert_equal, assert_moved, colors, covariances, some_directions
from references import REFERENCES, place_camera

from blender_addon.engine.order import make_order
from blender_addon.files.model import sigmoid
from blender_addon.files.ply import read_comments, read_ply
from blender_addon.files.said import Said, said_in
from blender_addon.files.sh import C0, sh_basis
from blender_addon.nodes.modifier import get_input, set_input, splat_modifier


def test_an_untouched_model_comes_back_byte_for_byte(model, tmp_path):
    load(model, up_axis="-Y", scale=2.5)
    export(tmp_path / "out.ply")
    assert (tmp_path / "out.ply").read_bytes() == model.read_bytes()


def test_a_linear_model_says_so_again_byte_for_byte(tmp_path):
    source = REFERENCES / "linear.ply"
    load(source, scale=2.5)
    export(tmp_path / "out.ply")
    assert (tmp_path / "out.ply").read_bytes() == source.read_bytes()


@pytest.mark.parametrize("options", [{}, {"up_axis": "Y", "scale": 0.3}, {"place": False}, {"sh_degree": 3}])
def test_how_a_model_is_drawn_comes_back_byte_for_byte(scene, tmp_path, options):
    source = REFERENCES / "says.ply"
    scene.unit_settings.scale_length = 0.3
    load(source, **options)
    export(tmp_path / "out.ply")
    assert (tmp_path / "out.ply").read_bytes() == source.read_bytes()


def test_how_a_model_is_drawn_now_is_what_the_export_says(scene, model, tmp_path):
    """Near clips are in units of what is written: those of the file, 2 m long, or those of the scene."""
    obj = load(REFERENCES / "says.ply")
    scene.unit_settings.scale_length = 0.5
    assert said(tmp_path / "out.ply", space="WORLD") == Said(True, 0.1, False, (0, 0, 1), 0.5)
    set_input(splat_modifier(obj), "Antialiased", False)
    set_input(splat_modifier(obj), "Near Clip", 0.3)
    assert said(tmp_path / "out.ply") == Said(False, 0.15, False, (0, -1, 0), 2.0)
    other = load(model)
    assert said(tmp_path / "out.ply") == Said()
    set_input(splat_modifier(other), "Antialiased", True)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    assert said(tmp_path / "out.ply") == Said(True, 0.15, False, (0, -1, 0), 2.0)


def test_the_near_clip_of_a_file_that_says_none_has_the_scale_of_the_import(scene, model, tmp_path):
    """So it is said where the units that are written are others, and not in those of the file."""
    obj = load(model, scale=0.01)
    assert get_input(splat_modifier(obj), "Near Clip") == pytest.approx(0.002)
    assert said(tmp_path / "out.ply") == Said()
    assert said(tmp_path / "out.ply", space="WORLD").near_clip == pytest.approx(0.002)
    set_input(splat_modifier(obj), "Near Clip", 0.2)
    assert said(tmp_path / "out.ply").near_clip == pytest.approx(20)


def said(path, **options):
    """What a file says that is exported now."""
    export(path, **options)
    return said_in(read_comments(path))


def test_a_real_model_comes_back_byte_for_byte(shared, tmp_path):
    """Quaternions that are not of unit length, and opacities that saturate."""
    source = shared / "models" / "kacytran_try_iter7000_9k_sh3.ply"
    load(source)
    assert_equal(export(tmp_path / "out.ply"), read_ply(source))


def test_deleted_splats_are_gone_and_the_rest_keeps_its_bits(model, tmp_path):
    obj, raw = load(model), read_ply(model)
    gone = np.zeros(raw.n_splats, bool)
    gone[::3] = True
    obj.data.vertices.foreach_set("select", gone)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    assert_equal(export(tmp_path / "out.ply"), raw.select(~gone))  # still in edit mode


def test_an_edited_attribute_arrives_and_its_neighbours_keep_their_bits(model, tmp_path):
    obj, raw = load(model), read_ply(model)
    opacity, scale = obj.data.attributes["radiance:base"].data, obj.data.attributes["scale"].data
    opacity[4].color = (*opacity[4].color[:3], 0.25)
    scale[7].vector = (0.1, 0.2, 0.3)
    found = export(tmp_path / "out.ply")
    assert sigmoid(found.logit_opacities)[4] == pytest.approx(0.25, rel=1e-5)
    assert np.exp(found.log_scales[7]) == pytest.approx((0.1, 0.2, 0.3), rel=1e-5)
    others = np.arange(raw.n_splats)
    assert np.array_equal(found.logit_opacities[others != 4], raw.logit_opacities[others != 4])
    assert np.array_equal(found.log_scales[others != 7], raw.log_scales[others != 7])


@pytest.mark.parametrize("applied", [False, True])
def test_a_moved_model_is_moved_with_its_covariances_and_colors(model, tmp_path, applied):
    obj, raw = load(model, up_axis="Y", scale=1.5), read_ply(model)
    move = Matrix.Translation((1, -2, 0.5)) @ Matrix.Rotation(0.8, 4, (1, 2, -1)) @ Matrix.Scale(1.7, 4)
    imported = np.array(obj.matrix_world)
    obj.matrix_world = move @ obj.matrix_world
    bpy.context.view_layer.update()
    if applied:
        assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
        bpy.context.view_layer.update()
        assert obj.matrix_world == Matrix.Identity(4)
    found = export(tmp_path / "out.ply")
    matrix = np.linalg.inv(imported) @ np.array(move) @ imported  # in coordinates of the file
    assert_moved(found, raw, matrix)
    assert np.abs(raw.sh_coeffs[:, 1:] - found.sh_coeffs[:, 1:]).max() > 0.1
    assert np.allclose(found.dog_log_scales[raw.is_dog], raw.dog_log_scales[raw.is_dog], atol=1e-5)


def test_the_basis_is_that_of_the_package():
    """Values of the field's own constants at one direction, worked out by hand."""
    x, y, z = np.array([1.0, 2.0, -2.0]) / 3
    basis = sh_basis(np.array([[x, y, z]]), 3)[0]
    assert basis[0] == C0
    assert np.allclose(basis[1:4], np.sqrt(3 / (4 * np.pi)) * np.array([-y, z, -x]))
    assert basis[6] == pytest.approx(np.sqrt(5 / (16 * np.pi)) * (3 * z * z - 1))
    assert basis[12] == pytest.approx(np.sqrt(7 / (16 * np.pi)) * (5 * z**3 - 3 * z))


def test_coordinates_of_the_scene(model, tmp_path):
    obj, raw = load(model, up_axis="-Y"), read_ply(model)
    found = export(tmp_path / "out.ply", space="WORLD")
    assert np.allclose(found.means, raw.means[:, [0, 2, 1]] * (1, 1, -1), atol=1e-5)
    assert obj.matrix_world != Matrix.Identity(4)


def test_two_models_become_one(model, tmp_path):
    raw = read_ply(model)
    first, second = load(model), load(model, sh_degree=1)
    first.select_set(True)
    second.select_set(True)
    found = export(tmp_path / "out.ply")
    assert found.n_splats == 2 * raw.n_splats and found.sh_degree == 3
    assert np.array_equal(found.sh_coeffs[: raw.n_splats], raw.sh_coeffs)
    assert not found.sh_coeffs[raw.n_splats :, 4:].any()


@pytest.mark.parametrize("scale, applied", [((1, 2, 1), True), ((-1, 1, 1), True), ((1.1, -0.8, 1.5), False)])
def test_a_stretched_or_mirrored_model_is_exported_so(model, tmp_path, scale, applied):
    """Oracle: covariance A Σ Aᵀ; of mirrors colours too, from the direction that was mirrored along."""
    obj, raw = load(model), read_ply(model)
    obj.matrix_world = Matrix.Rotation(0.8, 4, (1, 2, -1)) @ Matrix.Diagonal((*scale, 1))
    bpy.context.view_layer.update()
    linear = np.array(obj.matrix_world)[:3, :3]
    if applied:
        assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    found = export(tmp_path / "out.ply")
    assert np.allclose(found.means, raw.means @ linear.T, atol=1e-4)
    expected = linear @ covariances(raw) @ linear.T
    assert np.allclose(covariances(found), expected, rtol=1e-3, atol=1e-5 * np.abs(expected).max())
    directions = some_directions(raw)
    after = directions @ linear.T
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    error, ignored = (np.abs(colors(m, after) - colors(raw, directions)).mean() for m in (found, raw))
    assert error < (1e-5 if scale == (-1, 1, 1) else ignored / 2)
    assert np.array_equal(found.is_dog, raw.is_dog)


def test_what_splats_cannot_follow_is_said(model, tmp_path):
    obj = load(model)
    obj.scale = 1, 1, 0
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match='"dog".*cannot be flattened'):
        export(tmp_path / "out.ply")
    assert not (tmp_path / "out.ply").exists()


def test_a_place_that_cannot_be_written_is_said(model, tmp_path):
    load(model)
    with pytest.raises(RuntimeError, match="nowhere.*cannot be written"):
        export(tmp_path / "nowhere" / "out.ply")


@pytest.mark.skipif(os.name != "posix", reason="elsewhere not everybody may make links")
def test_a_symbolic_link_stays_one_and_what_it_leads_to_is_written(model, tmp_path):
    load(model)
    (tmp_path / "models").mkdir()
    link, circle = tmp_path / "newest.ply", tmp_path / "circle.ply"
    link.symlink_to("models/a.ply")
    circle.symlink_to("circle.ply")
    for _ in range(2):  # what it leads to is not there at first
        export(link)
        assert link.is_symlink() and (tmp_path / "models" / "a.ply").read_bytes() == model.read_bytes()
    with pytest.raises(RuntimeError, match="circle.ply: cannot be written"):
        export(circle)
    assert circle.is_symlink() and not list(tmp_path.rglob("*.part"))


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_files_have_the_permissions_of_new_files_and_keep_their_own(model, tmp_path):
    load(model)
    path, before = tmp_path / "out.ply", os.umask(0o027)
    try:
        export(path)
        assert path.stat().st_mode & 0o777 == 0o640
        path.chmod(0o664)
        export(path)
        assert path.stat().st_mode & 0o777 == 0o664
    finally:
        os.umask(before)


def test_a_name_may_be_as_long_as_names_can_be(model, tmp_path):
    load(model)
    export(tmp_path / f"{'ä' * 125}.ply")
    assert [len(os.fsencode(path.name)) for path in tmp_path.iterdir()] == [254]


def with_scales(obj, values):
    obj.data.attributes["scale"].data.foreach_set("vector", np.asarray(values, np.float32).ravel())
    obj.data.update()


def test_scales_below_0_are_as_long_as_those_above(model, tmp_path):
    """As in pictures: an axis has two ends."""
    obj, before = load(model), read_ply(model)
    with_scales(obj, -np.exp(before.log_scales))
    assert np.allclose(export(tmp_path / "out.ply").log_scales, before.log_scales, atol=1e-6)


@pytest.mark.parametrize("damaged", ["gone", [1.0] * 15, [0.0] * 16, [float("nan")] * 16])
def test_where_a_file_had_its_axes_is_damaged_and_told(model, tmp_path, damaged):
    """Anybody may edit custom properties. An export in coordinates of the scene asks for none."""
    obj = load(model)
    obj["dogsplat_import_matrix"] = damaged
    said = f'the custom property dogsplat_import_matrix of "{obj.name}" is no matrix with an inverse; remove it'
    with pytest.raises(RuntimeError, match=said):
        export(tmp_path / "out.ply")
    assert not list(tmp_path.iterdir())
    obj.scale = (1, 2, 3)
    bpy.context.view_layer.update()
    bpy.ops.dogsplat.apply_transform()
    export(tmp_path / "out.ply", space="WORLD")


def test_an_object_is_named_whose_values_are_not_finite(scene, model, tmp_path):
    """Of several, by renders too, which write files of their own."""
    load(model)
    obj = load(model)
    with_scales(obj, np.where(np.arange(150)[:, None] < 7, np.nan, np.exp(read_ply(model).log_scales)))
    bpy.ops.object.select_all(action="SELECT")
    said = f'"{obj.name}": 7 of its splats have values that are not finite; delete them'
    with pytest.raises(RuntimeError, match=said):
        bpy.ops.export_scene.dogsplat(filepath=str(tmp_path / "out.ply"))
    place_camera(scene, "dog")
    with pytest.raises(ValueError, match=said):
        make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert not list(tmp_path.glob("*.ply"))
