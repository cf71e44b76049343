"""What rays gather as operations on AD variables, which bring their own derivatives."""

from __future__ import annotations

from typing import Any, cast

import drjit as dr
import mitsuba as mi

from .adjoints import Adjoints, Tangents
from .blend import gather, transmittance
from .derivatives import gather_backward, gather_forward, transmittance_backward, transmittance_forward
from .options import TraceOptions
from .primitives import SPARSE, Primitives
from .rays import Rays
from .tree import Tree
from .visits import TreeWalk


class Query:
    """Some rays and what they are asked of, as an object of which Dr.Jit sees nothing: it has no derivative."""

    def __init__(self, tree: Tree, options: TraceOptions, rays: Rays):
        self.rays, self.walk = rays, TreeWalk(tree, rays.line, options, rays.active)


class _OfPrimitives(dr.CustomOp):
    """An operation on the columns of ``Primitives``, for their derivatives alone: values come from the query."""

    def eval(self, query: Query, kernel: list, sh: Any, pseudo: list, slopes: list, curvatures: list, normals: list,
             shifts: list):  # fmt: skip
        self.query = query
        return self.asked()

    def asked(self) -> Any:
        """What the rays find, which is kept for derivatives."""
        raise NotImplementedError

    def tangents(self, query: Query) -> Tangents:
        of: Any = self.grad_in
        return Tangents(query.walk.tree, of("kernel"), of("sh"), {name: of(name) for name in SPARSE})

    def set_adjoints(self, adjoints: Adjoints) -> None:
        kernel, sh, sparse = adjoints.of_columns()
        self.set_grad_in("kernel", [mi.Float(δ) for δ in kernel])
        self.set_grad_in("sh", mi.Float(sh))
        for name, columns in sparse.items():
            if columns:
                self.set_grad_in(name, [mi.Float(δ) for δ in columns])


class _Transmittance(_OfPrimitives):
    def asked(self) -> mi.Float:
        self.T = transmittance(self.query.walk)
        return self.query.rays.put(self.T, 1)

    def backward(self):
        δT = self.query.rays.taken(self.grad_out())
        self.set_adjoints(transmittance_backward(self.query.walk, self.T, δT))

    def forward(self):
        δT = transmittance_forward(self.query.walk, self.T, self.tangents(self.query))
        self.set_grad_out(self.query.rays.put(δT, 0))


class _Gather(_OfPrimitives):
    def asked(self) -> tuple[list, mi.Float]:
        rays = self.query.rays
        self.colors, self.T = gather(self.query.walk)
        return [rays.put(c, 0) for c in self.colors], rays.put(self.T, 1)

    def backward(self):
        rays, adjoints = self.query.rays, cast(Any, self.grad_out())
        δcolors, δT = [rays.taken(δ) for δ in adjoints[0]], rays.taken(adjoints[1])
        self.set_adjoints(gather_backward(self.query.walk, self.colors, self.T, δcolors, δT))

    def forward(self):
        δcolors, δT = gather_forward(self.query.walk, self.tangents(self.query))
        put = self.query.rays.put
        self.set_grad_out(([put(δ, 0) for δ in δcolors], put(δT, 0)))


def asked_transmittance(query: Query, primitives: Primitives) -> mi.Float:
    """Attached to the AD graph where the primitives are."""
    if _attached(primitives):
        result: Any = dr.custom(_Transmittance, query, *_columns(primitives))
        return result
    return query.rays.put(transmittance(query.walk), 1)


def asked_colors(query: Query, primitives: Primitives) -> tuple[list, mi.Float]:
    """The same of (three channels, transmittance)."""
    if _attached(primitives):
        result: Any = dr.custom(_Gather, query, *_columns(primitives))
        return result
    colors, T = gather(query.walk)
    return [query.rays.put(c, 0) for c in colors], query.rays.put(T, 1)


def _attached(primitives: Primitives) -> bool:
    """Not within symbolic loops, whose lanes cannot add to arrays that are made in them."""
    return dr.grad_enabled(_columns(primitives)) and not dr.flag(dr.JitFlag.SymbolicScope)


def _columns(primitives: Primitives) -> tuple:
    """What operations have derivatives by."""
    return primitives.kernel, primitives.sh, *(getattr(primitives, name) for name in SPARSE)
