"""Linear models in the render engine and its viewports: their radiance, alone and among other models."""

from dataclasses import replace

import bpy
import numpy as np
from blender_pictures import as_srgb, picture, psnr, rendered
from model_files import load
from references import REFERENCES, place_camera, reference
from surroundings import plane

from blender_addon import render_engine as engine
from blender_addon.engine.order import make_order
from blender_addon.files.light import Light, made_linear
from blender_addon.files.ply import read_comments, read_ply
from blender_addon.files.sh import C0


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
