"""The render engine: the picture of ``dogsplat render``, in this process and through the command."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import bpy
import numpy as np
import pytest
from check_render import place_camera, psnr, rendered
from conftest import REFERENCES, load
from mathutils import Matrix
from surroundings import plane

from blender_addon.cameras.objects import camera_numbers
from blender_addon.engine import render_engine as engine
from blender_addon.engine import renderers
from blender_addon.engine.cryptomatte import float_of, murmur3
from blender_addon.engine.order import make_order
from blender_addon.engine.passes import OBJECT_INDEX, SETTINGS
from blender_addon.engine.renderers import Command, InProcess, choose_renderer, close_renderers
from blender_addon.engine.served import Cancelled, RendererError
from blender_addon.files.light import Light, made_linear
from blender_addon.files.ply import read_comments, read_ply
from blender_addon.files.sh import C0
from blender_addon.nodes.modifier import set_input, splat_modifier

COMMAND = tuple(json.loads(os.environ["DOGSPLAT_COMMAND"]))


def never():
    return False


def nothing(_):
    pass


@pytest.fixture(scope="module")
def command():
    """The process that all tests of this file share, as the frames of a film do."""
    renderer = Command(COMMAND)
    yield renderer
    renderer.close()


@pytest.fixture
def by_command(monkeypatch, command):
    monkeypatch.setattr(engine, "choose_renderer", lambda words: command)
    return command


@pytest.fixture
def request_of_dog(scene):
    """What the engine asks for to draw the reference."""
    place_camera(scene, "dog")
    camera = camera_numbers(scene, scene.camera)
    numbers = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    return {"model": str(REFERENCES / "dog.ply"), "camera": {"w2c": camera.w2c.tolist(), **numbers}}


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


def test_a_linear_model_keeps_its_radiance_and_its_white(scene, by_command, tmp_path):
    """Linear is radiance, also above 1 and over a world; Display is what the command shows: over white, as sRGB."""
    place_camera(scene, "dog")
    load(REFERENCES / "linear.ply")
    truth = np.maximum(reference("linear")["radiance"], 0)
    assert truth.max() > 2
    scene.view_settings.view_transform = "Raw"
    assert psnr(rendered(scene, engine.ENGINE, tmp_path, most=99) / 3, truth / 3) > 70
    scene.dogsplat_colors = "DISPLAY"
    over_white = (truth / 2.5).clip(0, 1)
    shown = np.where(over_white <= 0.0031308, 12.92 * over_white, 1.055 * over_white ** (1 / 2.4) - 0.055)
    assert psnr(rendered(scene, engine.ENGINE, tmp_path), shown) > 70


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


def passes_of(scene, folder):
    """({channel: [H, W]}, header) of an OpenEXR file of Blender's with all passes, read by the other Python."""
    scene.render.engine = engine.ENGINE
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.filepath = str(folder / "passes.exr")
    bpy.ops.render.render(write_still=True)
    script = (
        "import json, sys, numpy as np, OpenEXR\n"
        "parts = OpenEXR.File(sys.argv[1], separate_channels=True).parts\n"
        "header = {k: v for p in parts for k, v in p.header.items() if isinstance(v, str)}\n"
        "np.savez(sys.argv[2], header=json.dumps(header), "
        "**{name: c.pixels for p in parts for name, c in p.channels.items()})"
    )
    subprocess.run([COMMAND[0], "-c", script, str(folder / "passes.exr"), str(folder / "passes.npz")], check=True)
    seen = {name.split(".", 1)[-1]: values for name, values in np.load(folder / "passes.npz").items()}
    return seen, json.loads(str(seen.pop("header")))


def test_passes_of_splats_alone(scene, by_command, tmp_path):
    """Depth and alpha are those of the integrator."""
    place_camera(scene, "square")  # Blender 5.0 writes no such file of pixels that are not square
    load(REFERENCES / "square.ply")
    scene.view_layers[0].use_pass_z = True
    scene.render.film_transparent = True
    seen, _ = passes_of(scene, tmp_path)
    alpha = reference("square")["alpha"]
    assert np.allclose(seen["Combined.A"], alpha, atol=1e-5)
    assert np.allclose(seen["Alpha.A"], alpha, atol=1e-5)
    hit = alpha > 0.1
    assert hit.any() and np.allclose(seen["Depth.Z"][hit], reference("square")["depth"][hit], rtol=1e-3)
    assert not any(name.startswith(("Normal", OBJECT_INDEX, "Crypto")) for name in seen)


def test_passes_of_a_scene(scene, by_command, tmp_path):
    """Splats in front of a wall that fills the picture."""
    place_camera(scene, "square")
    splats = load(REFERENCES / "square.ply")
    wall = plane(200)
    wall.matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -20))
    splats.pass_index, wall.pass_index = 3, 5
    layer = scene.view_layers[0]
    for name in SETTINGS.values():
        setattr(layer, name, True)
    scene.dogsplat.samples = 1
    seen, header = passes_of(scene, tmp_path)
    assert set(np.unique(seen[f"{OBJECT_INDEX}.X"])) == {3, 5}
    alone = seen[f"{OBJECT_INDEX}.X"] == 5
    far = alone & (reference("square")["alpha"] == 0)
    assert np.allclose(seen["Depth.Z"][far], 20, rtol=1e-4)
    normal = np.stack([seen[f"Normal.{axis}"] for axis in "XYZ"], -1)[far]
    assert np.allclose(normal, scene.camera.matrix_world.col[2][:3], atol=1e-3)
    ids = {name: float_of(name) for name in (splats.name, wall.name)}
    first, coverage = seen["CryptoObject00.R"], seen["CryptoObject00.G"]
    assert {float(number) for number in np.unique(first)} == set(ids.values())
    assert np.allclose(coverage + seen["CryptoObject00.A"], 1, atol=1e-3)
    assert (first[far] == np.float32(ids[wall.name])).all() and np.allclose(coverage[far], 1, atol=0.01)
    (key,) = [name for name in header if name.endswith("/manifest")]
    written = {name: np.uint32(int(bits, 16)).view(np.float32) for name, bits in json.loads(header[key]).items()}
    assert written == ids and header[key.replace("manifest", "name")] == f"{layer.name}.CryptoObject"


