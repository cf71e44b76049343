"""The whole path from raw parameters to planes, differentiable in both modes: project -> tiles -> composite.

The projection is differentiated by Dr.Jit; the compositor brings its own derivatives (replay of the walk) and enters
the AD graph as one custom operation.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .composite import composite
from .composite_derivatives import (
    ENTRY_ROW,
    PSEUDO_ENTRY_ROW,
    composite_backward,
    composite_forward,
    lanes_add_in_turn,
)
from .geometry import Blocks, Cutoffs, Grid
from .normals import normals
from .project import DeviceCamera, Projection, project
from .tables import pack
from .tiles import Lists, tiles
from .walk import Settings


@dataclass(frozen=True)
class RasterOptions:
    """Choices that change the kernels; each costs nothing when it is off."""

    sh_degree: int = 3  # highest degree evaluated
    antialiased: bool = False
    depth: bool = False  # also blend Σ depth α T
    normal: bool = False  # and Σ normal α T
    negative_transmittance: bool = True
    cutoffs: Cutoffs = Cutoffs()
    patch: int = 4  # pixels per side that share their exponentials; 1 costs time and gains some 1e-7 (docs/numerics.md)


@dataclass
class Frame:
    """A rendered view as row-major [H*W] planes."""

    colors: list  # 3 planes, without background
    T: mi.Float  # transmittance left for the background
    depth: mi.Float | None  # Σ depth α T
    projection: Projection | None  # None when there was nothing to project
    lists: Lists | None
    normal: list | None = None  # Σ normal α T, 3 planes, world space
    walk: tuple | None = None  # what was walked, for other walks: first arguments of ``composite``


class LastFrame:
    """The stages of the latest primal pass, for a derivative pass that follows on the very same inputs.

    ``mi.render`` asks for an image and later for its derivatives in separate calls. Inputs are compared by the identity
    of their JIT variables, which are immutable and kept alive here, so a match is never a coincidence.
    """

    def __init__(self):
        self.key: tuple = ()
        self.stages: tuple | None = None
        self._inputs: list = []

    def recall(self, key: tuple) -> tuple | None:
        """(tables, lists, planes, T) if the inputs are those of the latest primal pass."""
        return self.stages if key == self.key else None

    def forget(self) -> None:
        """Give the memory back, still warm in the caches, before the next pass asks for as much."""
        self.key, self._inputs, self.stages = (), [], None

    def keep(self, key: tuple, inputs: list, stages: tuple) -> None:
        self.key, self._inputs, self.stages = key, inputs, stages


class _Walk:
    """The arguments of ``composite``, and its results if they are known."""

    def __init__(self, arguments: tuple, blended: list | None):
        self.arguments, self.blended = arguments, blended


class _Composite(dr.CustomOp):
    """``composite`` as an operation on AD variables. Inputs and outputs are flat lists.

    What has no derivative comes as an object of which Dr.Jit sees nothing: it would look at each of its arrays, twice.
    """

    def eval(self, walk: _Walk, splats, pseudo):
        self.fixed, self.lists = walk.arguments, walk.arguments[3]
        self.has_dog = walk.arguments[2].pseudo is not None
        self.planes, self.T = walk.blended or composite(*self.fixed)
        return [mi.Float(plane) for plane in self.planes], mi.Float(self.T)

    def backward(self):
        δplanes, δT = self.grad_out()
        Float, n_entries = dr.detached_t(mi.Float), dr.width(self.lists.entry_from_isect)
        entries = dr.zeros(Float, n_entries * ENTRY_ROW)
        pseudo_entries = dr.zeros(Float, n_entries * PSEUDO_ENTRY_ROW) if self.has_dog else None
        δplanes, δT = [_detached(δ) for δ in δplanes], _detached(δT)
        in_turn = lanes_add_in_turn(mi.variant())
        δsplats, δpseudo = composite_backward(
            *self.fixed, self.planes, self.T, δplanes, δT, entries, pseudo_entries, in_turn
        )
        self.set_grad_in("splats", [mi.Float(δ) for δ in δsplats])
        if self.has_dog:
            self.set_grad_in("pseudo", [mi.Float(δ) for δ in δpseudo])

    def forward(self):
        def tangents(name):
            return [_detached(δ) for δ in self.grad_in(name)]

        δpseudo = tangents("pseudo") if self.has_dog else None
        δplanes, δT = composite_forward(*self.fixed, tangents("splats"), δpseudo)
        self.set_grad_out(([mi.Float(δ) for δ in δplanes], mi.Float(δT)))


def _detached(value):
    return dr.detach(value, preserve_type=False)


def rasterize(
    params: dict,
    camera: DeviceCamera,
    options: RasterOptions,
    probe: list | None = None,
    last: LastFrame | None = None,
    recall: bool = False,
    stop_depth: mi.Float | None = None,
) -> Frame:
    """Splat primitives into the planes of a view.

    Args:
        params: raw parameters as flat arrays, see ``project``; any of them may be attached to the AD graph.
        camera: the view and its size.
        options: specialisation of the kernels.
        probe: two [N] arrays of zeros that are added to the projected centres; their gradient is that of the
            centres in pixels (the densification statistic).
        stop_depth: [H*W], a primitive whose centre is deeper than this is not blended into a pixel (no derivative).
        last: keeps the stages of this call, or, with ``recall``, may provide those of the call before.
    """
    n_pixels = camera.width * camera.height
    if dr.width(params["logit_opacities"]) == 0 or n_pixels == 0:
        nothing = [dr.zeros(mi.Float, n_pixels) for _ in range(3)]
        depth, normal = nothing[0] if options.depth else None, nothing if options.normal else None
        return Frame(nothing, dr.full(mi.Float, 1, n_pixels), depth, None, None, normal)

    projection = project(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
    if probe is not None:
        projection.x, projection.y = projection.x + probe[0], projection.y + probe[1]
    grid = Grid.of(camera.width, camera.height, Blocks.of_backend(), mi.variant())
    stops = stop_depth is not None
    features = projection.colors + ([projection.depth] if options.depth or stops else [])
    features += normals(params, camera) if options.normal else []
    settings = Settings(len(features), options.cutoffs, options.negative_transmittance, options.patch)
    key = (camera.numbers, options, *((name, value.index) for name, value in params.items()))
    known = last.recall(key) if last and recall else None
    if last and not recall:
        last.forget()
    if known:
        tables, lists, *blended = known
    else:
        tables, lists, blended = pack(projection, features), tiles(projection, grid, options.cutoffs), None
        tables.stop_depth = _detached(stop_depth) if stops else None

    k, p = projection.kernels, projection.pseudo
    splats = [projection.x, projection.y, k.ux, k.uy, k.vy, k.lo, *features]
    pseudo = [] if p is None else [p.ux, p.uy, p.vy, p.lo]
    walk = grid, grid.lanes, tables, lists, settings
    planes, T = dr.custom(_Composite, _Walk(walk, blended), splats, pseudo)
    if last and not recall:
        last.keep(key, list(params.values()), (tables, lists, [_detached(p) for p in planes], _detached(T)))
    depth, normal = planes[3] if options.depth else None, planes[-3:] if options.normal else None
    return Frame(planes[:3], T, depth, projection, lists, normal, walk)
