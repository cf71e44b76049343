"""Slopes, curvatures, cuts, second cuts and shifts: kept through all that Blender does, drawn by the package."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from blender_pictures import psnr, rendered
from drawn_panels import drawn
from edits import PLACED, TURN, cropped, local, paint, shown
from live_views import staged, through_the_camera
from mathutils import Matrix
from model_files import export, load
from model_values import assert_equal
from own_rows import ATTRIBUTES, VALUES, WORDS, assert_taken_along, who
from references import REFERENCES, place_camera, reference
from surroundings import body, material, plane

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.files.model import CURVATURES, concatenate
from blender_addon.files.ply import read_ply, write_ply
from blender_addon.files.sh import C0
from blender_addon.nodes.modifier import edit_modifiers, set_input
from blender_addon.objects import cloud
from blender_addon.objects.attributes import read_attributes
from blender_addon.objects.columns import put_column
from blender_addon.package.renderers import InProcess
from blender_addon.render_engine import ENGINE

NO_SLOPES, NO_CUTS = "Blender draws mean colors, no slopes", "Blender draws whole splats, no cuts"
NO_CURVATURES, NO_SHIFTS = "Blender draws mean brightness, no curvatures", "Blender draws mean places, no shifts"
NOTES = {"slopes": NO_SLOPES, "curvatures": NO_CURVATURES, "cuts": NO_CUTS, "second_cuts": NO_CUTS,
         "shifts": NO_SHIFTS}  # fmt: skip


@pytest.fixture(params=NOTES)
def kind(request):
    return request.param


@pytest.fixture
def path(kind):
    """A model of which every third splat has slopes, curvatures, a cut, a second one without a first, or shifts."""
    return REFERENCES / f"{kind}.ply"


@pytest.fixture
def together(tmp_path):
    """The models of all kinds as one, each splat of which has one kind at most."""
    write_ply(tmp_path / "together.ply", concatenate([read_ply(REFERENCES / f"{kind}.ply") for kind in NOTES]))
    return tmp_path / "together.ply"


def test_an_untouched_model_comes_back_byte_for_byte(path, kind, tmp_path):
    load(path, up_axis="-Y", scale=2.5)
    assert 0 < who(read_ply(path), kind).sum() < 150
    export(tmp_path / "out.ply")
    assert (tmp_path / "out.ply").read_bytes() == path.read_bytes()


def test_a_model_without_has_no_attributes_for_them(model, path, kind):
    plain = {a.name for a in load(model).data.attributes}
    types = {a.name: a.data_type for a in load(path).data.attributes if a.name not in plain}
    assert types == {f"dog:has_{kind}": "INT", **dict.fromkeys(ATTRIBUTES[kind], "FLOAT_VECTOR")}


def test_the_import_counts_them(model, together, capfd):
    expected = {model: [], **{REFERENCES / f"{kind}.ply": [words] for kind, words in WORDS.items()},
                together: [*WORDS.values()]}  # fmt: skip
    for path, words in expected.items():
        load(path)
        assert ", ".join(["of them DoG", *words]) + "\n" in capfd.readouterr().out


@pytest.mark.parametrize("applied", [False, True])
@pytest.mark.parametrize("move", [TURN, Matrix.Diagonal((-1, 1, 1, 1)), Matrix.Diagonal((1, 2, 1.3, 1))])
def test_a_moved_mirrored_or_stretched_model_takes_them_along(together, tmp_path, move, applied):
    obj, raw = load(together), read_ply(together)
    obj.matrix_world = Matrix.Translation((0.5, 0, 1)) @ move @ Matrix.Rotation(0.4, 4, (1, 0, 1))
    bpy.context.view_layer.update()
    matrix = np.array(obj.matrix_world, float)
    if applied:
        assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    found = export(tmp_path / "out.ply")
    for kind in NOTES:
        assert_taken_along(found, raw, kind, matrix)


def test_they_follow_vertices_that_blender_turned(path, kind):
    obj, raw = load(path), read_ply(path)
    obj.matrix_world = PLACED
    bpy.context.view_layer.update()
    obj.select_set(True)
    assert bpy.ops.object.transform_apply() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert_taken_along(read_attributes(obj.data), raw, kind, np.array(PLACED))


def test_hidden_and_deleted_splats_leave_those_of_others_alone(path, kind):
    obj, raw = load(path), read_ply(path)
    _, target = cropped(obj, "BOX")
    inside = (np.abs(local(obj, target, raw.means)) <= 1).all(axis=1)
    assert 0 < who(raw, kind)[inside].sum() < who(raw, kind).sum()
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
def test_joined_with_a_model_without_they_stay_and_the_others_get_none(path, kind, model, join, first_has):
    names = [model, path] if first_has else [path, model]
    second, first = load(names[0]), load(names[1])
    second.matrix_world = PLACED
    second.select_set(True)
    bpy.context.view_layer.update()
    assert join() == {"FINISHED"}
    bpy.context.view_layer.update()
    raw, found = read_ply(path), read_attributes(first.data)
    assert found.n_splats == 300 and who(found, kind).sum() == 50
    assert not getattr(found, VALUES[kind])[~who(found, kind)].any()
    start = int(np.flatnonzero(who(found, kind))[0])  # of the model, whose first splat has some
    matrix = np.eye(4) if first_has else np.array(PLACED)
    assert_taken_along(found.select(np.arange(start, start + 150)), raw, kind, matrix)


def test_a_tint_multiplies_slopes_and_curvatures_and_leaves_others_alone(path, kind):
    obj, raw = load(path), read_ply(path)
    bpy.ops.dogsplat.paint(what="TINT")
    tinted = np.arange(30, 60)
    paint(stand_in_of(obj), tinted, color=(1.0, 0.2, 0.0, 1.0))
    found, factor = shown(obj), np.array([1.0, 1.055 * 0.2 ** (1 / 2.4) - 0.055, 0.0])
    now, before = (getattr(model, VALUES[kind])[tinted] for model in (found, raw))
    times = {"slopes": factor, "curvatures": factor.mean()}.get(kind, 1)
    assert np.allclose(now, before * times, atol=1e-5)
    assert np.abs(before).max() > 0.3
    others = np.setdiff1d(np.arange(raw.n_splats), tinted)
    assert_equal(found.select(others), raw.select(others))


def test_as_attributes_of_points_they_are_what_they_were(path, kind):
    """Of a point cloud, which Blender's own splats are; put there without those."""
    raw = read_ply(path)
    if "resize" not in bpy.types.PointCloud.bl_rna.functions:
        pytest.skip("point clouds get points from Python since Blender 5.2")
    points = bpy.data.pointclouds.new("points")
    points.resize(raw.n_splats)
    cloud.put_columns(points, raw, "FLOAT_COLOR")
    assert_equal(read_attributes(points), raw)
    put_column(points, ATTRIBUTES[kind][0], np.zeros((raw.n_splats, 3), np.float32))
    now = getattr(read_attributes(points), VALUES[kind]).reshape(raw.n_splats, len(ATTRIBUTES[kind]), 3)
    before = getattr(raw, VALUES[kind]).reshape(now.shape)
    assert not now[:, 0].any() and np.array_equal(now[:, 1:], before[:, 1:])


