"""Linear models in the render engine and its viewports: their radiance, alone and among other models."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from blender_pictures import as_srgb, picture, psnr, rendered
from live_views import last, staged, through_the_camera
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera, reference
from surroundings import background, body, material, plane

from blender_addon import render_engine as engine
from blender_addon.engine.order import make_order
from blender_addon.files.light import Light, made_linear
from blender_addon.files.ply import read_comments, read_ply
from blender_addon.files.sh import C0
from blender_addon.viewport.pace import Level
from blender_addon.viewport.rendered import request_of

HALF = 2**-11  # relative, of a half float: the texture that a viewport draws holds those


def test_a_linear_model_keeps_its_radiance_and_its_white(scene, by_command, tmp_path):
    """Linear is radiance, also above 1 and over a world; Display is what the command shows: over white, as sRGB."""
    place_camera(scene, "dog")
    load(REFERENCES / "linear.ply")
    truth = np.maximum(reference("linear")["radiance"], 0)
    assert truth.max() > 2
    scene.view_settings.view_transform = "Raw"
    assert psnr(picture(scene, engine.ENGINE, tmp_path).clip(0, 99) / 3, truth / 3) > 70
    scene.dogsplat_colors = "DISPLAY"
    assert psnr(rendered(scene, engine.ENGINE, tmp_path), as_srgb((truth / 2.5).clip(0, 1))) > 70


@pytest.mark.parametrize("behind", [(0, 0, 0, 1), (0.5, 3.0, 6.0, 1)])
def test_a_viewport_has_the_radiance_of_a_camera_render(scene, by_command, live, tmp_path, behind):
    """Before the view transform, through the same camera, and after it as *Display*: to a half float, as is shown."""
    place_camera(scene, "dog")
    load(REFERENCES / "linear.ply")
    background(scene, behind)
    seen = through_the_camera(scene)
    for colors, most in (("LINEAR", 2), ("DISPLAY", 0.9)):
        scene.dogsplat_colors = colors
        expected = picture(scene, engine.ENGINE, tmp_path)
        found = last(live, request_of(staged(tmp_path, seen.camera), scene, seen, Level(), rests=True))[..., :3]
        assert expected.max() > most and np.allclose(found, expected, rtol=HALF, atol=1e-5)


def test_a_viewport_has_the_radiance_of_a_camera_render_of_a_whole_scene(scene, by_command, live, tmp_path):
    """One sample for each pixel, by the random numbers of both in frame 0: few paths end up elsewhere by a last bit."""
    place_camera(scene, "square")
    load(REFERENCES / "linear.ply")
    wall = body(plane(200), material("ShaderNodeEmission", Color=(0.5, 3.0, 6.0, 1), Strength=1.0))
    wall.matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -20))
    scene.dogsplat.samples = 1
    scene.frame_set(0)
    expected = picture(scene, engine.ENGINE, tmp_path)
    seen = through_the_camera(scene)
    stage = staged(tmp_path, seen.camera)
    assert stage.whole
    found = last(live, request_of(stage, scene, seen, Level(), rests=True))[..., :3]
    assert expected.max() > 2 and np.isclose(found, expected, rtol=HALF, atol=1e-5).all(-1).mean() > 0.98


def test_a_scene_with_a_linear_model_has_its_radiance_and_that_of_other_models(scene, tmp_path):
    """The file that the renderer gets is linear; sRGB models beside it are converted."""
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    load(REFERENCES / "linear.ply")
    plane(200)
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert order.whole and order.light == Light(True, 2.5)
    assert read_comments(order.request["model"]) == ["dogsplat linear true", "dogsplat white 2.5"]
    sent, srgb, linear = (read_ply(path).sh_coeffs[:, 0] * C0 + 0.5 for path in
                          (order.request["model"], REFERENCES / "dog.ply", REFERENCES / "linear.ply"))  # fmt: skip
    assert np.allclose(sent[150:], linear)
    assert np.allclose(sent[:150], np.where(srgb < 0.04045, srgb / 12.92, ((srgb.clip(0) + 0.055) / 1.055) ** 2.4),
                       atol=1e-6)  # fmt: skip


def test_what_directions_add_to_srgb_values_is_made_linear_by_the_slope():
    model = read_ply(REFERENCES / "dog.ply")
    dc, rest = (made_linear(replace(model, sh_coeffs=model.sh_coeffs + step)).sh_coeffs * C0 for step in
                (np.r_[1e-2, np.zeros(15)][:, None], np.r_[0, np.full(15, 1e-2)][:, None]))  # fmt: skip
    before = made_linear(model).sh_coeffs * C0
    assert np.allclose((rest - before)[:, 1:], (dc - before)[:, :1], rtol=0.05, atol=2e-5)
