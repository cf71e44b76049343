"""Light paths between surfaces, every segment of which gathers the splats that it passes.

Notation (Veach 1997, multiple importance sampling; Vicini et al. 2021, path replay)
    β           throughput of a path up to the begin of a segment
    S, T        of a segment: radiance that splats send along it, and the share of that behind which they let pass
    L           radiance that a path brings; in a replay what of it is still to come
    δL          derivative of L, or of the loss with respect to it

Paths are traced segment by segment, all that are still on their way in one wavefront: those that have ended leave it.
Random numbers belong to a sample and a vertex, so that a replay has the same ones, and so have two renders whose
parameters differ a little.

Sampling of emitters and of BSDFs find a light behind splats weakened by the same T: the weights that combine the two
need not know it. Light of splats is found by BSDF sampling alone, with the weight 1, unless there are captured lamps
among them (``splat_lamps.py``): then their directions are sampled as well, and the two are combined.

Surfaces that light passes straight (``straight.py``) are no vertices: shadow rays go on behind them, they do not count
in ``max_depth``, and light that BSDF sampling finds behind them has the weight of the direction that was sampled.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import mis_weight

from ..tracing.tracer import SplatTracer
from .denoising import Guides
from .direct_light import DirectLight
from .numbers import Streams
from .replayed import Replay
from .splat_lamps import SplatLamps
from .transfer import emitted, mean_of, spectrum_of
from .wavefront import add_to

RR_MAX = 0.95  # the most that Russian roulette gives a path to go on, as in Mitsuba's own integrators


@dataclass
class Limits:
    """When paths end: after ``max_depth`` segments, by Russian roulette from ``rr_depth`` on."""

    max_depth: int  # that from the camera counts; those behind surfaces that light passes straight do not
    rr_depth: int
    hide_environment: bool  # from the camera
    see_through: bool = False  # it is hidden behind what light passes straight, too


@dataclass
class Lanes:
    """Paths at the beginning of a segment."""

    sample: Any  # of the wavefront, that a path belongs to
    o: Any
    d: Any
    β: Any
    η: Any  # product of relative indices of refraction
    L: Any
    pdf: Any  # of d, by BSDF sampling, and of passing surfaces straight since
    delta: Any  # whether BSDF sampling alone finds what lies there
    source: Any  # where d was sampled, which is o, or lies before surfaces that were passed straight
    n: Any  # normal there
    passed: Any  # number of surfaces that were passed straight since the camera
    beyond: Any  # whether there are some since ``source``
    straight: Any  # whether nothing lies before it that counts as seen by the camera
    sharp: Any  # whether nothing but mirrors and clear glass does; for guides only

    def select(self, index: Any) -> Lanes:
        """Some of them."""
        return Lanes(*(dr.gather(type(value), value, index) for value in self.values()))

    def values(self) -> list:
        return [getattr(self, f.name) for f in fields(self)]


@dataclass
class Bounce:
    """Where paths go from a surface."""

    sample: Any  # mi.BSDFSample3f
    weight: Any  # value of the BSDF, and cosine, over pdf
    active: Any
    passes: Any  # straight on
    share: Any  # of light that does, for which it is no vertex


class LightPaths:
    """Traces the rays of a wavefront, and again for its derivatives.

    Args:
        tracer: of the primitives of the scene; attached to the AD graph for a replay.
        lamps: those among the primitives, None where there are none.
        linear: colours of the primitives are linear, not sRGB.
        streams: of random numbers.
        straight: light passes surfaces of the scene straight.
        guides: added to, of what is not a replay; None where no denoiser asks for them.
    """

    def __init__(
        self, scene: Any, tracer: SplatTracer, lamps: SplatLamps | None, limits: Limits, linear: bool, streams: Streams,
        straight: bool, guides: Guides | None = None,
    ):  # fmt: skip
        self.scene, self.tracer, self.lamps = scene, tracer, lamps
        self.limits, self.linear, self.streams, self.straight = limits, linear, streams, straight
        self.direct_light = DirectLight(scene, tracer, lamps, linear, straight)
        self.guides = guides
        self.clear: Any = mi.Float(0)  # of each ray, once traced: the share that no surface or splat keeps

    def radiance(self, ray: Any, probability: Any, replay: Replay | None = None) -> Any:
        """Radiance that the first surface, or the environment, sends against rays of the camera: mi.Spectrum.

        In a replay its derivative forward, or nothing backward.

        Args:
            probability: [n] with which a ray is followed, 0 where nobody sees what lies behind its splats.
            replay: only derivatives are wanted.
        """
        if replay:
            replay.begin(self.scene)
        with dr.suspend_grad():
            found = dr.zeros(mi.Spectrum, dr.width(ray))
            if self.limits.see_through:
                self.clear = dr.zeros(mi.Float, dr.width(ray))
            lanes = self._start(ray, probability, replay)
            first_maxt = ray.maxt + dr.zeros(mi.Float, dr.width(ray))
            segment = 0
            while self.limits.max_depth and dr.width(lanes.sample):
                lanes = self._segment(lanes, segment, found, replay, first_maxt)
                segment += 1
            return found

    def _start(self, ray: Any, probability: Any, replay: Replay | None) -> Lanes:
        n = dr.width(ray)
        sample = dr.arange(mi.UInt32, n)
        draw = self.streams.at(sample, -1).next_1d()
        L = dr.zeros(mi.Spectrum, n) if replay is None else mi.Spectrum(replay.L)
        β = mi.Spectrum(dr.select(probability > 0, dr.rcp(probability), 0))
        all_ones = dr.full(mi.Float, 1, n)
        o = mi.Point3f(ray.o)
        lanes = Lanes(sample, o, mi.Vector3f(ray.d), β, all_ones, L, mi.Float(all_ones), dr.full(mi.Bool, True, n),
                      o, dr.zeros(mi.Normal3f, n), mi.UInt32(0), mi.Bool(False), mi.Bool(True),
                      mi.Bool(self.guides is not None))
        return lanes.select(dr.compress(draw < probability))

    def _segment(self, lanes: Lanes, segment: int, found: Any, replay: Replay | None, first_maxt: Any) -> Lanes:
        """Adds what a segment and the surface at its end bring to ``found``; returns the paths that go on.

        ``first_maxt``: of the rays of the camera, where its far clip ends them.
        """
        attached = replay is not None
        random = self.streams.at(lanes.sample, segment)
        # a literal where it is the same for all, so that kernels leave out what it decides; else one kernel for all
        depth = (dr.opaque(mi.UInt32, segment) if self.straight else mi.UInt32(segment)) - lanes.passed

        lanes, si, Ls, Lr_splats = self._to_surface(lanes, segment, attached, first_maxt)
        Le = self._from_where_it_ends(si, lanes, attached)
        if self.limits.see_through:
            add_to(self.clear, mean_of(lanes.β), lanes.sample, lanes.straight & ~si.is_valid())
        if self.guides:
            self.guides.add_light(Ls + Le, lanes.sample, lanes.sharp)

        bsdf, goes_on = si.bsdf(), depth + 1 < self.limits.max_depth
        Lr_direct = self.direct_light.reflected(si, bsdf, si.is_valid() & goes_on, lanes.β, random, attached)
        bounce = self._sampled(si, bsdf, goes_on, random, attached)
        if self.guides:
            smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) & ~bounce.passes
            self.guides.add_surface(si, bsdf, lanes.β, lanes.sample, lanes.sharp & si.is_valid() & smooth)
            lanes = replace(lanes, sharp=lanes.sharp & ~smooth)
        if replay is None:
            add_to(found, Ls + Le + Lr_direct, lanes.sample)
        else:
            lanes = replace(lanes, L=lanes.L - dr.detach(Le + Lr_direct))
            with dr.resume_grad():
                followed = bsdf.eval(mi.BSDFContext(), si, dr.detach(bounce.sample.wo), bounce.active)
                Lr_scattered = lanes.L * _relative(dr.select(bounce.passes, bounce.share, followed))
                replay.differentiate(Ls + Lr_splats + Le + Lr_direct + Lr_scattered, lanes.sample, found)

        lanes, active = self._behind(lanes, si, bounce, depth, random)
        dr.schedule(found, self.clear, self.guides.planes() if self.guides else [])
        dr.eval(found, lanes.values(), active)
        return lanes.select(dr.compress(active))

    def _to_surface(self, lanes: Lanes, segment: int, attached: bool, first_maxt: Any) -> tuple[Lanes, Any, Any, Any]:
        """(lanes, si, Ls, Lr): paths up to the next surface ``si``, the radiance of the splats before it, and in a
        replay what comes later as T lets it through."""
        ray = mi.Ray3f(lanes.o, lanes.d)
        if segment == 0:
            ends: Any = dr.gather(mi.Float, first_maxt, lanes.sample)
            ray.maxt = ends
        meeting = self.scene.ray_intersect_preliminary(ray, coherent=segment == 0)
        β, L, Ls, Lr = lanes.β, lanes.L, mi.Spectrum(0), mi.Spectrum(0)
        if segment:  # in front of the camera they have been splatted
            ray.maxt = dr.select(meeting.is_valid(), meeting.t, dr.largest(mi.Float))
            mis = mi.Float(1)
            if self.lamps:
                alone = lanes.delta | lanes.beyond  # shadow rays to lamps end at all surfaces
                mis = dr.select(alone, 1, mis_weight(lanes.pdf, self.lamps.pdf(lanes.o, lanes.d)))
            with dr.resume_grad(when=attached):
                colors, T = self.tracer.gather(ray)
                Ls = β * dr.detach(mis) * spectrum_of(emitted(list(colors), T, self.linear))
                if attached:
                    L = L - dr.detach(Ls)
                    Lr = L * _relative(T)
            β = β * dr.detach(T)
            ray.maxt = dr.largest(mi.Float)
        return replace(lanes, β=β, L=L), meeting.compute_surface_interaction(ray), Ls, Lr

    def _from_where_it_ends(self, si: Any, lanes: Lanes, attached: bool) -> Any:
        """Light of the emitter that a segment ends at, be it the environment."""
        before = dr.zeros(mi.SurfaceInteraction3f, dr.width(si))
        before.p, before.n = lanes.source, lanes.n
        ds = mi.DirectionSample3f(self.scene, si, before)
        seen: Any = si.is_valid() | ~lanes.straight if self.limits.hide_environment else mi.Bool(True)
        mis = mis_weight(lanes.pdf, self.scene.pdf_emitter_direction(before, ds, ~lanes.delta))
        with dr.resume_grad(when=attached):
            return lanes.β * dr.detach(mis) * ds.emitter.eval(si, seen)

    def _sampled(self, si: Any, bsdf: Any, goes_on: Any, random: Any, attached: bool) -> Bounce:
        """By BSDF sampling. ``goes_on``: paths that may have another vertex."""
        active, passes, share = si.is_valid() & goes_on, mi.Bool(False), mi.Spectrum(1)
        if self.straight:
            active = si.is_valid() & (goes_on | mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null))
            with dr.resume_grad(when=attached):
                share = bsdf.eval_null_transmission(si, active)
        sample, weight = bsdf.sample(mi.BSDFContext(), si, random.next_1d(), random.next_2d(), active)
        if self.straight:
            passes = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null) & dr.any(dr.detach(share) != 0)
            active &= goes_on | passes
        return Bounce(sample, weight, active, passes, share)

    def _behind(self, lanes: Lanes, si: Any, bounce: Bounce, depth: Any, random: Any) -> tuple[Lanes, Any]:
        """Paths at the beginning of their next segment, and which of them go on."""
        sampled, passes = bounce.sample, bounce.passes
        away = si.spawn_ray(si.to_world(sampled.wo))
        β, η = lanes.β * bounce.weight, lanes.η * sampled.eta
        brightest = dr.max(β)
        active = bounce.active & (brightest != 0)
        survival = dr.select((depth >= self.limits.rr_depth) & ~passes, dr.minimum(brightest * η * η, RR_MAX), 1)
        active &= random.next_1d() < survival
        β *= dr.rcp(survival)
        pdf, delta = sampled.pdf, mi.has_flag(sampled.sampled_type, mi.BSDFFlags.Delta)
        source, n, passed = away.o, si.n, lanes.passed
        if self.straight:
            pdf = dr.select(passes, lanes.pdf * mean_of(dr.detach(bounce.share)), pdf)
            delta, source, n = dr.select(passes, (lanes.delta, lanes.source, lanes.n), (delta, source, n))
            passed = passed + dr.select(passes, mi.UInt32(1), 0)
        straight = lanes.straight & passes if self.limits.see_through else mi.Bool(False)
        return replace(
            lanes, o=away.o, d=away.d, β=β, η=η, pdf=pdf, delta=delta, source=source, n=n, passed=passed,
            beyond=passes, straight=straight,
        ), active  # fmt: skip


def _relative(value: Any) -> Any:
    """value / detached value, 1 with the derivative of its logarithm; 0 where the value is."""
    at = dr.detach(value)
    return value * dr.select(at != 0, dr.rcp(at), 0)
