"""The render engine: the picture of ``dogsplat render``, in this process and through the command."""

import json
import os
import subprocess
import sys

import bpy
import numpy as np
import pytest
from check_render import place_camera, psnr, rendered
from conftest import REFERENCES, load

from blender_addon.cameras.objects import camera_numbers
from blender_addon.engine import render_engine as engine
from blender_addon.engine import renderers
from blender_addon.engine.renderers import Cancelled, Command, InProcess, RendererError, Settings, choose_renderer
from blender_addon.files.ply import read_ply
from blender_addon.nodes.modifier import set_input, splat_modifier

COMMAND = tuple(json.loads(os.environ["DOGSPLAT_COMMAND"]))
SETTINGS = Settings(0.2, False)


def never():
    return False


@pytest.fixture
def by_command(monkeypatch):
    monkeypatch.setattr(engine, "choose_renderer", lambda command: Command(COMMAND))


@pytest.fixture
def camera(scene):
    place_camera(scene, "dog")
    return camera_numbers(scene, scene.camera)


def reference(name="dog"):
    return np.load(REFERENCES / f"{name}.npz")


def test_the_final_frame_is_the_picture_of_the_command(scene, by_command, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.view_settings.view_transform = "Raw"
    scene.dogsplat_colors = "DISPLAY"
    assert psnr(rendered(scene, engine.ENGINE, tmp_path), reference()["color"]) > 70


def test_linear_colors_are_those_of_the_integrator(scene, by_command, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.view_settings.view_transform = "Standard"
    linear = rendered(scene, engine.ENGINE, tmp_path)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055)
    assert psnr(srgb, reference()["color"]) > 70


def test_passes(scene, by_command, tmp_path):
    """Depth and alpha of the integrator in an OpenEXR file of Blender's, read by the other Python."""
    place_camera(scene, "square")  # Blender 5.0 writes no such file of pixels that are not square
    load(REFERENCES / "square.ply")
    scene.view_layers[0].use_pass_z = True
    scene.render.film_transparent = True
    scene.render.engine = engine.ENGINE
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.filepath = str(tmp_path / "passes.exr")
    bpy.ops.render.render(write_still=True)
    script = (
        "import sys, numpy as np, OpenEXR\n"
        "parts = OpenEXR.File(sys.argv[1], separate_channels=True).parts\n"
        "np.savez(sys.argv[2], **{name: c.pixels for p in parts for name, c in p.channels.items()})"
    )
    subprocess.run([COMMAND[0], "-c", script, str(tmp_path / "passes.exr"), str(tmp_path / "passes.npz")], check=True)
    seen = {name.split(".", 1)[-1]: values for name, values in np.load(tmp_path / "passes.npz").items()}
    alpha = reference("square")["alpha"]
    assert np.allclose(seen["Combined.A"], alpha, atol=1e-5)
    assert np.allclose(seen["Alpha.A"], alpha, atol=1e-5)
    hit = alpha > 0.1
    assert hit.any() and np.allclose(seen["Depth.Z"][hit], reference("square")["depth"][hit], rtol=1e-3)


def test_a_moved_and_hidden_model(scene, by_command, tmp_path):
    """Two models, of which one is hidden; the other is moved together with the camera."""
    place_camera(scene, "dog")
    hidden, shown = load(REFERENCES / "plain.ply"), load(REFERENCES / "dog.ply", up_axis="-Y", scale=2.0)
    hidden.hide_render = True
    matrix = shown.matrix_world.copy()
    scene.camera.matrix_world = (matrix @ scene.camera.matrix_world).normalized()
    set_input(splat_modifier(shown), "Near Clip", 0.4)  # twice as far now
    scene.dogsplat_colors = "DISPLAY"
    assert psnr(rendered(scene, engine.ENGINE, tmp_path), reference()["color"]) > 50


def test_in_this_process(camera):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    progress = []
    picture = InProcess().render(read_ply(REFERENCES / "dog.ply"), camera, SETTINGS, never, progress.append)
    assert np.abs(picture["color"] - reference()["color"]).max() < 1e-3
    assert np.abs(picture["alpha"] - reference()["alpha"]).max() < 1e-3
    assert progress == sorted(progress) and progress[-1] == 1


def test_bands_are_parts_of_one_picture(camera, monkeypatch):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    model = read_ply(REFERENCES / "dog.ply")
    monkeypatch.setattr(renderers, "BAND_ROWS", 16)
    picture = InProcess().render(model, camera, SETTINGS, never, lambda share: None)
    assert np.abs(picture["color"] - reference()["color"]).max() < 1e-3


def test_through_the_command(camera):
    progress = []
    picture = Command(COMMAND).render(read_ply(REFERENCES / "dog.ply"), camera, SETTINGS, never, progress.append)
    assert np.abs(picture["color"] - reference()["color"]).max() < 1e-3
    assert progress == sorted(progress) and 0 < progress[-1] < 1


def test_cancelling_stops_the_command(camera):
    sleeper = Command((sys.executable, "-c", "import time; time.sleep(600)"))
    with pytest.raises(Cancelled):
        sleeper.render(read_ply(REFERENCES / "dog.ply"), camera, SETTINGS, lambda: True, lambda share: None)


def test_cancelling_stops_between_bands(camera):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    with pytest.raises(Cancelled):
        InProcess().render(read_ply(REFERENCES / "dog.ply"), camera, SETTINGS, lambda: True, lambda share: None)


def test_what_the_command_complains_about_is_shown_in_one_line(camera):
    failing = Command((sys.executable, "-c", "import sys; sys.exit('dogsplat: model.ply: broken; mend it')"))
    with pytest.raises(RendererError, match="model.ply: broken; mend it") as caught:
        failing.render(read_ply(REFERENCES / "dog.ply"), camera, SETTINGS, never, lambda share: None)
    assert "\n" not in str(caught.value)


def test_without_mitsuba_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RendererError, match="pip install.*preferences"):
        choose_renderer()
    with pytest.raises(RendererError, match='"/no/such".*correct or clear'):
        choose_renderer("/no/such")


@pytest.mark.parametrize(
    "prepare, message",
    [
        (lambda scene: load(REFERENCES / "dog.ply"), "no camera"),
        (lambda scene: place_camera(scene, "dog"), "no splats"),
    ],
)
def test_what_is_missing_in_the_scene_is_said(scene, by_command, prepare, message):
    prepare(scene)
    scene.render.engine = engine.ENGINE
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.render.render()


def test_an_orthographic_camera_is_refused(scene, by_command):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.camera.data.type = "ORTHO"
    scene.render.engine = engine.ENGINE
    with pytest.raises(RuntimeError, match="perspective"):
        bpy.ops.render.render()
