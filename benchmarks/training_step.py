"""A whole training step (SH 3, L1 + SSIM, backward, Adam) against its rasterisation alone, and a step of four views."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.training.learning_rates import LearningRates
from mi_dogsplat.training.loss import PhotometricLoss
from mi_dogsplat.training.optimizer import SplatOptimizer

from .models import fern_points
from .timing import medians

BATCH = 4


def main() -> None:
    for copies in (1, 4):
        measure(copies)


def measure(copies: int) -> None:
    splats, camera = fern_points(copies)
    rates = LearningRates(extent=1e-6, total_steps=1000)
    optimizer, of_batch = (SplatOptimizer(splats, replace(rates, batch_views=k)) for k in (1, BATCH))
    device_camera, options, loss = DeviceCamera.upload(camera), RasterOptions(), PhotometricLoss()
    rng = np.random.default_rng(0)
    target = loss.target(rng.uniform(0, 1, (camera.height, camera.width, 3)).astype(np.float32))
    adjoint = [mi.Float(rng.normal(size=camera.width * camera.height).astype(np.float32)) for _ in range(3)]

    def forward():
        dr.eval(rasterize({k: dr.detach(v) for k, v in optimizer.params.items()}, device_camera, options).colors)

    def backward(planes, gradient):
        for plane, δ in zip(planes, gradient, strict=True):
            dr.set_grad(plane, mi.Float(δ))
        dr.enqueue(dr.ADMode.Backward, planes)
        dr.traverse(dr.ADMode.Backward)

    def rasterisation():
        params = optimizer.params
        backward(rasterize(params, device_camera, options).colors, adjoint)
        dr.eval([dr.grad(value) for value in params.values()])
        for value in params.values():
            dr.clear_grad(value)

    def learn(trained: SplatOptimizer) -> None:
        planes = rasterize(trained.params, device_camera, options).colors
        backward(planes, loss.value_and_gradient(planes, target)[3])

    def step():
        learn(optimizer)
        optimizer.step()

    def batch():
        for seen in range(BATCH):
            if seen:
                dr.eval([dr.grad(value) for value in of_batch.adam.values()])
            learn(of_batch)
        of_batch.step()

    contestants = {"forward": forward, "rasterisation": rasterisation, "step": step, "batch": batch}
    result = medians(contestants, 10)
    ratio = result["step"] / result["rasterisation"]
    print(
        f"{splats.n_splats:7,d} primitives, 400x300: forward {result['forward']:.2f} ms, "
        f"forward+backward {result['rasterisation']:.2f} ms, whole step {result['step']:.2f} ms = {ratio:.2f}x, "
        f"with {BATCH} views {result['batch'] / BATCH / result['step']:.2f} of it per view"
    )
