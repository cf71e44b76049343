"""Pictures of Blender's engines against those of the ``dogsplat`` integrator for the same camera."""

import json

import bpy
import numpy as np
import pytest
from blender_pictures import EEVEE, as_srgb, psnr, rendered
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera, reference
from surroundings import camera

from blender_addon.cameras.camera import Camera
from blender_addon.cameras.objects import build_camera, look_through
from blender_addon.engine.settings import ENGINE
from blender_addon.nodes.modifier import get_input, set_input, splat_modifier


def middle_of(scene, picture):
    """Has Blender render the middle of a picture alone, half as wide and as high; what the picture has there."""
    (height, width), render = picture.shape[:2], scene.render
    top, left = height // 4, width // 4
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = ((n + 0.25) / width for n in (left, width - left))  # of a pixel
    render.border_min_y, render.border_max_y = ((n + 0.25) / height for n in (top, height - top))
    return picture[top : height - top, left : width - left]


def compare(scene, name, engine, folder, middle=False, **options):
    """PSNR of a model under the settings that the add-on offers, of the whole picture or of its middle."""
    if not (REFERENCES / f"{name}.npz").exists():
        pytest.skip(f"no reference {name}: see tests/project/test_blender.py")
    place_camera(scene, name)
    load(REFERENCES / f"{name}.ply", **options)
    bpy.ops.dogsplat.exact_settings()
    expected = reference(name)["color"]
    expected = middle_of(scene, expected) if middle else expected
    assert expected.std() > 0.05  # there is something to see
    value = psnr(rendered(scene, engine, folder), expected)
    print(f"{bpy.app.version_string} {engine} {name} {options or ''}: {value:.2f} dB")
    return value


@pytest.mark.parametrize("name", ["plain", "dog", "playbot", "fox", "fox_dog"])
def test_cycles_is_the_splatting_picture_negative_lobes_included(scene, name, tmp_path):
    """Emission and transparency may be negative in Cycles, so DoG is no exception."""
    assert compare(scene, name, "CYCLES", tmp_path) > 50


@pytest.mark.parametrize("name, middle", [("plain", False), ("playbot", False), ("fox", True)])
def test_eevee_is_the_splatting_picture_without_negative_lobes(scene, name, middle, tmp_path):
    """Of the fox the middle: a processor takes half a minute for all of its quads, which are large."""
    assert compare(scene, name, EEVEE, tmp_path, middle) > 40


def test_eevee_leaves_negative_lobes_out(scene, tmp_path):
    """What EEVEE shows of a DoG model is brighter where lobes subtract, and nowhere far off."""
    value = compare(scene, "dog", EEVEE, tmp_path)
    assert 15 < value < 45


def test_switching_dog_off_shows_the_plain_gaussians(scene, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply", use_dog=False)
    bpy.ops.dogsplat.exact_settings()
    picture = rendered(scene, "CYCLES", tmp_path)
    assert psnr(picture, reference("plain")["color"]) > 50
    assert psnr(picture, reference("dog")["color"]) < 40


@pytest.mark.parametrize(
    "move", [Matrix.Rotation(1.1, 4, (1, 2, 3)), Matrix.Scale(0.3, 4), Matrix.Translation((5, 6, 7))]
)
def test_the_picture_stays_when_model_and_camera_move_together(scene, tmp_path, move):
    place_camera(scene, "dog")
    obj = load(REFERENCES / "dog.ply")
    bpy.ops.dogsplat.exact_settings()
    obj.matrix_world = move
    scene.camera.matrix_world = (move @ scene.camera.matrix_world).normalized()
    modifier = splat_modifier(obj)
    set_input(modifier, "Near Clip", get_input(modifier, "Near Clip") * move.to_scale()[0])
    picture = rendered(scene, "CYCLES", tmp_path)
    assert psnr(picture, reference("dog")["color"]) > 50


@pytest.mark.parametrize("name, show_as, factor, least", [
    ("dog", "QUADS", 1.6, 50), ("dog", "QUADS", -1.0, 50),
    ("plain", "ELLIPSOIDS", 1.6, 26), ("plain", "ELLIPSOIDS", -1.0, 26),
])  # fmt: skip
def test_a_model_stretched_or_mirrored_across_the_view_is_what_another_lens_saw(
    scene, tmp_path, name, show_as, factor, least
):
    """x times 1.6 before a lens that is as much shorter; a mirror image before a camera whose picture is turned."""
    values = json.loads((REFERENCES / f"{name}.json").read_text())
    w2c, fx, cx = np.array(values.pop("w2c")), values.pop("fx"), values.pop("cx")
    cx = cx if factor > 0 else values["width"] - cx
    camera = Camera("other", w2c, fx=fx / abs(factor), cx=cx, **values)
    look_through(scene, build_camera(scene.collection, camera, Matrix.Identity(4), "", False))
    obj = load(REFERENCES / f"{name}.ply", show_as=show_as)
    bpy.ops.dogsplat.exact_settings()
    obj.matrix_basis, obj.parent = Matrix(w2c.tolist()), bpy.data.objects.new("stretch", None)  # together a shear
    scene.collection.objects.link(obj.parent)
    obj.parent.matrix_world = obj.matrix_basis.inverted() @ Matrix.Diagonal((factor, 1, 1, 1))
    bpy.context.view_layer.update()
    picture = rendered(scene, "CYCLES", tmp_path)
    picture = picture if factor > 0 else picture[:, ::-1]
    assert psnr(picture, reference(name)["color"]) > least


def test_ellipsoids_are_near_the_splatting_picture_of_few_overlaps(scene, tmp_path):
    """They are sorted where rays enter them, not by centre, and seen in perspective: near, not equal. A ray meets each
    twice, which counts once."""
    assert compare(scene, "plain", "CYCLES", tmp_path, show_as="ELLIPSOIDS") > 26


def test_points_are_rendered(scene, tmp_path):
    place_camera(scene, "plain")
    load(REFERENCES / "plain.ply", show_as="POINTS")
    assert rendered(scene, "CYCLES", tmp_path).std() > 0.05


def test_linear_colors_look_as_trained_under_the_view_transform_standard(scene, tmp_path):
    """The colours are the same, only the blending is another, so the pictures are near each other."""
    place_camera(scene, "plain")
    load(REFERENCES / "plain.ply", color_mode="LINEAR")
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.cycles.transparent_max_bounces = scene.cycles.min_transparent_bounces = 1024
    scene.view_settings.view_transform = "Standard"
    linear = rendered(scene, "CYCLES", tmp_path)
    assert psnr(as_srgb(linear), reference("plain")["color"]) > 15


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_a_flat_model_is_seen_from_the_front(scene, by_command, tmp_path, kind):
    """All of its splats are at one depth: none is passed over, and the first is in front."""
    camera(scene, (0, 0, 6)).data.type = kind
    obj = load(REFERENCES / "dog.ply")
    places = np.array([vertex.co for vertex in obj.data.vertices], np.float32) * (1, 1, 0)
    obj.data.vertices.foreach_set("co", places.ravel())
    obj.data.update()
    bpy.ops.dogsplat.exact_settings()
    scene.dogsplat_colors = "DISPLAY"
    ours = rendered(scene, ENGINE, tmp_path)
    assert ours.std() > 0.1 and psnr(rendered(scene, "CYCLES", tmp_path), ours) > 60
