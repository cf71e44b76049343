"""What a choice costs, counted in the kernels themselves: the operations that Dr.Jit emits with it and without it.

An operation is an instruction of Dr.Jit's intermediate representation, before LLVM or ptxas see it. Counts take a
fraction of a second per kernel that is not in Dr.Jit's cache on disk yet.
"""

# Dr.Jit's stubs give detached types as "object": argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.cameras import Camera
from ..scene.splats import Splats
from .composite import composite
from .composite_aovs import composite_aovs
from .composite_derivatives import ENTRY_ROW, PSEUDO_ENTRY_ROW, composite_backward, lanes_add_in_turn
from .geometry import Blocks, Grid
from .parameters import upload
from .project import DeviceCamera, project
from .rasterize import RasterOptions
from .tables import pack
from .tiles import tiles
from .walk import Settings

N = 32  # primitives of the model that is traced; any number gives the same kernels
SIZE = 16  # pixels per side of its image


@lru_cache
def pair_operations(settings: Settings, dog: bool, variant: str) -> tuple[float, float]:
    """Operations of the compositor per primitive and pixel that it meets, as (forward, derivative) passes.

    The difference of kernels that take two primitives per iteration and one: what is done once per pixel drops out.
    ``dog``: of a DoG primitive, with what the branch to its second kernel costs. ``variant``: the active one.
    """
    one, two = (_compositor_operations(settings, dog, unroll) for unroll in (1, 2))
    pixels = SIZE * SIZE
    return (two[0] - one[0]) / pixels, (two[1] - one[1]) / pixels


@lru_cache
def aov_operations(names: tuple[str, ...], dog: bool, variant: str) -> float:
    """Operations of the walk that ``names``, AOVs of ``composite_aovs.WALKED``, take; per primitive and pixel."""

    def walk(unroll: int) -> int:
        stages = _stages(Settings(3), dog, unroll)
        depths = dr.opaque(dr.detached_t(mi.Float), 1, N) if "median_depth" in names else None
        return operations(lambda: dr.eval(composite_aovs(*stages, depths, names)))

    return (walk(2) - walk(1)) / (SIZE * SIZE)


@lru_cache
def primitive_operations(options: RasterOptions, dog: bool, variant: str) -> float:
    """Operations of the projection per primitive; with ``dog``, per DoG primitive. ``variant``: the active one."""
    splats, camera = _model(options.sh_degree, dog)
    params = upload(splats)

    def run() -> None:
        projection = project(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
        dr.eval(pack(projection, projection.colors), projection.visible)

    return operations(run) / N


def operations(run: Callable[[], Any]) -> int:
    """Operations of all kernels that ``run`` launches, each times its number of lanes."""
    dr.sync_thread()
    # a frozen function hides its kernels while it is recorded
    with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False), dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        run()
        dr.sync_thread()
        return sum(kernel["operation_count"] * kernel["size"] for kernel in dr.kernel_history([dr.KernelType.JIT]))


def _compositor_operations(settings: Settings, dog: bool, unroll: int) -> tuple[int, int]:
    """(forward, derivative), of all lanes of an image."""
    stages = _stages(settings, dog, unroll)
    result: list = []
    forward = operations(lambda: dr.eval(result.append(composite(*stages)), result))
    planes, T = result[0]

    Float: Any = dr.detached_t(mi.Float)
    n_entries = dr.width(stages[3].entry_from_isect)
    entries = dr.zeros(Float, n_entries * ENTRY_ROW)
    pseudo_entries = dr.zeros(Float, n_entries * PSEUDO_ENTRY_ROW) if dog else None
    δplanes, δT = [dr.opaque(Float, 1, dr.width(T)) for _ in planes], dr.zeros(Float, dr.width(T))
    tables = entries, pseudo_entries, lanes_add_in_turn(mi.variant())
    backward = operations(lambda: dr.eval(composite_backward(*stages, planes, T, δplanes, δT, *tables)))
    return forward, backward


def _stages(settings: Settings, dog: bool, unroll: int) -> tuple:
    """What the compositor takes; which planes it blends matters to no kernel."""
    splats, camera = _model(0, dog)
    grid = Grid(SIZE, SIZE, replace(Blocks.of_backend(), unroll=unroll))
    projection = project(upload(splats), camera, sh_degree=0)
    features = (2 * projection.colors)[: settings.n_features]
    stages = grid, grid.lanes, pack(projection, features), tiles(projection, grid, settings.cutoffs), settings
    dr.eval(stages)
    return stages


def _model(sh_degree: int, dog: bool) -> tuple[Splats, DeviceCamera]:
    """A model in front of a camera; what it shows matters to no kernel."""
    rng = np.random.default_rng(0)
    index = np.arange(N if dog else 0)
    splats = Splats(
        means=rng.uniform([-1, -1, 2], [1, 1, 4], (N, 3)),
        log_scales=np.full((N, 3), -2),
        quats=rng.normal(size=(N, 4)),
        logit_opacities=np.zeros(N),
        sh_coeffs=np.zeros((N, (sh_degree + 1) ** 2, 3)),
        dog_index=index,
        dog_logit_opacities=np.zeros(len(index)),
        dog_log_scales=np.zeros((len(index), 3)),
    )
    return splats, DeviceCamera.upload(Camera(np.eye(4), SIZE, SIZE, SIZE / 2, SIZE / 2, SIZE, SIZE))
