"""Both eyes of Stereo 3D have quads of their own, as our engine has a picture for each."""

import json

import bpy
import numpy as np
import pytest
from blender_pictures import EEVEE, choose_engine, psnr
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera

from blender_addon import render_engine
from blender_addon.engine.settings import ENGINE
from blender_addon.nodes.modifier import set_input, splat_modifier
from blender_addon.package.served import Cancelled


def eyes(scene, engine, folder) -> list[np.ndarray]:
    """Pictures [H, W, 3] of the left and the right eye, of 16 bits."""
    choose_engine(scene, engine)
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth, settings.color_mode = "PNG", "16", "RGB"
    settings.views_format, scene.render.dither_intensity = "INDIVIDUAL", 0.0
    scene.render.filepath = str(folder / f"{engine}.png")
    bpy.ops.render.render(write_still=True)
    found = []
    for name in "LR":
        image = bpy.data.images.load(str(folder / f"{engine}_{name}.png"))
        image.colorspace_settings.name = "Non-Color"
        pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
        image.pixels.foreach_get(pixels)
        found.append(pixels.reshape(image.size[1], image.size[0], 4)[::-1, :, :3])
    return found


def stereo(scene, name, distance=0.3):
    """The camera of a reference with two eyes."""
    place_camera(scene, name)
    load(REFERENCES / f"{name}.ply")
    bpy.ops.dogsplat.exact_settings()
    scene.dogsplat_colors, scene.render.use_multiview, scene.render.film_transparent = "DISPLAY", True, False
    eye = scene.camera.data.stereo
    eye.interocular_distance, eye.convergence_distance = distance, 3.0
    return eye


EYES = [("OFFAXIS", "CENTER", False), ("OFFAXIS", "LEFT", True), ("PARALLEL", "RIGHT", False), ("TOE", "CENTER", True),
        ("TOE", "RIGHT", False)]  # fmt: skip
IN_EEVEE = [EYES[1], EYES[4]]  # which is slow, and has the same quads


@pytest.mark.parametrize("engine, name, least, mode, pivot, mirrored", [
    *(("CYCLES", "dog", 80, *eyes) for eyes in EYES), *((EEVEE, "plain", 55, *eyes) for eyes in IN_EEVEE),
])  # fmt: skip
def test_each_eye_sees_its_own_quads(scene, by_command, tmp_path, engine, name, least, mode, pivot, mirrored):
    """As near to our engine as the picture of one camera is."""
    eye = stereo(scene, name)
    eye.convergence_mode, eye.pivot = mode, pivot
    if mirrored:
        scene.camera.matrix_world @= Matrix.Diagonal((-1, 1, 1, 1))
    expected, found = eyes(scene, ENGINE, tmp_path), eyes(scene, engine, tmp_path)
    assert psnr(*expected) < 25 and min(map(psnr, expected, found)) > least


def test_each_eye_has_quads_of_its_own_along_parallel_rays(scene, by_command, tmp_path):
    stereo(scene, "parallel")
    data, values = scene.camera.data, json.loads((REFERENCES / "parallel.json").read_text())
    data.type, data.ortho_scale = "ORTHO", values["width"] / values["fx"]
    expected, found = eyes(scene, ENGINE, tmp_path), eyes(scene, "CYCLES", tmp_path)
    assert psnr(*expected) < 25 and min(map(psnr, expected, found)) > 80


@pytest.mark.parametrize("kind, distance, drawn", [("STEREO_3D", 0.1, 2), ("STEREO_3D", 0.0, 1), ("MULTIVIEW", 0.1, 1)])
def test_only_renders_of_two_eyes_have_quads_for_two(scene, monkeypatch, kind, distance, drawn):
    """Which take twice the memory; viewports have none of them."""
    stereo(scene, "dog", distance)
    scene.render.views_format, scene.render.engine, obj = kind, ENGINE, bpy.context.object
    set_input(splat_modifier(obj), "Show As", "Quads")
    obj.update_tag()
    counts = []

    def count(depsgraph, *_):
        counts.append(len(obj.evaluated_get(depsgraph).to_mesh().vertices) // 4)
        raise Cancelled

    monkeypatch.setattr(render_engine, "make_order", count)
    bpy.ops.render.render()
    with pytest.raises(Cancelled):
        count(bpy.context.evaluated_depsgraph_get())
    in_render, in_viewport = counts
    assert in_render == drawn * in_viewport and in_viewport > 100
