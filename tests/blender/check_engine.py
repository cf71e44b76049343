"""The render engine: the picture of ``dogsplat render`` as a final frame, and what it refuses."""

import bpy
import numpy as np
import pytest
from blender_pictures import as_srgb, psnr, rendered
from model_files import load
from references import REFERENCES, place_camera, reference

from blender_addon import render_engine as engine
from blender_addon.nodes.modifier import set_input, splat_modifier


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
    assert psnr(as_srgb(linear), reference()["color"]) > 70


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


def test_what_is_done_so_far_is_shown_and_then_the_picture(scene, monkeypatch, tmp_path):
    """Blender takes one result after the other, and keeps the last."""
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    picture, shown = reference("square"), []

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
