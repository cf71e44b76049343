"""The projection as one operation on AD variables, whose values and derivatives a GPU replays.

Traced anew in each pass, it takes the host longer than a GPU takes for the kernels of a small model, or of one with
much besides plain Gaussians. On the CPU kernels are longer, and the gradients, which would go through memory, stay in
the kernel of the optimizer's step: there it is ``project`` itself, unless many passes are derived before that step,
as the projections of all of them would stay in its kernel. Where numbers of the camera have derivatives, such as those
of a sensor, it is ``project`` on any backend.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from .arrays import array_types, backward
from .device_camera import DeviceCamera, Nudge
from .frozen import frozen_for_sizes
from .project import Projection, project
from .screen_kernels import Kernels

NUDGE = "nudge "  # and a number: name of an array of the camera's nudge


def projected(
    params: dict, camera: DeviceCamera, *, sh_degree: int, antialiased: bool = False, one_of_many: bool = False
) -> Projection:
    """What ``project`` returns for the same arguments; differentiable likewise.

    one_of_many: this is one of many passes of which all are differentiated before their gradients are used.
    """
    traced = (array_types().is_llvm and not one_of_many) or dr.grad_enabled(camera.anonymous())
    return (project if traced else replayed)(params, camera, sh_degree=sh_degree, antialiased=antialiased)


def replayed(params: dict, camera: DeviceCamera, *, sh_degree: int, antialiased: bool = False) -> Projection:
    """The operation, on any backend. The camera has no derivatives but by its nudge."""
    nudge = {f"{NUDGE}{k}": value for k, value in enumerate(camera.nudge.values)} if camera.nudge else {}
    arrays = params | nudge
    attached = {name: value for name, value in arrays.items() if dr.grad_enabled(value)}
    given = _Given(dr.detach(arrays), camera.anonymous(), sh_degree, antialiased)
    found = _values(given)
    if attached:
        found = _attached(found, dr.custom(_Project, _Fixed(given, tuple(attached), found), list(attached.values())))
    return replace(found, dog_row=params.get("dog_row"), dog_index=params.get("dog_index"))


@dataclass(frozen=True)
class _Given:
    """Arguments of ``project`` for a frozen function; those of the nudge are among the ``arrays``."""

    arrays: dict
    camera: DeviceCamera
    sh_degree: int
    antialiased: bool

    def projection(self, attached: dict) -> Projection:
        """With these arrays in the place of those of their names."""
        arrays = self.arrays | attached
        nudge = [arrays[name] for name in arrays if name.startswith(NUDGE)]
        camera = replace(self.camera, nudge=Nudge(nudge[:3], nudge[3:])) if nudge else self.camera
        return project(arrays, camera, sh_degree=self.sh_degree, antialiased=self.antialiased)


@frozen_for_sizes
def _values(given: _Given) -> Projection:
    return replace(given.projection({}), dog_row=None, dog_index=None)


@frozen_for_sizes
def _gradients(given: _Given, names: tuple, adjoints: list) -> list:
    """Of the arrays of these names."""
    arrays = {name: mi.Float(given.arrays[name]) for name in names}
    dr.enable_grad(arrays)
    backward(_differentiable(given.projection(arrays)), adjoints)
    return [dr.detach(dr.grad(value)) for value in arrays.values()]


class _Fixed:
    """What has no derivative, as an object of which Dr.Jit sees nothing."""

    def __init__(self, given: _Given, names: tuple, found: Projection):
        self.given, self.names, self.found = given, names, found


class _Project(dr.CustomOp):
    """From the attached arrays to what is differentiable of a projection."""

    def eval(self, fixed: _Fixed, arrays: list):
        self.fixed = fixed
        return [mi.Float(value) for value in _differentiable(fixed.found)]

    def backward(self):
        found: Any = self.grad_out()
        adjoints = [dr.detach(δ) for δ in found]
        self.set_grad_in("arrays", _gradients(self.fixed.given, self.fixed.names, adjoints))

    def forward(self):
        arrays = {name: mi.Float(self.fixed.given.arrays[name]) for name in self.fixed.names}
        dr.enable_grad(arrays)
        values = _differentiable(self.fixed.given.projection(arrays))
        tangents: Any = self.grad_in("arrays")
        for value, tangent in zip(arrays.values(), tangents, strict=True):
            dr.set_grad(value, tangent)
        dr.forward_to(values, flags=dr.ADFlag.ClearEdges | dr.ADFlag.AllowNoGrad)
        self.set_grad_out([dr.detach(dr.grad(value)) for value in values])


def _differentiable(p: Projection) -> list:
    """All but variances, which tell only what a primitive may touch."""
    k, q = p.kernels, p.pseudo
    of_pseudo = [] if q is None else [q.ux, q.uy, q.vy, q.lo]
    return [p.x, p.y, p.depth, k.ux, k.uy, k.vy, k.lo, *p.colors, *of_pseudo, *p.varying]


def _attached(p: Projection, values: Any) -> Projection:
    """With other arrays in the place of those that ``_differentiable`` gives."""
    values = iter(values)

    def kernels(like: Kernels) -> Kernels:
        ux, uy, vy, lo = (next(values) for _ in range(4))
        return Kernels(ux, uy, vy, lo, like.variance_x, like.variance_y)

    x, y, depth = (next(values) for _ in range(3))
    own, colors = kernels(p.kernels), [next(values) for _ in p.colors]
    pseudo = kernels(p.pseudo) if p.pseudo else None
    varying = [None if of is None else [next(values) for _ in of] for of in (p.slopes, p.curvatures, p.cuts)]
    return Projection(x, y, depth, own, colors, p.visible, pseudo, None, None, *varying)
