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

SURE = 0.1  # share of a pixel from which on its path is traced for sure; what less is seen of is traced less often


class LatestTracer:
    """The tracer of the latest parameters, which all passes of a render share.

    They are compared by the identity of their JIT variables, which are immutable and kept alive here.
    """

    def __init__(self) -> None:
        self._key: tuple = ()
        self._params: dict = {}
        self._tracer: SplatTracer | None = None

    def of(self, params: dict, options: TraceOptions) -> SplatTracer:
        key = (options, *((name, value.index) for name, value in params.items()))
        if self._tracer is None or key != self._key:
            self._key, self._params, self._tracer = key, params, SplatTracer(params, options)
        return self._tracer


class DogPathIntegrator(SplatIntegrator):
    """.. _integrator-dogpath:
    """

    name = "dogpath"

    def __init__(self, props: Any):
        super().__init__(props)
        self._tracer = LatestTracer()
        if any(props.type(name) == mi.Properties.Type.Object for name in props.keys()):
            raise RuntimeError("dogpath: it nests no integrator, it traces the paths itself; remove what is nested")

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
            tracer = SplatTracer(params, options) if replay else self._tracer.of(params, options)
            return LightPaths(scene, tracer, limits, drawn.linear, seen.seed).radiance(seen.ray, probability, replay)

        behind = radiance(trace, drawn.params, drawn.derivative)
        return [dr.fma(T, b, c) for c, b in zip(light, behind, strict=True)]


mi.register_integrator("dogpath", lambda props: DogPathIntegrator(props))
