"""What a choice costs, counted in the kernels themselves: the operations that Dr.Jit emits with it and without it.

An operation is an instruction of Dr.Jit's intermediate representation, before LLVM or ptxas see it. Counts take a
fraction of a second per kernel that is not in Dr.Jit's cache on disk yet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np

from ..scene.cameras import Camera
from ..scene.row_groups import DOG, RowGroup
from ..scene.splats import Splats
from .arrays import array_types
from .bands import WalkableView
from .curvatures import COLUMNS as CURVATURE_COLUMNS
from .cuts import COLUMNS as CUT_COLUMNS
from .device_camera import DeviceCamera
from .geometry import Blocks, Grid
from .options import RasterOptions, Settings
from .parameters import upload
from .project import project
from .tables import pack
from .view import arrange, settings_of
from .walks.adjoints import composite_backward
from .walks.aovs import composite_aovs
from .walks.composite import composite
from .walks.pixels import Planes

N = 32  # primitives of the model that is traced; any number gives the same kernels
SIZE = 16  # pixels per side of its image


@lru_cache
def pair_operations(settings: Settings, dog: bool, variant: str) -> tuple[float, float]:
    """Operations of the compositor per primitive and pixel that it meets, as (forward, derivative) passes.

    The difference of kernels that take two primitives per iteration and one: what is done once per pixel drops out.
    ``dog``: of a DoG primitive, with what the branch to its second kernel costs. ``settings.slopes``: of one whose
    colour varies over it; ``settings.curvatures``: whose brightness curves; ``settings.cuts``: that so many planes cut
    off. ``variant``: the active one.
    """
    one, two = (_compositor_operations(settings, dog, unroll) for unroll in (1, 2))
    pixels = SIZE * SIZE
    return (two[0] - one[0]) / pixels, (two[1] - one[1]) / pixels


@lru_cache
def aov_operations(names: tuple[str, ...], dog: bool, variant: str) -> float:
    """Operations of the walk that ``names``, AOVs of ``walks.aovs.WALKED``, take; per primitive and pixel."""

    def walk(unroll: int) -> int:
        view = _view(Settings(3), dog, unroll)
        depths = dr.opaque(array_types().Float, 1, N) if "median_depth" in names else None
        return operations(lambda: dr.eval(composite_aovs(view, names, depths)))

    return (walk(2) - walk(1)) / (SIZE * SIZE)


@lru_cache
def primitive_operations(options: RasterOptions, variant: str, *groups: RowGroup) -> float:
    """Operations of the projection per primitive that is in these groups, of DoG, slopes and so on, but of SH.
    ``variant``: the active one."""
    splats, camera = _model(options.sh_degree, groups)
    params = upload(splats)

    def run() -> None:
        projection = project(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
        dr.eval(pack(projection, projection.colors, settings_of(options, 3, projection)), projection.visible)

    return operations(run) / N


def operations(run: Callable[[], Any]) -> int:
    """Operations of all kernels that ``run`` launches, each times its number of lanes."""
    dr.sync_thread()
    # a frozen function hides its kernels while it is recorded
    with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False), dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        run()  # what is tried and kept once in a process is not counted
        dr.sync_thread()
        dr.kernel_history_clear()
        run()
        dr.sync_thread()
        return sum(kernel["operation_count"] * kernel["size"] for kernel in dr.kernel_history([dr.KernelType.JIT]))


def _compositor_operations(settings: Settings, dog: bool, unroll: int) -> tuple[int, int]:
    """(forward, derivative), of all lanes of an image."""
    view = _view(settings, dog, unroll)
    result: list[Planes] = []
    forward = operations(lambda: dr.eval(result.append(composite(view)), result))
    blended, Float = result[0], array_types().Float

    δfeatures = [dr.opaque(Float, 1, dr.width(blended.T)) for _ in blended.features]
    δ = Planes(δfeatures, dr.zeros(Float, dr.width(blended.T)))
    backward = operations(lambda: dr.eval(composite_backward(view, blended, δ)))
    return forward, backward


def _view(settings: Settings, dog: bool, unroll: int) -> WalkableView:
    """What the compositor takes; which planes it blends matters to no kernel."""
    splats, camera = _model(0, [DOG] if dog else [])
    projection = project(upload(splats), camera, sh_degree=0)
    # columns by their number: kernels do not know which arrays these are
    if settings.slopes:
        projection.slopes = 2 * projection.colors
    if settings.curvatures:
        projection.curvatures = projection.colors[:CURVATURE_COLUMNS]
    if settings.cuts:
        projection.cuts = (2 * projection.colors)[: settings.cuts * CUT_COLUMNS]
    features = (2 * projection.colors)[: settings.n_features]
    blocks = replace(Blocks.of_backend(), unroll=unroll, adapts=False)
    options = RasterOptions(
        cutoffs=settings.cutoffs, negative_transmittance=settings.negative_transmittance, patch=settings.patch
    )
    view = arrange(projection, features, Grid(SIZE, SIZE, blocks), options)
    dr.eval(view)
    return view


def _model(sh_degree: int, groups: Sequence[RowGroup]) -> tuple[Splats, DeviceCamera]:
    """A model in front of a camera, all of it in these ``groups``; what it shows matters to no kernel."""
    rng = np.random.default_rng(0)
    rows = {name: np.zeros((N, *shape)) for group in groups for name, shape in group.arrays.items()}
    splats = Splats(
        means=rng.uniform([-1, -1, 2], [1, 1, 4], (N, 3)),
        log_scales=np.full((N, 3), -2),
        quats=rng.normal(size=(N, 4)),
        logit_opacities=np.zeros(N),
        sh_coeffs=np.zeros((N, (sh_degree + 1) ** 2, 3)),
        **rows,
        **{group.index: np.arange(N) for group in groups},
    )
    return splats, DeviceCamera.upload(Camera(np.eye(4), SIZE, SIZE, SIZE / 2, SIZE / 2, SIZE, SIZE))
