"""What the checks of rig, views and training share: a small scene with a subject, and what has to be as it was."""

from pathlib import Path

import bpy
import pytest
from package_command import COMMAND
from surroundings import background, body, light, material, plane, sphere

from blender_addon.training import train_operator

CENTER, RADIUS = (1.0, 2.0, 0.5), 0.8
RED, GREEN = (0.7, 0.15, 0.1, 1), (0.1, 0.5, 0.2, 1)


@pytest.fixture
def subject(scene, monkeypatch, tmp_path):
    """A red ball, selected, with a green one that touches it, in front of a wall; few and tiny pictures."""
    monkeypatch.setattr(train_operator, "process_words", lambda command: list(COMMAND))
    wall = body(plane(40, location=(1, 9, 0), rotation=(1.57, 0, 0)), material("ShaderNodeBsdfDiffuse"))
    wall.name = "Wall"
    ball = body(sphere(RADIUS, location=CENTER), material("ShaderNodeBsdfDiffuse", Color=RED))
    small = body(sphere(0.3, location=(1.0, 1.3, 1.2)), material("ShaderNodeBsdfDiffuse", Color=GREEN))
    ball.name, small.name = "Ball", "Small"
    bpy.ops.object.select_all(action="DESELECT")
    ball.select_set(True)
    background(scene, (0.9, 0.9, 0.9, 1))
    light(scene, "SUN", rotation=(0.6, 0.4, 0), energy=2)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.cycles.transparent_max_bounces = scene.cycles.min_transparent_bounces = 256
    settings = scene.dogsplat_training
    settings.views, settings.size, settings.steps, settings.elevations = 12, (40, 40), 200, (-60, 90)
    settings.folder, settings.max_primitives, settings.preset = str(tmp_path / "training"), 3000, "3dgs"
    return ball


def folder_of(scene):
    return Path(scene.dogsplat_training.folder) / "data"


def state(scene, *further):
    """Every setting that has to be as before, those of ``further`` owners too."""

    def values(owner):
        read = {p.identifier: getattr(owner, p.identifier) for p in owner.bl_rna.properties if p.type != "POINTER"}
        return {name: tuple(v) if hasattr(v, "__len__") and not isinstance(v, str) else v for name, v in read.items()}

    owners = scene.render, scene.render.image_settings, scene.view_settings, scene.display_settings, *further
    seen = {obj.name: (obj.hide_render, obj.hide_viewport, obj.visible_camera, obj.hide_get()) for obj in scene.objects}
    view = bpy.context.preferences.view.render_display_type
    markers = [marker.camera for marker in scene.timeline_markers]
    return [*map(values, owners), seen, scene.camera, view, scene.frame_current, markers]


def made_unlike(scene):
    """Settings that differ from all that views are rendered with."""
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 320, 200, 70
    render.pixel_aspect_x, render.use_border, render.use_motion_blur, render.filepath = 2.0, True, True, "//mine"
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Punchy"
    scene.view_settings.exposure = 1.0
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
