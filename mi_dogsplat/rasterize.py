"""The whole path from raw parameters to planes, differentiable in both modes: project -> tiles -> composite.

The projection is differentiated by Dr.Jit; the compositor brings its own derivatives (replay of the walk) and enters the
AD graph as one custom operation.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .composite import (
    DERIVATIVE_ROW,
    PSEUDO_DERIVATIVE_ROW,
    Settings,
    composite,
    composite_backward,
    composite_forward,
    pack,
)
from .geometry import Blocks, Cutoffs, Grid
from .project import DeviceCamera, Projection, project
from .tiles import Lists, tiles


@dataclass(frozen=True)
class RasterOptions:
    """Choices that change the kernels; each costs nothing when it is off."""

    sh_degree: int = 3  # highest degree evaluated
    antialiased: bool = False
    depth: bool = False  # also blend Σ depth α T
    negative_transmittance: bool = True
    cutoffs: Cutoffs = Cutoffs()


@dataclass
class Frame:
    """A rendered view as row-major [H*W] planes."""

    colors: list  # 3 planes, without background
    T: mi.Float  # transmittance left for the background
    depth: mi.Float | None  # Σ depth α T
    projection: Projection | None  # None when there was nothing to project
    lists: Lists | None


class _Composite(dr.CustomOp):
    """``composite`` as an operation on AD variables. Inputs and outputs are flat lists."""

    def eval(self, grid, tables, lists, settings, splats, pseudo):  # noqa: D102, A003
        self.fixed = (grid, grid.lanes, tables, lists, settings)
        self.has_dog = tables.pseudo is not None
        self.counts = dr.width(splats[0]), dr.width(pseudo[0]) if pseudo else 0
        self.planes, self.T = composite(*self.fixed)
        return [mi.Float(plane) for plane in self.planes], mi.Float(self.T)

    def backward(self):
        δplanes, δT = self.grad_out()
        detached = [dr.detach(δ, preserve_type=False) for δ in δplanes]
        n, m = self.counts
        zeros = [dr.zeros(dr.detached_t(mi.Float), n * DERIVATIVE_ROW), None]
        if self.has_dog:
            zeros[1] = dr.zeros(dr.detached_t(mi.Float), m * PSEUDO_DERIVATIVE_ROW)
        δsplats, δpseudo = composite_backward(
            *self.fixed, self.planes, self.T, detached, dr.detach(δT, preserve_type=False), *zeros
        )
        self.set_grad_in("splats", _columns(δsplats, n, DERIVATIVE_ROW, 6 + len(self.planes)))
        if self.has_dog:
            self.set_grad_in("pseudo", _columns(δpseudo, m, PSEUDO_DERIVATIVE_ROW, 4))

    def forward(self):
        def tangents(name):
            return [dr.detach(δ, preserve_type=False) for δ in self.grad_in(name)]

        δpseudo = tangents("pseudo") if self.has_dog else None
        δplanes, δT = composite_forward(*self.fixed, tangents("splats"), δpseudo)
        self.set_grad_out(([mi.Float(δ) for δ in δplanes], mi.Float(δT)))


def _columns(table, n: int, stride: int, count: int) -> list[mi.Float]:
    """The first ``count`` columns of a row-major [n, stride] table."""
    row = dr.arange(dr.detached_t(mi.UInt32), n)
    return [mi.Float(dr.gather(type(table), table, dr.fma(row, stride, k))) for k in range(count)]


def rasterize(params: dict, camera: DeviceCamera, options: RasterOptions, probe: list | None = None) -> Frame:
    """Splat primitives into the planes of a view.

    Args:
        params: raw parameters as flat arrays, see ``project``; any of them may be attached to the AD graph.
        camera: the view and its size.
        options: specialisation of the kernels.
        probe: two [N] arrays of zeros that are added to the projected centres; their gradient is that of the
            centres in pixels (the densification statistic).
    """
    n_pixels = camera.width * camera.height
    if dr.width(params["logit_opacities"]) == 0 or n_pixels == 0:
        nothing = [dr.zeros(mi.Float, n_pixels) for _ in range(3)]
        return Frame(nothing, dr.full(mi.Float, 1, n_pixels), dr.zeros(mi.Float, n_pixels) if options.depth else None, None, None)

    projection = project(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
    if probe is not None:
        projection.x, projection.y = projection.x + probe[0], projection.y + probe[1]
    grid = Grid(camera.width, camera.height, Blocks.of_backend())
    features = projection.colors + ([projection.depth] if options.depth else [])
    tables = pack(projection, features)
    lists = tiles(projection, grid, options.cutoffs)
    settings = Settings(len(features), options.cutoffs, options.negative_transmittance)

    k, p = projection.kernels, projection.pseudo
    splats = [projection.x, projection.y, k.A, k.B, k.C, k.lo, *features]
    planes, T = dr.custom(
        _Composite, grid, tables, lists, settings, splats, [] if p is None else [p.A, p.B, p.C, p.lo]
    )
    return Frame(planes[:3], T, planes[3] if options.depth else None, projection, lists)
