"""Rays for tests of tracing, as NumPy arrays and as Mitsuba has them."""

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, device_array, upload
from mi_dogsplat.reference.rays import RayMeetings, gather, meet, transmittance
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.tracing.options import TraceOptions
from mi_dogsplat.tracing.tracer import SplatTracer
from splat_scenes import attached, kernels

MARGIN = 1e-4  # relative, of alphas to the cutoff and of transmittances to theirs: nearer ones may fall on either side


@dataclass
class RaySet:
    """P rays, float32."""

    origins: np.ndarray  # [P, 3]
    directions: np.ndarray  # [P, 3], of any length
    maxt: np.ndarray  # [P]

    @property
    def ray(self) -> mi.Ray3f:
        o, d = ([device_array(column) for column in rows.T] for rows in (self.origins, self.directions))
        ray: Any = mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*d))
        ray.maxt = device_array(self.maxt)
        return ray

    def meet(self, splats: Splats, **options) -> RayMeetings:
        """The twin's answer."""
        return meet(splats, self.origins, self.directions, self.maxt.astype(np.float64), **options)

    def select(self, rows: np.ndarray) -> "RaySet":
        return RaySet(self.origins[rows], self.directions[rows], self.maxt[rows])


def ray_set(origins, directions, maxt: Any = np.inf) -> RaySet:
    origins, directions = np.broadcast_arrays(np.atleast_2d(origins), np.atleast_2d(directions))
    maxt = np.broadcast_to(np.asarray(maxt, np.float32), len(origins))
    return RaySet(origins.astype(np.float32), directions.astype(np.float32), maxt)


def random_rays(n: int, seed: int = 0, bounded: bool = True) -> RaySet:
    """Through what ``random_splats`` makes, from everywhere in and around it; half of them end within it."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform([-2, -2, 0.5], [2, 2, 6], (n, 3))
    directions = rng.uniform([-1.5, -1.2, 1.5], [1.5, 1.2, 5], (n, 3)) - origins
    maxt = np.where(rng.uniform(size=n) < (0.5 if bounded else 0), rng.uniform(0.2, 1.5, n), np.inf)
    return ray_set(origins, directions, maxt)


def tracer_of(splats: Splats, **options) -> SplatTracer:
    return SplatTracer(upload(splats), TraceOptions(splats.sh_degree, **options))


def gathered(tracer: SplatTracer, rays: RaySet, active: Any = True) -> tuple[np.ndarray, np.ndarray]:
    """(colours [P, 3], transmittance [P])"""
    colors, T = tracer.gather(rays.ray, active)
    return np.stack([c.numpy() for c in colors], -1), T.numpy()


def decided(splats: Splats, rays: RaySet, **options) -> np.ndarray:
    """[P] whether no cutoff hangs on the rounding of float32, neither of an alpha nor of the transmittance."""
    near = np.abs(np.abs(rays.meet(splats, smooth=True).alphas) * 255 - 1).min(axis=1) < MARGIN
    meetings = rays.meet(splats)
    order = np.argsort(np.where(meetings.alphas != 0, meetings.places, np.inf), axis=1)
    hidden = np.take_along_axis(meetings.alphas, order, 1)
    if not options.get("negative_transmittance", True):
        hidden = np.maximum(hidden, 0)
    T = np.cumprod(1 - hidden, axis=1)
    return ~near & (np.abs(T / 1e-4 - 1).min(axis=1) > MARGIN)


def traced_as_the_twin(splats: Splats, rays: RaySet, **options) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(colours [P, 3], transmittance [P], that of shadow rays [P]), those of the twin where they are ``decided``."""
    sure, tracer, meetings = decided(splats, rays, **options), tracer_of(splats, **options), rays.meet(splats)
    (colors, T), shadow = gathered(tracer, rays), tracer.transmittance(rays.ray).numpy()
    expected, expected_T = gather(meetings, **options)
    np.testing.assert_allclose(colors[sure], expected[sure], atol=2e-5, rtol=1e-4)
    np.testing.assert_allclose(T[sure], expected_T[sure], atol=2e-6, rtol=1e-4)
    np.testing.assert_allclose(shadow[sure], transmittance(meetings, **options)[sure], atol=2e-6, rtol=1e-4)
    return colors, T, shadow


def kernels_of_tracing(splats: Splats, rays: RaySet) -> set[str]:
    """Hashes of the kernels that colours, transmittances and the gradients of what all primitives have take."""

    def run() -> None:
        params = attached(splats)
        colors, T = SplatTracer(params, TraceOptions(1)).gather(rays.ray)
        dr.backward(dr.sum(sum(colors) + T))
        dr.eval([dr.grad(params[name]) for name in (*RAW, *RAW_DOG)])

    run()
    return kernels(run)
