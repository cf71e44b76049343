"""Small scenes of splats among surfaces, as ``dogpath`` draws them."""

from typing import Any

import mitsuba as mi
import numpy as np
from mi_dogsplat.scene.cameras import Camera
from splat_scenes import dog_dict, make_splats, rounded, sensor_dict

CAMERA = Camera(np.eye(4), 18.0, 18.0, 6.0, 5.0, 12, 10)  # at the origin, looks along z
ALONE = {"type": "dogpath"}
T4 = mi.ScalarTransform4f


def render(splats: Any, others: dict[str, Any], spp=1, film: dict | None = None, seed=0, camera=CAMERA,
           **integrator) -> np.ndarray:
    scene = mi.load_dict({"type": "scene", "integrator": {"type": "dogpath", **integrator},
                          "sensor": sensor_dict(camera, **(film or {})), "splats": dog_dict(rounded(splats)), **others})
    return np.array(mi.render(scene, spp=spp, seed=seed))  # type: ignore[arg-type]


def rgb(*values: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def square(to_world: Any, **others: Any) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": to_world, **others}


def facing_camera(z: float, **others: Any) -> dict[str, Any]:
    """A wall that fills the view."""
    return square(T4().translate([0, 0, z]).rotate([0, 1, 0], 180).scale(20), **others)


def coarse(image: np.ndarray, factor: int) -> np.ndarray:
    """Means over blocks of pixels."""
    h, w, c = image.shape
    return image.reshape(h // factor, factor, w // factor, factor, c).mean((1, 3))


def camera_rays(camera=CAMERA, within=(0.5, 0.5)) -> np.ndarray:
    """[H, W, 3] directions through pixels."""
    y, x = np.mgrid[0:camera.height, 0:camera.width] + np.reshape(within, (2, 1, 1))
    d = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def opposite(z: float, x=0.0, scale=0.3, opacity=0.8, color=(0.9, 0.5, 0.2), **dog) -> Any:
    """One round splat at (x, 0, z)."""
    return make_splats([[x, 0.0, z]], scale, opacity, [color], **dog)
