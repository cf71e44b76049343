"""Frames of an animated scene: nothing is compiled for the next one, and the picture is that of the scene."""

import json
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from launches import KernelWatch
from mi_dogsplat.support.pictures import write_exr
from scene_requests import answered, matrix

SAMPLES = 4


@pytest.fixture
def sky(tmp_path) -> Path:
    write_exr(tmp_path / "sky.exr", {"color": np.random.default_rng(0).uniform(0.2, 1, (4, 8, 3)).astype(np.float32)})
    return tmp_path / "sky.exr"


def frame(folder: Path, sky: Path, time: float) -> dict:
    """A floor under a lamp that moves, by a lens that focuses elsewhere, below a sky that gets brighter."""
    film = {"type": "hdrfilm", "width": 16, "height": 12, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    lamp = mi.ScalarTransform4f().translate([time, 0, 2]).rotate([1, 0, 0], 180).scale(0.5)
    seen = mi.ScalarTransform4f().look_at([0, -3, 1.5], [0, 0, 0], [0, 0, 1])
    lens = {"aperture_radius": 0.05 + 0.1 * time, "focus_distance": 3 + time, "fov": 45}
    scene = {
        "sensor": {"type": "thinlens", "to_world": matrix(seen.matrix), "film": film, **lens},
        "floor": {"type": "rectangle", "to_world": matrix(np.diag([3.0, 3, 1, 1]))},
        "light_0": {"type": "rectangle", "to_world": matrix(lamp.matrix), "bsdf": {"type": "null"},
                    "emitter": {"type": "area", "radiance": 5.0}},
        "sky": {"type": "envmap", "filename": sky.name, "scale": 0.1 + time},
    }  # fmt: skip
    (folder / "scene.json").write_text(json.dumps(scene))
    return {"scene": str(folder / "scene.json"), "samples": SAMPLES, "max_depth": 3}


def test_another_frame_needs_no_new_kernel(tmp_path, sky):
    with KernelWatch() as kernels:
        for time in (0.1, 0.23, 0.37, 0.52):
            if time > 0.2:
                kernels.forget()
            answered(frame(tmp_path, sky, time))
    assert kernels.launched and kernels.new == []


def test_it_is_the_picture_of_mitsuba_itself(tmp_path, sky, monkeypatch):
    request = frame(tmp_path, sky, 0.3)
    found = answered(request)["color"]
    monkeypatch.setattr("mi_dogsplat.requests.scene_description.make_opaque", lambda scene: None)
    expected = answered(request)["color"]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)
    assert found.std() > 0.05
