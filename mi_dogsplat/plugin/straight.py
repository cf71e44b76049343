"""Surfaces that light passes straight, in part or whole: masks, thin glass, blends with them.

Shadow rays go on behind them, with the share of light that is let through.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.arrays import while_loop


class LatestStraight:
    """Whether light passes surfaces of the latest scene straight.

    Scenes are told apart by the identity of the array of their shapes and of the materials of these, which are kept
    alive here: ``set_bsdf`` of a shape gives it another material.
    """

    def __init__(self) -> None:
        self._shapes: Any = None
        self._all: list = []  # those of groups, which only their instances show, too
        self._materials: list = []
        self._passes = False

    def of(self, scene: mi.Scene) -> bool:
        shapes = scene.shapes_dr()
        another = self._shapes is None or shapes.index != self._shapes.index
        if another:
            parts: Any = mi.traverse(scene).hierarchy
            self._shapes, self._all = shapes, [part for part in parts if isinstance(part, mi.Shape)]
        materials = [shape.bsdf() for shape in self._all]
        if another or materials != self._materials:
            self._materials, self._passes = materials, lets_straight(scene)
        return self._passes


def lets_straight(scene: mi.Scene) -> bool:
    """Whether a material of the scene lets light pass straight, shapes of instances included."""
    parts: Any = mi.traverse(scene).hierarchy
    return any(isinstance(part, mi.BSDF) and mi.has_flag(part.flags(), mi.BSDFFlags.Null) for part in parts)


def transmittance(scene: Any, start: Any, end: Any, active: Any, attached: bool = False) -> Any:
    """Share of light that surfaces let pass straight between a surface and a point, per channel: mi.Spectrum.

    Args:
        start: mi.Interaction3f, from which the ray starts.
        end: mi.Point3f.
        attached: to the AD graph, where parameters of the materials are. Without, it takes one kernel.
    """

    def step(T: Any, ray: Any, active: Any) -> tuple:
        hit = scene.ray_intersect(ray, active)
        active = active & hit.is_valid()  # not &=, which writes into what the caller holds
        with dr.resume_grad(when=attached):
            T = dr.select(active, T * hit.bsdf().eval_null_transmission(hit, active), T)
        return T, hit.spawn_ray_to(end), active & dr.any(dr.detach(T) != 0)

    def on(T: Any, ray: Any, active: Any) -> Any:
        return active

    width = dr.width(active, end)
    ray = mi.Ray3f(start.spawn_ray_to(end))
    state = dr.full(mi.Spectrum, 1, width), ray, active
    if not attached:
        return while_loop(state, on, step, label="shadow ray through surfaces", labels=("T", "ray", "active"))[0]
    while dr.any(state[-1]):
        state = step(*state)
        dr.eval(state)
    return state[0]
