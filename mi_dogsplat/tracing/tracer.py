"""``SplatTracer``: what arbitrary rays see of primitives."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.arrays import array_types, detached, while_loop
from ..engine.sh import unit_basis
from .kernels import line, meet
from .options import TraceOptions
from .primitives import primitives_of
from .tables import Tables, pack

MAX_T = 2.0**30  # a walk stops before negative alphas take the transmittance above this


class SplatTracer:
    """Gathers primitives along rays.

    Made once for the parameters of this moment; rays of any number, origin and direction follow. ``ray.d`` need not be
    of length 1: ``maxt`` is in its units.

    **Derivatives.** None yet: the interface stands. They will be those of the parameters, in both modes, where
    ``params`` are attached to the AD graph, if the methods are called outside of a symbolic loop; a ray has none.
    """

    def __init__(self, params: dict, options: TraceOptions):
        """``params``: flat arrays in world space, as ``parameters.upload`` or a shape ``dog`` has them."""
        self.options = options
        self.tables: Tables | None = None
        if n := dr.width(params["logit_opacities"]):
            primitives = primitives_of(params, options.sh_degree)
            types = array_types()
            order = dr.compress(detached(primitives.usable) & (dr.arange(types.UInt, n) < n))
            self.n = dr.width(order)
            if self.n:
                self.tables = pack(primitives, order, options.cutoffs.log2_range)

    def transmittance(self, ray: mi.Ray3f, active: Any = True) -> mi.Float:
        """Product of 1 - alpha over the primitives between ``ray.o`` and ``ray.maxt``; for shadow rays.

        In any order. Where it falls below the cutoff of the transmittance it is 0. 1 in lanes that are not active.
        """
        if self.tables is None:
            return dr.full(mi.Float, 1, dr.width(ray))
        tables, options, types = self.tables, self.options, array_types()
        of_ray, maxt = line(list(detached(ray.o)), list(detached(ray.d))), detached(ray.maxt)
        active = types.Float(0) == dr.select(detached(mi.Bool(active)), types.Float(0), types.Float(1))
        n = dr.opaque(types.UInt, self.n)

        def body(row, T):
            met = meet(tables, row, of_ray, options.cutoffs, active)
            alpha = dr.select((met.t > 0) & (met.t < maxt), met.alpha, 0)
            if not options.negative_transmittance:
                alpha = dr.maximum(alpha, 0)
            return row + 1, T * (1 - alpha)

        start = dr.zeros(types.UInt, dr.width(ray)), dr.full(types.Float, 1, dr.width(ray))
        _, T = while_loop(start, lambda row, T: active & (row < n) & (T >= options.cutoffs.transmittance), body, "")
        return mi.Float(dr.select(T >= options.cutoffs.transmittance, T, 0))

    def gather(self, ray: mi.Ray3f, active: Any = True) -> tuple[mi.Color3f, mi.Float]:
        """(colours blended front to back, transmittance left) of the primitives between ``ray.o`` and ``ray.maxt``.

        Colours are in the model's own space, which is sRGB or linear, and evaluated for ``ray.d``. As in splatting, the
        walk stops before the primitive that would take the transmittance below the cutoff. (0, 1) in lanes that are not
        active.
        """
        if self.tables is None:
            return mi.Color3f(dr.zeros(mi.Float, dr.width(ray))), dr.full(mi.Float, 1, dr.width(ray))
        tables, options, types = self.tables, self.options, array_types()
        of_ray, maxt = line(list(detached(ray.o)), list(detached(ray.d))), detached(ray.maxt)
        active = types.Float(0) == dr.select(detached(mi.Bool(active)), types.Float(0), types.Float(1))
        basis = unit_basis(list(detached(ray.d)), options.sh_degree)
        n = dr.opaque(types.UInt, self.n)
        width = dr.width(ray)

        def next_of(last_t, last_row):
            def body(row, t, best):
                met = meet(tables, row, of_ray, options.cutoffs, active)
                after = (met.t > last_t) | ((met.t == last_t) & (row > last_row))
                better = (met.alpha != 0) & after & (met.t < maxt) & (met.t < t)
                return row + 1, dr.select(better, met.t, t), dr.select(better, row, best)

            _, t, best = while_loop((dr.zeros(types.UInt, width), dr.full(types.Float, dr.inf, width), n + 0),
                                    lambda row, t, best: active & (row < n), body, "next")
            return t, best

        def step(walking, last_t, last_row, r, g, b, T):
            t, row = next_of(last_t, last_row)
            walking &= row < n
            met = meet(tables, row, of_ray, options.cutoffs, walking)
            T_next = T * (1 - (met.alpha if options.negative_transmittance else dr.maximum(met.alpha, 0)))
            walking &= (T_next >= options.cutoffs.transmittance) & (T_next <= MAX_T)
            weight = dr.select(walking, met.alpha * T, 0)
            color = []
            for channel in range(3):
                value = types.Float(0.5)
                for k, at in enumerate(basis):
                    at_index = dr.fma(met.index, tables.sh_stride, 3 * k + channel)
                    value = dr.fma(at, dr.gather(types.Float, tables.sh, at_index, walking), value)
                color.append(dr.maximum(value, 0))
            r, g, b = (dr.fma(weight, c, old) for c, old in zip(color, (r, g, b), strict=True))
            return walking, t, row, r, g, b, dr.select(walking, T_next, T)

        zero = dr.zeros(types.Float, width)
        start = (active, zero, dr.full(types.UInt, 0xFFFFFFFF, width), zero, zero, zero, dr.full(types.Float, 1, width))
        _, _, _, r, g, b, T = while_loop(start, lambda walking, *_: walking, step, "gather")
        return mi.Color3f(r, g, b), mi.Float(T)
