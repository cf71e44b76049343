"""Colours that vary over their primitive: kept through all that Blender does to splats, drawn by the package."""

import bpy
import numpy as np
import pytest
from blender_pictures import psnr, rendered
from drawn_panels import drawn
from edits import PLACED, TURN, cropped, local, paint, shown
from mathutils import Matrix
from model_files import export, load
from model_values import assert_equal
from references import REFERENCES, place_camera, reference

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.files.model import Model, normalized
from blender_addon.files.ply import read_ply
from blender_addon.files.rotation import rotations
from blender_addon.nodes.modifier import edit_modifiers, set_input
from blender_addon.objects import cloud
from blender_addon.objects.attributes import read_attributes
from blender_addon.objects.columns import put_column
from blender_addon.package.renderers import InProcess
from blender_addon.render_engine import ENGINE

NOTE = "Blender draws mean colours, no slopes"


@pytest.fixture
def sloped():
    return REFERENCES / "slopes.ply"


def columns(model: Model) -> np.ndarray:
    """[N, 3, 3]: standard deviations along the axes of each primitive, in the world."""
    return rotations(normalized(model.quats).astype(float)) * np.exp(model.log_scales.astype(float))[:, None]


def differences(model: Model, points: np.ndarray) -> np.ndarray:
    """What slopes add to the colours of those that have them, at points [S, P, 3] of the world."""
    rows = model.has_slopes
    w = np.linalg.solve(columns(model)[rows][:, None], (points - model.means[rows][:, None])[..., None])[..., 0]
    return np.einsum("spa,sac->spc", w, model.color_slopes[rows].astype(float))


def points_in(model: Model) -> np.ndarray:
    """[S, 7, 3] places within some standard deviations of each that has slopes."""
    w = np.random.default_rng(2).normal(size=(model.has_slopes.sum(), 7, 3))
    rows = model.has_slopes
    return model.means[rows][:, None] + np.einsum("ska,spa->spk", columns(model)[rows], w)


def assert_slopes_moved(found: Model, raw: Model, matrix: np.ndarray) -> None:
    """Oracle: a place has the colour that it had before it was moved."""
    points = points_in(raw)
    expected = differences(raw, points)
    assert np.array_equal(found.has_slopes, raw.has_slopes) and np.abs(expected).mean() > 0.2
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.allclose(differences(found, moved), expected, atol=1e-3)


def test_an_untouched_model_comes_back_byte_for_byte(sloped, tmp_path):
    load(sloped, up_axis="-Y", scale=2.5)
    raw = read_ply(sloped)
    assert 0 < raw.has_slopes.sum() < raw.n_splats
    export(tmp_path / "out.ply")
    assert (tmp_path / "out.ply").read_bytes() == sloped.read_bytes()


def test_a_model_without_slopes_has_no_attributes_for_them(model, sloped):
    assert not [a.name for a in load(model).data.attributes if "slope" in a.name]
    kinds = {a.name: a.data_type for a in load(sloped).data.attributes if "slope" in a.name}
    assert kinds == {"dog:has_slopes": "INT", **{f"dog:slope_{axis}": "FLOAT_VECTOR" for axis in "xyz"}}


def test_the_import_counts_them(sloped, model, monkeypatch):
    from blender_addon.import_export import import_operator

    said = []
    monkeypatch.setattr(import_operator, "told", lambda text, **values: said.append(text.format(**values)) or said[-1])
    load(sloped)
    load(model)
    found = [text for text in said if "imported" in text]
    assert found[1].endswith("of them DoG, 50 with slopes") and len(found) == 3 and "slopes" not in found[2]


@pytest.mark.parametrize("applied", [False, True])
@pytest.mark.parametrize("move", [TURN, Matrix.Diagonal((-1, 1, 1, 1)), Matrix.Diagonal((1, 2, 1.3, 1))])
def test_a_moved_mirrored_or_stretched_model_takes_them_along(sloped, tmp_path, move, applied):
    obj, raw = load(sloped), read_ply(sloped)
    obj.matrix_world = Matrix.Translation((0.5, 0, 1)) @ move @ Matrix.Rotation(0.4, 4, (1, 0, 1))
    bpy.context.view_layer.update()
    matrix = np.array(obj.matrix_world, float)
    if applied:
        assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    assert_slopes_moved(export(tmp_path / "out.ply"), raw, matrix)


def test_they_follow_vertices_that_blender_turned(sloped):
    obj, raw = load(sloped), read_ply(sloped)
    obj.matrix_world = PLACED
    bpy.context.view_layer.update()
    obj.select_set(True)
    assert bpy.ops.object.transform_apply() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert_slopes_moved(read_attributes(obj.data), raw, np.array(PLACED))


