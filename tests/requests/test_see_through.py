"""Surfaces that light passes straight through, over a transparent film: nothing shows behind them, as alpha says."""

import json

import numpy as np
import pytest
from mi_dogsplat.scene.ply import write_ply
from scene_requests import answered, camera_json, matrix
from splat_scenes import random_splats, rounded, square_camera

WIDTH, HEIGHT, FOCAL = 24, 16, 22.0
CAMERA = square_camera(WIDTH, HEIGHT, FOCAL)
BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0, 0, 0]}}
PURPLE = {"type": "rgb", "value": [0.9, 0.3, 0.6]}  # of which 0.6 on average
BSDFS = {
    "mask": ({"type": "mask", "opacity": 0.4, "bsdf": BLACK}, [0.6, 0.6, 0.6]),
    "colored": ({"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0, "specular_transmittance": PURPLE},
                [0.9, 0.3, 0.6]),
}  # fmt: skip


def at(depth):
    """A square that fills the picture."""
    placed = np.linalg.inv(CAMERA.w2c)
    placed[:3, 3] += depth * placed[:3, 2]
    return matrix(placed @ np.diag([100, 100, -1, 1]))


def picture(folder, bsdf, wall=False, splats=False, transparent=True):
    """Mean colour [3] and alpha of a sheet under a sky of 0.25, before a wall that shines or before nothing."""
    c2w = np.linalg.inv(CAMERA.w2c) @ np.diag([-1.0, -1, 1, 1])
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    fov = np.degrees(2 * np.arctan(WIDTH / 2 / FOCAL))
    described = {
        "sensor": {"type": "perspective", "fov": fov, "to_world": matrix(c2w), "film": film},
        "sheet": {"type": "rectangle", "to_world": at(0.5), "bsdf": bsdf},
        "sky": {"type": "constant", "radiance": 0.25},
    }
    if wall:
        light = {"type": "area", "radiance": 0.2}
        described["object_0_wall"] = {"type": "rectangle", "to_world": at(50), "bsdf": BLACK, "emitter": light}
    (folder / "scene.json").write_text(json.dumps(described))
    request = {"scene": str(folder / "scene.json"), "samples": 16, "transparent": transparent}
    if splats:
        write_ply(folder / "model.ply", rounded(random_splats(40, seed=1)))
        request |= {"model": str(folder / "model.ply")}
    found = answered(request)
    return found["color"].mean(axis=(0, 1)), found["alpha"].mean()


@pytest.mark.parametrize("name", BSDFS)
def test_nothing_shows_behind_it(tmp_path, name):
    bsdf, passed = BSDFS[name]
    color, alpha = picture(tmp_path, bsdf)
    assert color == pytest.approx([0, 0, 0], abs=1e-6) and alpha == pytest.approx(0.4, abs=0.02)
    color, alpha = picture(tmp_path, bsdf, transparent=False)
    assert color == pytest.approx(0.25 * np.array(passed), abs=0.01) and alpha == 1


@pytest.mark.parametrize("name", BSDFS)
def test_what_stands_behind_it_is_seen_in_its_color(tmp_path, name):
    bsdf, passed = BSDFS[name]
    color, alpha = picture(tmp_path, bsdf, wall=True)
    assert color == pytest.approx(0.2 * np.array(passed), abs=0.01) and alpha == pytest.approx(1)


@pytest.mark.parametrize("name", BSDFS)
def test_splats_behind_it_are_in_alpha(tmp_path, name):
    """As much of it as they cover: before nothing, and no more of the sky shows than without."""
    bsdf, _ = BSDFS[name]
    camera = camera_json(CAMERA)
    color, alpha = picture(tmp_path, bsdf, splats=True)
    uncovered = 1 - answered({"model": str(tmp_path / "model.ply"), "camera": camera})["alpha"].mean()
    assert 0.05 < uncovered < 0.95 and color.max() > 0.01
    assert 1 - alpha == pytest.approx(0.6 * uncovered, abs=0.03)
