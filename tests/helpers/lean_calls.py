"""Renders of a small model as calls that are counted: kernels, and operations of each stage."""

import sys
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from launches import kernels
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.frozen import Frozen
from mi_dogsplat.engine.geometry import Blocks, Grid
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.scene.splats import Splats
from splat_scenes import (
    attached,
    random_splats,
    rounded,
    square_camera,
)

N, WIDTH, HEIGHT = 200, 64, 48
CAMERA = square_camera(WIDTH, HEIGHT)


def forget_recordings() -> None:
    """As in a new process: the calls before decide what a frozen function launches, and which equal expressions beside
    it Dr.Jit takes for one."""
    for name in [name for name in sys.modules if name.startswith("mi_dogsplat.")]:
        for value in list(vars(sys.modules[name]).values()):
            if isinstance(value, Frozen):
                value.clear()


def model(degree=0, dog_share=0.0, seed=0) -> Splats:
    return rounded(random_splats(N, seed=seed, degree=degree, dog_share=dog_share))


def stages(run: Callable[[], Any]) -> dict[str, int]:
    """Operations of the kernels with a lane per primitive, per block of pixels, and per pixel."""
    blocks = Blocks.of_backend()
    lanes = Grid(WIDTH, HEIGHT, blocks).n_tiles * blocks.lanes_per_tile
    sizes = {N: "primitives", lanes: "compositor", WIDTH * HEIGHT: "image"}
    assert len(sizes) == 3
    sums = dict.fromkeys(sizes.values(), 0)
    for size, operations in kernels(run):
        if size in sizes:
            sums[sizes[size]] += operations
    return sums


def forward(splats: Splats, **options) -> Callable[[], Any]:
    params, camera = upload(splats), DeviceCamera.upload(CAMERA)
    chosen = RasterOptions(**{"sh_degree": splats.sh_degree, **options})

    def run():
        frame = rasterize(params, camera, chosen)
        dr.eval(frame.colors, frame.T, frame.depth)
        return [*frame.colors, frame.T]

    return run


def adjoints() -> list:
    δ = [mi.Float(np.random.default_rng(c).normal(size=WIDTH * HEIGHT)) for c in range(3)]
    dr.make_opaque(δ)
    return δ


def backward(splats: Splats, δT=None, **options) -> Callable[[], Any]:
    camera, δ = DeviceCamera.upload(CAMERA), adjoints()
    chosen = RasterOptions(**{"sh_degree": splats.sh_degree, **options})

    def run():
        params = attached(splats)
        frame = rasterize(params, camera, chosen)
        outputs, adjoint = (frame.colors, δ) if δT is None else ([*frame.colors, frame.T], [*δ, δT])
        for output, value in zip(outputs, adjoint, strict=True):
            dr.set_grad(output, value)
        dr.enqueue(dr.ADMode.Backward, outputs)
        dr.traverse(dr.ADMode.Backward)
        gradients = [dr.grad(value) for value in params.values() if dr.grad_enabled(value)]
        dr.eval(gradients)
        return gradients

    return run