def test_the_panel_says_what_blender_does_not_draw(scene, path, kind, model, together):
    place_camera(scene, kind)
    load(model)
    assert not {*NOTES.values()} & {*drawn()}
    load(path)
    assert {*NOTES.values()} & {*drawn()} == {NOTES[kind]}
    scene.render.engine = "CYCLES"
    assert NOTES[kind] in drawn()
    scene.render.engine = ENGINE
    assert NOTES[kind] not in drawn()
    load(together)
    assert not {*NOTES.values()} & {*drawn()}
    scene.render.engine = "CYCLES"
    assert [name for name in drawn() if name in NOTES.values()] == [NO_SLOPES, NO_CURVATURES, NO_CUTS, NO_SHIFTS]


def test_blender_draws_the_average_brightness(scene, tmp_path):
    """As of the model whose colours have it."""
    raw = read_ply(REFERENCES / "curvatures.ply")
    inverse = np.exp(-1.5 * raw.log_scales)
    across = 1 - inverse / inverse.sum(axis=1, keepdims=True)
    raw.sh_coeffs[:, 0] += (across * raw.brightness_curvatures[:, :3]).sum(axis=1, keepdims=True) / 4 / C0
    flat = replace(raw, **CURVATURES.of_none(raw.n_splats))
    write_ply(tmp_path / "flat.ply", flat)
    place_camera(scene, "curvatures")
    pictures = []
    for path in (REFERENCES / "curvatures.ply", tmp_path / "flat.ply", REFERENCES / "dog.ply"):
        obj = load(path)
        bpy.ops.dogsplat.exact_settings()
        pictures.append(rendered(scene, "CYCLES", tmp_path))
        bpy.data.objects.remove(obj)
    drawn, expected, without = pictures
    assert np.abs(drawn - expected).max() < 1e-4 < 1e-2 < np.abs(without - expected).max()