def test_hidden_and_deleted_splats_leave_the_slopes_of_others_alone(sloped, tmp_path):
    obj, raw = load(sloped), read_ply(sloped)
    _, target = cropped(obj, "BOX")
    inside = (np.abs(local(obj, target, raw.means)) <= 1).all(axis=1)
    assert 0 < raw.has_slopes[inside].sum() < raw.has_slopes.sum()
    assert_equal(shown(obj), raw.select(inside))
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    assert bpy.ops.dogsplat.apply_edits() == {"FINISHED"}
    assert_equal(read_attributes(obj.data), raw.select(inside))
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(obj)[0], "Maximum Count", 0)
    assert not shown(obj).n_splats or shown(obj).n_splats == inside.sum()


@pytest.mark.parametrize("join", [bpy.ops.object.join, lambda: bpy.ops.dogsplat.join()])
@pytest.mark.parametrize("first_has", [True, False])
def test_joined_with_a_model_without_they_stay_and_the_others_get_none(sloped, model, join, first_has):
    names = [model, sloped] if first_has else [sloped, model]
    second, first = load(names[0]), load(names[1])
    second.matrix_world = PLACED
    second.select_set(True)
    bpy.context.view_layer.update()
    assert join() == {"FINISHED"}
    bpy.context.view_layer.update()
    raw, found = read_ply(sloped), read_attributes(first.data)
    assert found.n_splats == 300 and found.has_slopes.sum() == 50
    assert not found.color_slopes[~found.has_slopes].any()
    start = int(np.flatnonzero(found.has_slopes)[0])  # of the model, whose first splat has slopes
    assert_slopes_moved(found.select(np.arange(start, start + 150)), raw, np.eye(4) if first_has else np.array(PLACED))


def test_a_tint_multiplies_them(sloped):
    obj, raw = load(sloped), read_ply(sloped)
    bpy.ops.dogsplat.paint(what="TINT")
    tinted = np.arange(30, 60)
    paint(stand_in_of(obj), tinted, color=(1.0, 0.2, 0.0, 1.0))
    found, factor = shown(obj), np.array([1.0, 1.055 * 0.2 ** (1 / 2.4) - 0.055, 0.0])
    assert np.allclose(found.color_slopes[tinted], raw.color_slopes[tinted] * factor, atol=1e-5)
    assert np.abs(raw.color_slopes[tinted]).max() > 0.3
    others = np.setdiff1d(np.arange(raw.n_splats), tinted)
    assert_equal(found.select(others), raw.select(others))


def test_as_attributes_of_points_they_are_what_they_were(sloped):
    """Of a point cloud, which Blender's own splats are; put there without those."""
    raw = read_ply(sloped)
    if "resize" not in bpy.types.PointCloud.bl_rna.functions:
        pytest.skip("point clouds get points from Python since Blender 5.2")
    points = bpy.data.pointclouds.new("points")
    points.resize(raw.n_splats)
    cloud.put_columns(points, raw, "FLOAT_COLOR")
    assert_equal(read_attributes(points), raw)
    put_column(points, "dog:slope_x", np.zeros((raw.n_splats, 3), np.float32))
    assert not read_attributes(points).color_slopes[:, 0].any()


def test_the_panel_says_that_blender_draws_mean_colours(scene, sloped, model):
    place_camera(scene, "slopes")
    load(model)
    assert NOTE not in drawn()
    load(sloped)
    assert NOTE in drawn()
    scene.render.engine = "CYCLES"
    assert NOTE in drawn()
    scene.render.engine = ENGINE
    assert NOTE not in drawn()


@pytest.mark.parametrize("placed", [False, True])
def test_the_final_frame_shows_them(scene, by_command, sloped, tmp_path, placed):
    place_camera(scene, "slopes")
    obj = load(sloped)
    if placed:
        obj.matrix_world = TURN @ obj.matrix_world
        scene.camera.matrix_world = (TURN @ scene.camera.matrix_world).normalized()
        set_input(obj.modifiers[-1], "Near Clip", 0.34)
    scene.view_settings.view_transform = "Raw"
    scene.dogsplat_colors = "DISPLAY"
    picture = rendered(scene, ENGINE, tmp_path)
    assert psnr(picture, reference("slopes")["color"]) > (50 if placed else 70)
    assert psnr(picture, reference("dog")["color"]) < 40


def test_models_of_other_formats_bring_them_along(command, tmp_path):
    """By the command, and in this process where that has the package."""
    expected = read_ply(REFERENCES / "slopes.ply")
    ways = [command]
    try:
        import mitsuba  # noqa: F401
    except ImportError:
        pass
    else:
        ways.append(InProcess())
    for way in ways:
        way.convert(REFERENCES / "slopes.compressed.ply", tmp_path / "out.ply")
        found = read_ply(tmp_path / "out.ply")
        assert found.has_slopes.sum() == expected.has_slopes.sum() and found.is_dog.sum() == expected.is_dog.sum()
        way.convert(REFERENCES / "slopes.ply", tmp_path / "plain.ply", bake=True)
        plain = read_ply(tmp_path / "plain.ply")
        assert plain.n_splats == 150 and not plain.is_dog.any()
        assert np.array_equal(plain.means, expected.means)
