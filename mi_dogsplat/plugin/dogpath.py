"""Integrator plugin ``dogpath``: path tracing among ``dog`` shapes and others."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.rasterize import Frame
from ..tracing.options import TraceOptions
from ..tracing.tracer import SplatTracer
from .light_paths import LightPaths, Limits, Replay
from .replayed import radiance
from .splat_integrator import Drawn, SplatIntegrator, dog_shapes
from .surfaces import Surfaces
from .transfer import emitted

UNLIMITED = 2**31 - 1
SURE = 0.1  # share of a pixel from which on its path is traced for sure; what less is seen of is traced less often


class DogPathIntegrator(SplatIntegrator):
    """.. _integrator-dogpath:
    """

    name = "dogpath"

    def __init__(self, props: Any):
        super().__init__(props)
        max_depth, self.rr_depth = int(props.get("max_depth", 6)), int(props.get("rr_depth", 5))
        if max_depth < -1:
            raise RuntimeError(f'dogpath: "max_depth" is {max_depth}, it must be -1 (no limit) or more')
        if self.rr_depth < 1:
            raise RuntimeError(f'dogpath: "rr_depth" is {self.rr_depth}, it must be 1 or more')
        if any(props.type(name) == mi.Properties.Type.Object for name in props.keys()):
            raise RuntimeError("dogpath: it nests no integrator, it traces the paths itself; remove what is nested")
        self.max_depth = UNLIMITED if max_depth == -1 else max_depth

    def sees_surfaces(self, scene: mi.Scene) -> bool:
        return len(scene.shapes()) > len(dog_shapes(scene))

    averages = sees_surfaces

    def hidden_lights(self) -> bool:
        return self.hide_emitters

    def over_surfaces(self, frame: Frame, seen: Surfaces, drawn: Drawn) -> list:
        T = frame.T
        light = emitted(frame.colors, T, drawn.linear)
        limits = Limits(self.max_depth, self.rr_depth, self.hide_emitters)
        probability = dr.clip(abs(dr.detach(T)) / SURE, 0, 1)
        scene = drawn.scene
        options = TraceOptions(drawn.options.sh_degree, self.negative_transmittance)

        def trace(params: dict, replay: Replay | None) -> Any:
            tracer = SplatTracer(params, options)
            return LightPaths(scene, tracer, limits, drawn.linear, seen.seed).radiance(seen.ray, probability, replay)

        behind = radiance(trace, drawn.params, drawn.derivative)
        return [dr.fma(T, b, c) for c, b in zip(light, behind, strict=True)]


mi.register_integrator("dogpath", lambda props: DogPathIntegrator(props))