def test_a_splat_as_thin_as_can_be_has_a_color(scene, tmp_path):
    """Its average brightness takes a power of its scales, which float32 holds of larger ones only."""
    raw = read_ply(REFERENCES / "curvatures.ply")
    place_camera(scene, "curvatures")
    pictures = []
    for thinnest in (-30, -70):
        raw.log_scales[:, 0] = thinnest
        write_ply(tmp_path / "thin.ply", raw)
        obj = load(tmp_path / "thin.ply")
        bpy.ops.dogsplat.exact_settings()
        pictures.append(rendered(scene, "CYCLES", tmp_path))
        bpy.data.objects.remove(obj)
    assert np.isfinite(pictures).all() and np.std(pictures[0]) > 0.05
    assert np.abs(pictures[1] - pictures[0]).max() < 1e-4


@pytest.mark.parametrize("placed", [False, True])
def test_the_final_frame_shows_them(scene, by_command, path, kind, tmp_path, placed):
    place_camera(scene, kind)
    obj = load(path)
    if placed:
        obj.matrix_world = TURN @ obj.matrix_world
        scene.camera.matrix_world = (TURN @ scene.camera.matrix_world).normalized()
        set_input(obj.modifiers[-1], "Near Clip", 0.34)
    scene.view_settings.view_transform = "Raw"
    scene.dogsplat_colors = "DISPLAY"
    picture = rendered(scene, ENGINE, tmp_path)
    assert psnr(picture, reference(kind)["color"]) > (50 if placed else 70)
    assert psnr(picture, reference("dog")["color"]) < 40


@pytest.mark.parametrize("kind", ["curvatures", "second_cuts", "shifts"], indirect=True)
def test_a_whole_scene_shows_them(scene, by_command, path, kind, model, tmp_path):
    """With a wall that the camera does not see: they change what they change in the final frame of the splats alone.

    Not to the same values, as a whole scene blends linear ones.
    """
    place_camera(scene, "square")
    pictures = {}
    for name in (path, model):
        obj = load(name)
        alone = rendered(scene, ENGINE, tmp_path)
        wall = body(plane(1), material("ShaderNodeBsdfDiffuse"))
        wall.matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, 9))
        assert staged(tmp_path, through_the_camera(scene).camera).whole
        pictures[name] = np.stack([alone, rendered(scene, ENGINE, tmp_path)])
        for made in (wall, obj):
            bpy.data.objects.remove(made)
    alone, whole = pictures[path] - pictures[model]
    assert np.corrcoef(alone.ravel(), whole.ravel())[0, 1] > 0.7


def test_models_of_other_formats_bring_them_along(command, tmp_path):
    """By the command, and in this process where that has the package. Every third splat has some of every kind."""
    path = REFERENCES / "every.ply"
    expected = read_ply(path)
    ways = [command]
    try:
        import mitsuba  # noqa: F401
    except ImportError:
        pass
    else:
        ways.append(InProcess())
    for way in ways:
        way.convert(path.with_suffix(".compressed.ply"), tmp_path / "out.ply")
        found = read_ply(tmp_path / "out.ply")
        way.convert(path, tmp_path / "plain.ply", bake=True)
        plain = read_ply(tmp_path / "plain.ply")
        assert found.is_dog.sum() == expected.is_dog.sum() and not plain.is_dog.any()
        assert np.array_equal(plain.means, expected.means)  # those of the whole one nearest to a cut are elsewhere
        for kind in NOTES:
            assert who(found, kind).sum() == who(expected, kind).sum() == 50
            assert np.array_equal(who(plain, kind), who(expected, kind))
