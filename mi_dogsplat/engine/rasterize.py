"""The whole path from raw parameters to planes, differentiable in both modes: project -> tiles -> composite.

The projection is differentiated by Dr.Jit; the compositor brings its own derivatives (replay of the walk) and enters
the AD graph as one custom operation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from .arrays import detached
from .bands import PreparedView, WalkableView
from .device_camera import DeviceCamera
from .drjit_internals import held
from .geometry import Blocks, Grid
from .normals import normals
from .options import RasterOptions
from .project import Projection
from .projected import projected
from .tables import CentredKernel
from .tiles import TileLists
from .view import arrange
from .walks.adjoints import composite_backward
from .walks.composite import composite
from .walks.pixels import Planes
from .walks.tangents import composite_forward


@dataclass
class Frame:
    """A rendered view as row-major [H*W] planes."""

    colors: list  # 3 planes, without background
    T: mi.Float  # transmittance left for the background
    depth: mi.Float | None  # Σ depth α T, world units along the optical axis
    normal: list | None  # Σ normal α T, 3 planes, world space
    projection: Projection | None = None  # None when there was nothing to project
    view: WalkableView | None = None  # what was walked, for other walks

    @property
    def lists(self) -> TileLists | None:
        """None without a view, and where it was walked in bands."""
        return self.view.lists if isinstance(self.view, PreparedView) else None


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
        """(view, blended planes) if the inputs are those of the latest primal pass."""
        return self.stages if key == self.key else None

    def forget(self) -> None:
        """Give the memory back, still warm in the caches, before the next pass asks for as much."""
        self.key, self._inputs, self.stages = (), [], None

    def keep(self, key: tuple, inputs: list, stages: tuple) -> None:
        self.key, self._inputs, self.stages = key, held(inputs), stages


class _Fixed:
    """What has no derivative, as an object of which Dr.Jit sees nothing: it would look at each of its arrays, twice.

    blended: what ``composite`` returns, if it is known.
    """

    def __init__(self, view: WalkableView, blended: Planes | None):
        self.view, self.blended = view, blended


class _Composite(dr.CustomOp):
    """``composite`` as an operation on AD variables: lists of projected quantities, with features and what varies, to
    planes."""

    def eval(self, fixed: _Fixed, splats: list, pseudo: list):
        self.view, self.has_dog = fixed.view, bool(pseudo)
        self.blended = fixed.blended or composite(self.view)
        return [mi.Float(plane) for plane in self.blended.features], mi.Float(self.blended.T)

    def backward(self):
        δsplats, δpseudo = composite_backward(self.view, self.blended, Planes(*detached(self.grad_out())))
        self.set_grad_in("splats", [mi.Float(δ) for δ in δsplats])
        if self.has_dog:
            self.set_grad_in("pseudo", [mi.Float(δ) for δ in δpseudo])

    def forward(self):
        δpseudo = detached(self.grad_in("pseudo")) if self.has_dog else []
        δ = composite_forward(self.view, detached(self.grad_in("splats")), δpseudo)
        self.set_grad_out(([mi.Float(plane) for plane in δ.features], mi.Float(δ.T)))


def rasterize(
    params: dict,
    camera: DeviceCamera,
    options: RasterOptions,
    probe: list | None = None,
    last: LastFrame | None = None,
    recall: bool = False,
    stop_depth: mi.Float | None = None,
    one_of_many: bool = False,
) -> Frame:
    """Splat primitives into the planes of a view; black, with T = 1, where there are no primitives.

    Args:
        params: raw parameters as flat arrays, see ``project``; any of them may be attached to the AD graph.
        camera: the view and its size.
        options: what the kernels are made for: SH degree, antialiasing, further planes, cutoffs.
        probe: two [N] arrays of zeros, in pixels, that are added to the projected centres; their gradients are those by
            the centres (the statistic of densification).
        last: keeps the stages of this call.
        recall: use the stages that ``last`` has kept instead, if they are of the same inputs.
        stop_depth: [H*W] world units, a primitive whose centre is deeper is not blended into a pixel (no derivative).
        one_of_many: this is one of many passes of which all are differentiated before their gradients are used.
    """
    if dr.width(params["logit_opacities"]) == 0 or camera.width * camera.height == 0:
        return _empty_frame(camera.width * camera.height, options)
    projection = projected(
        params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased, one_of_many=one_of_many
    )
    if probe is not None:
        projection.x, projection.y = projection.x + probe[0], projection.y + probe[1]
    depths = [projection.depth] if options.depth or stop_depth is not None else []
    features = projection.colors + depths + (normals(params, camera) if options.normal else [])

    key = (camera.numbers, options, *((name, value.index) for name, value in params.items()))
    known = last.recall(key) if last and recall else None
    if last and not recall:
        last.forget()
    view, blended = known or (_arranged(projection, features, camera, options, stop_depth), None)
    planes, T = _composited(projection, features, view, blended)
    if last and not recall:
        last.keep(key, list(params.values()), (view, Planes(detached(planes), detached(T))))

    depth, normal = planes[3] if options.depth else None, planes[-3:] if options.normal else None
    return Frame(planes[:3], T, depth, normal, projection, view)


def _empty_frame(n_pixels: int, options: RasterOptions) -> Frame:
    """Of no primitives, or no pixels."""
    nothing = [dr.zeros(mi.Float, n_pixels) for _ in range(3)]
    depth, normal = nothing[0] if options.depth else None, nothing if options.normal else None
    return Frame(nothing, dr.full(mi.Float, 1, n_pixels), depth, normal)


def _arranged(
    projection: Projection, features: list, camera: DeviceCamera, options: RasterOptions, stop_depth: mi.Float | None
) -> WalkableView:
    """The view of the camera, for the backend's blocks."""
    grid = Grid.of(camera.width, camera.height, Blocks.of_backend())
    return arrange(projection, features, grid, options, stop_depth)


def _composited(projection: Projection, features: list, view: WalkableView, blended: Planes | None) -> tuple[list, Any]:
    """(planes of the features, T), attached to the AD graph where the projection is."""
    k, p = projection.kernels, projection.pseudo
    kernels = CentredKernel(projection.x, projection.y, k.ux, k.uy, k.vy, k.lo)
    splats = [*kernels, *features, *projection.varying]
    pseudo = [] if p is None else [p.ux, p.uy, p.vy, p.lo]
    composited: Any = dr.custom(_Composite, _Fixed(view, blended), splats, pseudo)
    return composited
