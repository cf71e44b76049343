"""Integrator plugin ``dogpath``: path tracing among ``dog`` shapes and others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.device_camera import DeviceCamera
from ..engine.dimmed import dimmed
from ..engine.drjit_internals import held
from ..tracing.options import TraceOptions
from ..tracing.tracer import SplatTracer
from . import denoising
from .drawn import Splatted, SplattedModel
from .light_paths import LightPaths, Limits
from .media import warn_of_media
from .numbers import Streams
from .properties import given
from .replayed import Replay, radiance
from .shadow_ratios import LatestShadowRatios
from .splat_integrator import SplatIntegrator, dog_shapes
from .splat_lamps import SplatLamps, lamps_of
from .straight import LatestStraight
from .transfer import emitted
from .wavefront import joined, parted, views_at_once

LONGEST = 2**31 - 1  # segments, the most that Mitsuba's own integrators take
SURE = 0.1  # share of a pixel from which on its path is traced for sure; what less is seen of is traced less often


class LatestTracer:
    """Tracer and lamps of the latest parameters, which all passes of a render share.

    They are compared by the identity of their JIT variables, which are immutable and kept alive here.
    """

    def __init__(self) -> None:
        self._key: tuple = ()
        self._params: list = []
        self._found: tuple[SplatTracer, SplatLamps | None] | None = None

    def of(self, params: dict, options: TraceOptions, linear: bool) -> tuple[SplatTracer, SplatLamps | None]:
        key = (options, linear, *((name, value.index) for name, value in params.items()))
        if self._found is None or key != self._key:
            self._key, self._params = key, held(params.values())
            self._found = SplatTracer(params, options), lamps_of(params, linear)
        return self._found

    def of_replay(
        self, params: dict, options: TraceOptions, linear: bool, forward: bool
    ) -> tuple[SplatTracer, SplatLamps | None]:
        """The same with derivatives by ``params``: their values alone say what the tree is."""
        tracer, _ = self.of(dr.detach(params), options, linear)
        return (tracer.with_tangents_of if forward else tracer.attached_to)(params), lamps_of(params, linear)


class DogPathIntegrator(SplatIntegrator):
    """.. _integrator-dogpath:

    Path tracing with splats (:monosp:`dogpath`)
    --------------------------------------------

    .. pluginparameters::

     * - max_depth
       - |int|
       - Longest path, in segments; the one from the camera counts, those behind surfaces that light passes straight do
         not. 1 shows emitters and splats only, 2 surfaces that are lit directly, -1 is without limit. (Default: 6)

     * - rr_depth
       - |int|
       - Segments after which Russian roulette may end a path. (Default: 5)

     * - hide_emitters
       - |bool|
       - Do not show the environment, and shapes that emit light, to the camera; surfaces are lit by them all the same.
         (Default: false)

     * - mesh_shadows
       - |bool|
       - Surfaces cast shadows onto splats: the radiance of each primitive is multiplied by the share of its light that
         the scene leaves to it, which is an approximation. (Default: false)

     * - mesh_shadow_samples
       - |int|
       - Samples of light per primitive for that. (Default: 64)

     * - srgb_primitives, antialiased, near_clip, negative_transmittance, aovs
       - as of ``dogsplat``
       - (Defaults: those of ``dogsplat``); one more of the AOVs is ``denoising``: the part of the colours that has
         noise, and albedo and normal for a denoiser (``denoising.py``)

    Path tracing in a scene of ``dog`` shapes and others. What the camera sees of splats is the picture of ``dogsplat``,
    cut off at the surfaces. From there on light paths are traced, with sampling of emitters and of BSDFs combined by
    multiple importance sampling, and every segment gathers the splats that it passes: they add their radiance, and
    weaken what lies behind. So surfaces receive shadows and colour from splats, mirrors, rough and glossy materials
    show them, glass bends them, and they hide the light of lamps and of the environment. Shadow rays go on behind what
    lets light pass straight, in part or whole (masks, thin glass), as those of ``volpath`` do. Fog and other media are
    not seen, which a warning says. A scene without other shapes has the picture, the bits and the cost of ``dogsplat``.

    **Splats emit.** A captured model brings the light that it was captured in. Lamps of the scene do not change its
    colours, and surfaces do not either, unless ``mesh_shadows`` are asked for. These multiply the radiance of a
    primitive by the ratio of two irradiances on the side that the camera sees: by the emitters of the scene with its
    surfaces, which hide and reflect light, and without them; at most 1 (``shadow_ratios.py``). Ratios are computed
    once, until something changes in the scene, with the same random numbers whatever the seed. For derivatives they are
    constants.

    **Colour.** Splats and light are added up in linear radiance, before the camera too: L = S + T L', where T is the
    transmittance of the splats on a segment, and L' what comes from behind. S is what they blend to if they are linear
    (``srgb_primitives`` false); else their mean colour, made linear, times 1 - T. See docs/dogpath.md.

    **Samples per pixel.** As of ``dogsplat``: n samples are n passes, each with a path for every pixel. Passes of small
    pictures are traced together (``wavefront.py``), so that memory grows with n up to a bound only. ``spp=0`` is the
    sample count of the sensor's sampler where there are other shapes.

    **Derivatives.** Primal, forward and backward mode. The primary picture has all derivatives of ``dogsplat``. Paths
    are replayed (Vicini et al. 2021) with detached sampling: parameters of primitives have derivatives where a segment
    gathers them, so in mirrors and in shadows, and so have materials and emitters; positions of surfaces, and of where
    paths go, have none.

    It draws whole images, not rays, and cannot be nested in another integrator.

    .. code-block:: python

        'type': 'dogpath',
        'max_depth': 8
    """

    name = "dogpath"
    further_aovs = (denoising.AOV,)

    def __init__(self, props: Any):
        super().__init__(props)
        for name in ("max_depth", "rr_depth"):  # of Mitsuba, which asks only where a path is as long
            given(props, name, int)
        self._tracer, self._ratios, self._straight = LatestTracer(), LatestShadowRatios(), LatestStraight()
        self.mesh_shadows = given(props, "mesh_shadows", bool, False)
        self.mesh_shadow_samples = given(props, "mesh_shadow_samples", int, 64)
        self.see_through = False  # of hidden emitters: through surfaces that light passes straight too, as alpha says
        if self.mesh_shadow_samples < 1:
            raise RuntimeError(f'dogpath: "mesh_shadow_samples" is {self.mesh_shadow_samples}, it must be at least 1')
        if any(props.type(name) == mi.Properties.Type.Object for name in props.keys()):
            raise RuntimeError("dogpath: it nests no integrator, it traces paths by itself; remove the nested one")

    def sees_surfaces(self, scene: mi.Scene) -> bool:
        return len(scene.shapes()) > len(dog_shapes(scene))

    averages = sees_surfaces

    def warn_of_unseen(self, scene: mi.Scene) -> None:
        super().warn_of_unseen(scene)
        warn_of_media(self.name, scene)

    def shown_params(self, scene: mi.Scene, model: SplattedModel, camera: DeviceCamera) -> dict:
        if not (self.mesh_shadows and self.sees_surfaces(scene) and dr.width(model.params["logit_opacities"])):
            return model.params
        splats, samples = dog_shapes(scene), self.mesh_shadow_samples
        depth = self.max_depth if self.max_depth < LONGEST else -1  # which Mitsuba's base class holds as 2**32 - 1
        ratios = self._ratios.of(scene, splats, model.params, depth, samples)
        with dr.suspend_grad():
            seen = ratios.seen_by(camera, model.params)
        return dimmed(model.params, seen, model.drawn_as.linear)

    def passes_at_once(self, scene: mi.Scene, model: SplattedModel, pixels: int) -> int:
        if not self.sees_surfaces(scene):
            return 1
        return views_at_once(pixels, dr.width(model.params["logit_opacities"]))

    def over_surfaces(self, views: Sequence[Splatted]) -> list[list]:
        alike: dict[int, list[Splatted]] = {}  # mesh shadows are those that a camera sees: others, other primitives
        for view in views:
            alike.setdefault(id(view.drawn.params), []).append(view)
        behind: dict[int, list] = {}
        for group in alike.values():
            behind |= zip(map(id, group), self._behind(group), strict=True)
        return [self._over(view, behind[id(view)]) for view in views]

    def _over(self, view: Splatted, behind: list) -> list:
        T = view.frame.T
        light = emitted(view.frame.colors, view.drawn.uncovered(T), view.drawn.linear)
        return [dr.fma(T, b, c) for c, b in zip(light, behind, strict=True)]

    def _behind(self, views: list[Splatted]) -> list[list]:
        """What paths of views of the same primitives bring, traced together; notes what they find besides."""
        drawn, count = views[0].drawn, len(views)
        limits = Limits(self.max_depth, self.rr_depth, self.hide_emitters, self.see_through)
        scene, straight = drawn.scene, self._straight.of(drawn.scene)
        options = TraceOptions(drawn.options.sh_degree, self.negative_transmittance)
        ray, probability = _rays(views)
        streams = Streams([view.drawn.view_pass.sample for view in views], dr.width(ray) // count)
        primal: list[LightPaths] = []

        def trace(params: dict, replay: Replay | None) -> Any:
            asked = params, options, drawn.linear
            tracer, lamps = self._tracer.of_replay(*asked, replay.forward) if replay else self._tracer.of(*asked)
            guides = denoising.Guides(dr.width(ray)) if self.denoising and replay is None else None
            paths = LightPaths(scene, tracer, lamps, limits, drawn.linear, streams, straight, guides)
            if replay is None:
                primal.append(paths)
            return paths.radiance(ray, probability, replay)

        behind = radiance(trace, count, drawn.params, drawn.derivative)
        (paths,) = primal
        self._note(views, behind, paths)
        return behind

    def _note(self, views: list[Splatted], behind: list[list], paths: LightPaths) -> None:
        """What paths have found besides radiance, in the surfaces of each view."""
        count = len(views)
        if self.see_through:
            for view, (clear,) in zip(views, parted([paths.clear], count), strict=True):
                view.surfaces.clear = clear
        if paths.guides:
            guides = parted(paths.guides.planes(), count)
            for view, channels, of_view in zip(views, behind, guides, strict=True):
                view.surfaces.for_denoiser = denoising.planes(view.frame.T, channels, of_view)


def _rays(views: list[Splatted]) -> tuple[Any, Any]:
    """Rays of views one after the other, and the probability with which each is followed."""
    parts = []
    for view in views:
        ray, T = view.surfaces.ray, view.frame.T
        parts.append([*ray.o, *ray.d, ray.maxt, dr.clip(abs(dr.detach(T)) / SURE, 0, 1)])
    *ray, maxt, probability = joined(parts)
    found = mi.Ray3f(mi.Point3f(ray[:3]), mi.Vector3f(ray[3:]))
    found.maxt = maxt
    return found, probability


mi.register_integrator("dogpath", lambda props: DogPathIntegrator(props))
