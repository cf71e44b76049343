"""What is nearer than *Clip Start* of a camera, of which no engine shows anything, and neither do viewports of ours."""

import bpy
import pytest
from blender_pictures import psnr, rendered
from live_views import staged, through_the_camera
from model_files import load
from references import REFERENCES, place_camera, reference

from blender_addon.engine.settings import ENGINE
from blender_addon.viewport.pace import Level
from blender_addon.viewport.rendered import request_of


@pytest.mark.parametrize("name, kind, start", [("dog", "PERSP", 2.0), ("parallel", "ORTHO", 0.1)])
def test_splats_nearer_than_a_camera_sees_show_in_no_engine(scene, by_command, tmp_path, name, kind, start):
    place_camera(scene, name)
    data = scene.camera.data
    data.type, data.ortho_scale, data.clip_start = kind, data.sensor_width / data.lens, start
    load(REFERENCES / f"{name}.ply")
    bpy.ops.dogsplat.exact_settings()
    scene.dogsplat_colors = "DISPLAY"
    cycles, ours = (rendered(scene, engine, tmp_path) for engine in ("CYCLES", ENGINE))
    assert psnr(cycles, reference(name)["color"]) < 40 and psnr(ours, cycles) > 60


@pytest.mark.parametrize("start, near", [(2.0, 2.0), (0.1, 0.2)])
def test_a_viewport_begins_at_the_farther_one_of_clip_start_and_near_clip(scene, tmp_path, start, near):
    place_camera(scene, "dog")
    scene.camera.data.clip_start = start
    load(REFERENCES / "dog.ply")
    seen = through_the_camera(scene)
    request = request_of(staged(tmp_path, seen.camera), scene, seen, Level(), rests=True)
    assert request["near_clip"] == pytest.approx(near)
