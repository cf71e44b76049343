"""Integrator plugin ``dogsplat``: renders ``dog`` shapes by splatting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import ADIntegrator

from .plugin import surfaces
from .plugin.drawn import Splatted
from .plugin.splat_integrator import SplatIntegrator, dog_shapes
from .support.wording import counted


class DogSplatIntegrator(SplatIntegrator):
    """.. _integrator-dogsplat:

    Gaussian and DoG splatting (:monosp:`dogsplat`)
    -----------------------------------------------

    .. pluginparameters::

     * - srgb_primitives
       - |bool|
       - The primitives hold display-referred sRGB colours, as models trained from photographs do: the blended image
         is converted to linear radiance for the film. (Default: as the files of the shapes say, else true)

     * - antialiased
       - |bool|
       - Scale opacities by the area that the screen-space low-pass filter adds. (Default: as the files of the shapes
         say, else false)

     * - near_clip
       - |float|
       - Primitives whose centre is nearer than this to the camera plane are dropped, in world units. (Default: as the
         files of the shapes say, else 0.2, as in 3DGS)

     * - hide_emitters
       - |bool|
       - Do not show the environment, and shapes that emit light, to the camera; surfaces are lit by them all the same.
         (Default: as the nested integrator says, else false)

     * - negative_transmittance
       - |bool|
       - Where a DoG primitive's weight is negative it amplifies what lies behind, T (1 - α) with α < 0; if
         false it only subtracts its own colour. (Default: true)

     * - (Nested plugin)
       - :paramtype:`integrator`
       - Renders the other shapes of the scene, e.g. ``path``. Splats are blended in front of them, pixel by pixel.
         (Default: none, other shapes are not seen)

     * - aovs
       - |string|
       - Comma-separated list of extra channels, defined in ``aovs.py``: ``alpha``, ``depth`` (expected depth along
         the optical axis, divided by alpha) and ``normal`` (world space), which are differentiable; ``median_depth``,
         ``index``, ``count`` and ``dog_share``, which are not. (Default: none)

    This integrator evaluates every ``dog`` shape of the scene by elliptical weighted averaging (Kerbl et al. 2023):
    primitives are sorted by the depth of their centres and blended per pixel. The colour of a constant or environment
    emitter of the scene shows behind them. Sensors: ``perspective``, ``thinlens``, ``orthographic``, ``batch``.

    **Samples per pixel.** A sample is one pass of splatting. ``spp=1`` evaluates the pixel centres and uses no
    reconstruction filter: splats are low-pass filtered already. ``spp=n`` renders n passes, moved inside the pixels,
    and over the lens of a ``thinlens``, so that they cover both evenly; the film's filter weighs them, or says where
    they are if it is no wider than a pixel, and the seed moves them. ``spp=0``, the default, is 1, but the sample count
    of the sensor's sampler where there is something to average: a lens, or surfaces.

    **Surfaces.** A primitive is seen if its centre is nearer than the surface at that pixel. Splats neither cast
    shadows on surfaces nor show in their reflections, what is seen through a transparent surface has no splats, and
    derivatives take surfaces as constant: for all of this there is the integrator ``dogpath``. In AOVs a surface is
    opaque and the last of all: alpha is 1, depths and normal count it in; the other AOVs are those of the primitives in
    front of it.

    **Clipping.** The near clip of the sensor holds as well as that of the integrator; primitives whose centre is beyond
    its far clip are dropped, unless that is 10,000, the default of Mitsuba.

    All three modes of ``mi.render()`` are supported: primal, forward and backward. It draws whole images, not rays,
    and so cannot be nested in another integrator such as ``aov`` or ``moment``.

    .. code-block:: python

        'type': 'dogsplat',
        'surfaces': {'type': 'path'}
    """

    name = "dogsplat"

    def __init__(self, props: Any):
        super().__init__(props)
        if paths := [name for name in ("max_depth", "rr_depth") if name in props]:  # which Mitsuba's base class takes
            raise RuntimeError(f'dogsplat: "{paths[0]}" is of integrators that trace paths; give it to the nested one')
        objects = [props[name] for name in props.keys() if props.type(name) == mi.Properties.Type.Object]
        nested = [value for value in objects if isinstance(value, mi.Integrator)]
        if others := [value.class_name() for value in objects if not isinstance(value, mi.Integrator)]:
            raise RuntimeError(f"dogsplat: it nests an integrator and no {others[0]}; put that into the scene")
        if len(nested) > 1:
            raise RuntimeError(f"dogsplat: {len(nested)} nested integrators; one renders all surfaces")
        self.nested = nested[0] if nested else None
        if self.nested is not None and not isinstance(self.nested, mi.SamplingIntegrator):
            kind = self.nested.class_name()
            raise RuntimeError(f"dogsplat: a nested {kind} traces no rays of a camera; nest another, such as path")
        if self.nested is not None and (channels := self.nested.aov_names()):
            found = ", ".join(channels)
            raise RuntimeError(f'dogsplat: channels of a nested integrator are not kept ({found}); use its own "aovs"')
        if self.nested is not None and self.nested.hide_emitters:
            self.hide_emitters = True  # its rays would leave black where they pass through lamps
        # asked now: after a change of the variant, there and back too, Mitsuba's classes in Python are others
        self._by_modes = isinstance(self.nested, ADIntegrator)
        self._warned = False

    def averages(self, scene: mi.Scene) -> bool:
        return self.nested is not None

    def sees_surfaces(self, scene: mi.Scene) -> bool:
        others = len(scene.shapes()) - len(dog_shapes(scene))
        if others and self.nested is None and self.warns and not self._warned:
            log: Any = mi.Log
            unseen = counted(others, "other shape")
            log(mi.LogLevel.Warn, f"dogsplat: {unseen} not seen; nest an integrator, such as path")
            self._warned = True
        return self.nested is not None and others > 0

    def over_surfaces(self, views: Sequence[Splatted]) -> list[list]:
        return [self._over_surfaces(view) for view in views]

    def _over_surfaces(self, view: Splatted) -> list:
        drawn, frame, seen = view.drawn, view.frame, view.surfaces
        lit = drawn.encoded(surfaces.radiance(self.nested, drawn.scene, seen, self._by_modes))
        T, rest = dr.select(seen.hit, frame.T, 0), dr.select(seen.hit, 0, frame.T)
        colors = [dr.fma(T, behind, c) for c, behind in zip(frame.colors, lit, strict=True)]
        return drawn.decoded(self.over_background(colors, rest, drawn))


mi.register_integrator("dogsplat", lambda props: DogSplatIntegrator(props))
