"""Shadows that surfaces cast onto splats: which share of its light is left to each primitive.

A captured model brings its light along, and nobody knows which part of it came from where. So what a scene takes from
it is an approximation: the ratio r = E / E0 of what the primitive receives in the scene and what it would receive from
the same emitters if no surface was there, and never more than 1.

Notation
    n       normal of a primitive: its shortest axis, to either side
    E       irradiance at its centre, on one side, in the scene without splats: light of emitters as surfaces let it
            pass, and what they reflect
    E0      irradiance of the emitters alone

Both are estimated with the same samples of emitters, so that r is 1, and not about 1, where nothing is in the way.
What surfaces reflect matters: the floor that a model is put onto hides half of the sky from it, and sends a part of
that back. Splats do not count, neither as occluders nor as lights: what they take from each other is in the capture.
A primitive has one ratio, which scales its colour all over: a shadow's edge does not cross it, however that varies.
It is that at the centre of one that is cut off, too: a cut always keeps the centre. Where the place of a primitive
depends on the view, the ratio is that of the place where it is stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.device_camera import DeviceCamera
from ..engine.drjit_internals import held, variable_indices
from ..engine.normals import normals, shortest_axes
from ..engine.rows import rows
from .samples import STEPS
from .straight import lets_straight, transmittance
from .transfer import three_channels

SEED = 0  # of all random numbers: every pass, frame and derivative sees the same ratios
OF_SPLATS = "means", "log_scales", "quats", "to_world"  # parameters of primitives that ratios depend on


@dataclass
class ShadowRatios:
    """Of N primitives, on both sides; three channels of [N] each, from 0 to 1."""

    axis: list  # n to the front
    front: list
    back: list

    def seen_by(self, camera: DeviceCamera, params: dict) -> list:
        """The ratios of the sides that a camera sees."""
        facing = normals(params, camera)
        in_front = sum((a * f for a, f in zip(self.axis, facing, strict=True)), mi.Float(0)) > 0
        return [dr.select(in_front, f, b) for f, b in zip(self.front, self.back, strict=True)]


class LatestShadowRatios:
    """The ratios of the latest scene, which all renders share until something changes in it."""

    def __init__(self) -> None:
        self._key: tuple = ()
        self._arrays: list = []  # whose indices are in the key
        self._ratios: ShadowRatios | None = None

    def of(self, scene: Any, splats: Sequence, params: dict, max_depth: int, samples: int) -> ShadowRatios:
        """As ``estimated`` has them for ``params``, which are those of the shapes ``splats`` of the scene."""
        arrays, texts = what_matters(scene, splats)
        key = (max_depth, samples, *texts, *variable_indices(arrays))
        if self._ratios is None or key != self._key:
            self._key, self._arrays, self._ratios = key, arrays, estimated(scene, params, max_depth, samples)
        return self._ratios


def what_matters(scene: Any, splats: Sequence) -> tuple[list, list[str]]:
    """What ratios depend on in a scene, instanced shapes too: (arrays, texts that name them and say all else)."""
    arrays, texts = [], []
    params: Any = mi.traverse(scene)
    of_camera = mi.Sensor, mi.Film, mi.Sampler
    for name, (_, _, node, _) in params.properties.items():
        if isinstance(node, of_camera) or (node in splats and name.rpartition(".")[2] not in OF_SPLATS):
            continue
        value = params[name]
        in_arrays = bool(variable_indices([value]))
        texts.append(f"{node.class_name()} {name}" + ("" if in_arrays else f" {value}"))
        arrays += held([value]) if in_arrays else []
    return arrays, texts


def estimated(scene: Any, params: dict, max_depth: int, samples: int) -> ShadowRatios:
    """Ratios by Monte Carlo.

    Args:
        params: raw parameters of the primitives in world space, flat arrays; constants here.
        max_depth: segments of light paths, where that from the camera to the primitive is the first; -1 without limit.
        samples: per primitive, of emitters, and of what surfaces reflect to each side.
    """
    with dr.suspend_grad():
        params = dr.detach(params)
        n = dr.width(params["logit_opacities"])
        axis = mi.Vector3f(shortest_axes(params))
        at, normal = _usable(mi.Point3f(rows(params["means"], 3, dr.arange(mi.UInt32, n))), axis, n)
        sides = _Side(normal, n), _Side(-normal, n)
        sampler: Any = mi.load_dict({"type": "independent"})
        sampler.seed(SEED, n)
        start, bounces, straight = sampler.next_2d(), _bounces(max_depth), lets_straight(scene)
        for k in range(samples):
            place = start + mi.Point2f(*(dr.opaque(mi.Float, k * step % 1) for step in STEPS[:2]))
            sample, light = scene.sample_emitter_direction(at, place - dr.floor(place), False)
            light, left = dr.select(sample.pdf > 0, light, 0), _left_by_surfaces(scene, at, sample, straight)
            for side in sides:
                side.add_light(sample.d, light, left)
                if bounces:
                    side.add_reflected(scene, at, bounces, sampler)
            sampler.schedule_state()
            dr.eval([(side.E, side.E0) for side in sides])
        front, back = (side.ratio() for side in sides)
        return ShadowRatios(list(axis), front, back)


def _usable(center: Any, axis: Any, n: int) -> tuple[Any, Any]:
    """(places of primitives as Mitsuba's interactions, their normals); any for one that is not finite."""
    usable = dr.all(dr.isfinite(center)) & dr.all(dr.isfinite(axis))
    at = dr.zeros(mi.Interaction3f, n)
    at.p = dr.select(usable, center, 0)
    return at, dr.select(usable, axis, mi.Vector3f(0, 0, 1))


def _left_by_surfaces(scene: Any, at: Any, sample: Any, straight: bool) -> Any:
    """Share of the light of a sampled emitter that surfaces let through, mi.Spectrum; ``straight``: some do in part."""
    if straight:
        return transmittance(scene, at, sample.p, sample.pdf > 0)
    return dr.select(scene.ray_test(at.spawn_ray_to(sample.p)), 0, mi.Spectrum(1))


class _Side:
    """Sums over samples for one side of each primitive."""

    def __init__(self, normal: Any, n: int):
        self.normal, self.frame = normal, mi.Frame3f(normal)
        self.E, self.E0 = dr.zeros(mi.Spectrum, n), dr.zeros(mi.Spectrum, n)

    def add_light(self, d: Any, light: Any, left: Any) -> None:
        """Of an emitter in the direction ``d``, divided by the density of its sample; ``left``: by surfaces."""
        light = light * dr.maximum(dr.dot(self.normal, d), 0)
        self.E0 += light
        self.E += light * left

    def add_reflected(self, scene: Any, at: Any, bounces: Any, sampler: Any) -> None:
        """What surfaces send back, from a direction that is chosen by its cosine."""
        d = self.frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        ray = mi.RayDifferential3f(at.spawn_ray(d))
        self.E += dr.pi * bounces.sample(scene, sampler, ray)[0]

    def ratio(self) -> list:
        """E / E0, at most 1; 1 where no light could arrive."""
        return three_channels(dr.select(self.E0 > 0, dr.minimum(self.E / dr.select(self.E0 > 0, self.E0, 1), 1), 1))


def _bounces(max_depth: int) -> Any:
    """The integrator that finds what surfaces reflect along a ray from a primitive, without what emitters send.

    None if that is nothing. ``max_depth``: as in ``estimated``; the ray is the second segment.
    """
    if 0 <= max_depth <= 2:
        return None
    left = max_depth - 1 if max_depth > 0 else -1
    return mi.load_dict({"type": "path", "max_depth": left, "hide_emitters": True})
