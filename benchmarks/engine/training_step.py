"""A whole training step (SH 3, L1 + SSIM, backward, Adam) against its rasterisation alone (forward and backward)."""

from __future__ import annotations

import time
from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.arrays import backward
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.images.loss import PhotometricLoss
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer

from ..models import fern_points
from ..timing import medians, ratio


def main() -> None:
    for copies in (1, 4):
        measure(copies)


def measure(copies: int) -> None:
    splats, camera = fern_points(copies)
    runs = contestants(splats, camera)
    result = medians(runs, 10)
    r = ratio(runs["step"], runs["rasterisation"], 100, time.process_time)
    print(
        f"{splats.n_splats:7,d} primitives, 400x300: forward {result['forward']:.2f} ms, forward+backward "
        f"{result['rasterisation']:.2f} ms, whole step {result['step']:.2f} ms = "
        f"{result['step'] / result['rasterisation']:.2f}x; time of all processors {r.b_ms:.2f} and "
        f"{r.a_ms:.2f} ms = {r.median:.3f}x ({r.low:.3f} .. {r.high:.3f})"
    )


def contestants(splats: Splats, camera: Camera) -> dict[str, Callable[[], None]]:
    """Parts of a step, and all of it: "forward", "rasterisation" with its derivatives, and "step"."""
    optimizer = SplatOptimizer(splats, LearningRates(extent=1e-6, total_steps=1000))
    device_camera, options, loss = DeviceCamera.upload(camera), RasterOptions(), PhotometricLoss()
    rng = np.random.default_rng(0)
    target = loss.target(rng.uniform(0, 1, (camera.height, camera.width, 3)).astype(np.float32))
    adjoint = [mi.Float(rng.normal(size=camera.width * camera.height).astype(np.float32)) for _ in range(3)]

    def forward():
        dr.eval(rasterize({k: dr.detach(v) for k, v in optimizer.params.items()}, device_camera, options).colors)

    def rasterisation():
        params = optimizer.params
        backward(rasterize(params, device_camera, options).colors, adjoint)
        dr.eval([dr.grad(value) for value in params.values()])
        for value in params.values():
            dr.clear_grad(value)

    def step():
        planes = rasterize(optimizer.params, device_camera, options).colors
        backward(planes, loss.value_and_gradient(planes, target)[3])
        optimizer.step()

    return {"forward": forward, "rasterisation": rasterisation, "step": step}