def test_what_is_done_so_far_is_shown_and_then_the_picture(scene, monkeypatch, tmp_path):
    """Blender takes one result after the other, and keeps the last."""
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    picture, shown = dict(reference("square")), []

    class Gradual:
        name, folder = "gradual", tmp_path

        def render(self, request, cancelled, progress, preview):
            for factor in (0.0, 0.5):
                preview({**picture, "color": factor * picture["color"]})
                shown.append(factor)
            return picture

    monkeypatch.setattr(engine, "choose_renderer", lambda words: Gradual())
    scene.view_settings.view_transform, scene.dogsplat_colors = "Raw", "DISPLAY"
    assert np.abs(rendered(scene, engine.ENGINE, tmp_path) - picture["color"]).max() < 1e-5 and len(shown) == 2


@pytest.mark.parametrize("text, expected", [("", 0), ("hello", 0x248BFA47), ("hello, world", 0x149BBB7F)])
def test_murmur3_is_that_of_its_author(text, expected):
    """Values of the reference implementation, seed 0."""
    assert murmur3(text.encode()) == expected


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


@pytest.fixture(params=["command", "process"])
def renderer(request, command):
    """Both of them."""
    if request.param == "command":
        return command
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    return InProcess()


def test_both_renderers_make_the_picture_and_tell_how_far_they_are(request_of_dog, renderer):
    progress = []
    picture = renderer.render(request_of_dog, never, progress.append, nothing)
    assert np.abs(picture["color"] - reference()["color"]).max() < 1e-3
    assert np.abs(picture["alpha"] - reference()["alpha"]).max() < 1e-3
    assert progress == sorted(progress) and progress[-1] == 1


def test_bands_are_parts_of_one_picture(request_of_dog, monkeypatch):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    import mi_dogsplat  # noqa: F401  (before what needs its LLVM)
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    from mi_dogsplat.requests import answer

    monkeypatch.setattr(answer, "BAND_PIXELS", 16 * 96)
    progress = []
    picture = InProcess().render(request_of_dog, never, progress.append, nothing)
    assert np.abs(picture["color"] - reference()["color"]).max() < 1e-3 and len(progress) == 4


def test_one_process_serves_all_frames_until_it_is_cancelled(request_of_dog, command):
    command.render(request_of_dog, never, nothing, nothing)
    first = command.process_id
    command.render(request_of_dog, never, nothing, nothing)
    assert command.process_id == first
    with pytest.raises(Cancelled):
        command.render(request_of_dog, lambda: True, nothing, nothing)
    assert command.process_id is None
    command.render(request_of_dog, never, nothing, nothing)
    assert command.process_id not in (None, first)


def test_what_the_package_refuses_does_not_end_its_process(request_of_dog, command):
    with pytest.raises(RendererError, match="none.ply: cannot be read") as caught:
        command.render({**request_of_dog, "model": "none.ply"}, never, nothing, nothing)
    assert "\n" not in str(caught.value)
    command.render(request_of_dog, never, nothing, nothing)


def test_cancelling_stops_a_process_that_does_not_answer(request_of_dog):
    sleeper = Command((sys.executable, "-c", "import time; time.sleep(600)"))
    with pytest.raises(Cancelled):
        sleeper.render(request_of_dog, lambda: True, nothing, nothing)
    sleeper.close()


def test_cancelling_stops_in_this_process(request_of_dog):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    with pytest.raises(Cancelled):
        InProcess().render(request_of_dog, lambda: True, nothing, nothing)


@pytest.mark.parametrize("script, message", [
    ("import sys; sys.exit('dogsplat: model.ply: broken; mend it')", "model.ply: broken; mend it"),
    ("print('hello', flush=True); import sys; sys.stdin.read()", "update the package"),
])  # fmt: skip
def test_what_the_command_complains_about_is_shown_in_one_line(request_of_dog, script, message):
    failing = Command((sys.executable, "-c", script))
    with pytest.raises(RendererError, match=message) as caught:
        failing.render(request_of_dog, never, nothing, nothing)
    assert "\n" not in str(caught.value)
    failing.close()


def test_without_mitsuba_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RendererError, match="pip install.*preferences"):
        choose_renderer()
    with pytest.raises(RendererError, match='"/no/such".*correct or clear'):
        choose_renderer("/no/such")


def test_a_renderer_stays_for_the_next_frame():
    first = choose_renderer(sys.executable)
    assert choose_renderer(sys.executable) is first and first.folder.is_dir()
    close_renderers()
    assert not first.folder.exists()
    assert choose_renderer(sys.executable) is not first
    close_renderers()


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
