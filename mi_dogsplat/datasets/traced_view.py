"""One view of a Mitsuba scene: its picture by the scene's own integrator, and where the things are that it shows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..scene.mitsuba_cameras import camera_to_mitsuba
from ..support.errors import Wrong, interruptible
from ..support.pictures import without_aovs
from ..support.srgb import linear_to_srgb
from .camera_paths import Shot
from .images import straight_color

MAX_ALPHA = 1.001  # 1 up to rounding
MAX_LAYERS = 32  # surfaces that a ray may pass before it counts as lost
SEEDS = 2**32  # of Mitsuba
PASS_SAMPLES = 2**25  # samples of one launch: bounds the memory, and how long Ctrl-C waits


def sensor_of(mi: Any, shot: Shot, alpha: bool) -> Any:
    """A Mitsuba sensor that sees what the shot's camera sees. Pixels are means over their areas."""
    sensor = camera_to_mitsuba(shot.camera, shot.near_clip, shot.far_clip)
    sensor["film"]["pixel_format"] = "rgba" if alpha else "rgb"
    return sensor


def render_shot(mi: Any, scene: Any, shot: Shot, spp: int, seed: int, alpha: bool) -> np.ndarray:
    """Linear radiance float32 [H, W, 3] of what the scene's own integrator shows, or premultiplied [H, W, 4].

    ``spp`` is rounded up to a square number, as the stratified sampler needs; many samples are split into passes.
    Raises ``Wrong`` for values that are not finite, and for an integrator whose alpha is no coverage.
    """
    n_pixels = shot.camera.width * shot.camera.height
    n_passes = math.ceil(n_pixels * spp / PASS_SAMPLES)
    side = math.ceil(math.sqrt(spp / n_passes))
    sensor = sensor_of(mi, shot, alpha)
    sensor["sampler"] = {"type": "multijitter", "sample_count": side**2}
    loaded = mi.load_dict(sensor)
    pixel_format = mi.Bitmap.PixelFormat.RGBA if alpha else mi.Bitmap.PixelFormat.RGB
    linear = np.zeros((shot.camera.height, shot.camera.width, 4 if alpha else 3), np.float32)
    for i in range(n_passes):
        with interruptible():
            mi.render(scene, sensor=loaded, spp=side**2, seed=(seed * n_passes + i) % SEEDS)
        bitmap = without_aovs(loaded.film().bitmap())
        linear += np.array(bitmap.convert(pixel_format, mi.Struct.Type.Float32, False)) / n_passes
    if not np.isfinite(linear).all():
        raise Wrong("renders to NaN or infinity", "correct the scene")
    if not alpha:
        return linear
    if linear[..., 3].max() > MAX_ALPHA:  # particle tracers count particles there
        raise Wrong("has no coverage as alpha", "use an integrator that traces from the camera, or not --alpha")
    return linear


def as_srgb(linear: np.ndarray) -> np.ndarray:
    """sRGB values of linear radiance [H, W, 3], or with straight alpha [H, W, 4] of premultiplied."""
    if linear.shape[2] == 3:
        return linear_to_srgb(linear)
    color, coverage = linear[..., :3], linear[..., 3:]
    straight = linear_to_srgb(straight_color(color, coverage))
    return np.concatenate([straight, np.clip(coverage, 0, 1)], axis=-1)


def first_seen(
    mi: Any, scene: Any, shot: Shot, through_emitters: bool, splats: bool
) -> tuple[np.ndarray, np.ndarray]:
    """What the centres of the pixels see: (points float64 [H, W, 3] in the world, whether there is one [H, W]).

    Of surfaces the first; ``splats``: or where splats before it leave half of the light. Then surfaces are seen only if
    the scene's own integrator shows them.
    """
    points, found = first_surfaces(mi, scene, shot, through_emitters)
    if not splats:
        return points, found
    found &= scene.integrator().sees_surfaces(scene)
    depth, camera = median_depth(mi, scene, shot), shot.camera  # [H, W]
    places = camera.unproject(np.moveaxis(np.indices(depth.shape)[::-1], 0, -1) + 0.5, depth)  # [H, W, 3]
    before = (depth > 0) & (~found | (depth < depth_of(shot, points, found)))
    return np.where(before[..., None], places, points), found | before


def median_depth(mi: Any, scene: Any, shot: Shot) -> np.ndarray:
    """Depth float64 [H, W] of the splats of a scene along the view axis; 0 where they let more than half through.

    They are drawn as the scene's own integrator draws them, which knows splats.
    """
    own = scene.integrator()
    drawn = own.drawn_as(scene)
    integrator = mi.load_dict({
        "type": "dogsplat", "aovs": "median_depth", "near_clip": drawn.near_clip, "antialiased": drawn.antialiased,
        "srgb_primitives": not drawn.linear, "negative_transmittance": own.negative_transmittance,
    })  # fmt: skip
    integrator.warns = False  # of surfaces, which are met apart
    sensor = mi.load_dict(sensor_of(mi, shot, False))
    with interruptible():
        mi.render(scene, sensor=sensor, integrator=integrator, spp=1)
    bitmap = sensor.film().bitmap()
    names = [field.name for field in bitmap.struct_()]
    planes = np.array(bitmap).reshape(shot.camera.height, shot.camera.width, -1)  # [H, W, channels]
    return planes[..., names.index("median_depth.Z")].astype(np.float64)


def first_surfaces(mi: Any, scene: Any, shot: Shot, through_emitters: bool) -> tuple[np.ndarray, np.ndarray]:
    """The surfaces that the centres of the pixels see: (points float64 [H, W, 3], whether there is one [H, W]).

    Rays pass what is rather transparent there (masks, null boundaries of media), and lamps where those are hidden.
    """
    import drjit as dr

    width, height = shot.camera.width, shot.camera.height
    sensor = mi.load_dict(sensor_of(mi, shot, False))
    centers = (np.indices((height, width)).reshape(2, -1)[::-1] + 0.5) / [[width], [height]]  # [2, H W] in 0..1
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(centers.astype(np.float32)), mi.Point2f(0.5))
    points, found, searching = mi.Point3f(0), mi.Bool(False), mi.Bool(True)
    for _ in range(MAX_LAYERS):
        hit = scene.ray_intersect(ray, searching)
        searching = searching & hit.is_valid()
        passes = dr.mean(hit.bsdf(ray).eval_null_transmission(hit, searching)) > 0.5
        if through_emitters:
            passes |= hit.shape.is_emitter()
        here = searching & ~passes
        points = dr.select(here, hit.p, points)
        found |= here
        searching &= passes
        ray = hit.spawn_ray(ray.d)
        dr.eval(points, found, searching, ray)
        if not dr.any(searching):
            break
    positions = np.array(points, dtype=np.float64).T.reshape(height, width, 3)
    return positions, np.array(found).astype(bool).reshape(height, width)


def depth_of(shot: Shot, points: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Depth float32 [H, W] along the view axis, in world units; 0 where nothing is found."""
    depth = points @ shot.camera.w2c[2, :3] + shot.camera.w2c[2, 3]  # [H, W]
    return np.where(found, depth, 0).astype(np.float32)
