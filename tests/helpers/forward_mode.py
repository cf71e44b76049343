"""Forward mode of the engine along directions in parameter space, and differences of the float64 twin along them."""

from types import SimpleNamespace
from typing import cast

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.reference.forward import raw_indices, raw_names
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from read_together import read


def random_directions(splats: Splats, seed: int) -> dict[str, np.ndarray]:
    """For every parameter that the model has entries of."""
    rng, names = np.random.default_rng(seed), [name for name in raw_names(splats) if getattr(splats, name).size]
    return {name: rng.normal(size=getattr(splats, name).shape).astype(np.float32) for name in names}


def pushed(
    splats: Splats, camera: Camera, directions: dict[str, np.ndarray], choices: RasterOptions
) -> dict[str, np.ndarray]:
    """Derivative of the planes, "depth" among them where the options ask for it."""
    params = upload(splats)
    for name, direction in directions.items():
        dr.enable_grad(params[name])
        dr.set_grad(params[name], mi.Float(direction.ravel().astype(np.float32)))
    frame = rasterize(params, DeviceCamera.upload(camera), choices)
    planes = [*frame.colors, frame.T, *([] if frame.depth is None else [frame.depth])]
    dr.forward_to(planes)
    tangents = [plane.reshape(camera.height, camera.width) for plane in read(map(dr.grad, planes))]
    depth = {} if frame.depth is None else {"depth": tangents[4]}
    return {"image": np.stack(tangents[:3], -1), "T": tangents[3], **depth}


def pushed_differences(
    splats: Splats, camera: Camera, directions: dict[str, np.ndarray], eps=1e-5, *, depth=False, **choices
) -> dict[str, np.ndarray]:
    """What `pushed` finds; ``choices`` are those of ``reference.render``."""
    sides = []
    for side in (eps, -eps):
        raw = {name: np.array(getattr(splats, name), np.float64) for name in raw_names(splats)}
        raw |= {name: raw[name] + side * direction for name, direction in directions.items()}
        model = cast("Splats", SimpleNamespace(**raw, **raw_indices(splats)))
        sides.append(reference.render(model, camera, smooth=True, **choices))
    planes = {name: (a - b) / (2 * eps) for name, a, b in zip(("image", "T", "depth"), *sides, strict=True)}
    return planes if depth else {name: planes[name] for name in ("image", "T")}
