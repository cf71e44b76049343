"""How far the surface is that a pixel sees: along its ray, in the primitive that stops half of the light.

The AOV ``median_depth`` is the depth of that primitive's centre, so that a floor is a stair of discs. Here it is the
depth at which the ray through the middle of the pixel has the most of it (Yu et al. 2024, GOF, Sec. 3.2; for a flat
disc, where the ray meets its plane). With A = S⁻¹ Rᵀ, which turns the primitive into a unit sphere, its centre m and
the ray z r, r = (x/z, y/z, 1), in camera space, |A (z r - m)| is least at

    z = (A r · A m) / (A r · A r).

A ray that passes by, in the skirt of the primitive on the screen, may have that far from it. So z is kept within three
of its standard deviations along the axis, and in front of the near plane.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .arrays import detached
from .device_camera import DeviceCamera
from .project import rotation_matrix
from .rasterize import Frame
from .rows import read_row
from .walks.aovs import composite_aovs

DEVIATIONS = 3.0
MAX_FLATNESS = 1e4  # a shorter axis counts as this part of the longest one: squares stay in range


def median_surface(params: dict, camera: DeviceCamera, frame: Frame) -> mi.Float:
    """[H*W] depth along the optical axis, world units; 0 where T stays above 1/2. It has no derivative.

    Args:
        params: raw parameters as flat arrays, see ``project``; fewer than 2^24 primitives.
        camera: the view, a pinhole.
        frame: what ``rasterize`` made of both.
    """
    if frame.projection is None or frame.view is None:
        return dr.zeros(mi.Float, camera.width * camera.height)
    count = dr.width(params["logit_opacities"])
    # in the place of depths, of which 0 says that there is none
    numbered = detached(mi.Float(dr.arange(mi.UInt32, count) + 1))
    (number,) = composite_aovs(frame.view, ("median_depth",), numbered)
    number = mi.Float(number)
    seen = number > 0
    splat = mi.UInt32(dr.select(seen, number, 1)) - 1

    pixel = dr.arange(mi.UInt32, camera.width * camera.height)
    width = dr.opaque(mi.UInt32, camera.width)  # a number in the kernel would be another kernel for each size
    column, row = pixel % width, pixel // width
    ray = (mi.Float(column) + 0.5 - camera.cx) / camera.fx, (mi.Float(row) + 0.5 - camera.cy) / camera.fy, mi.Float(1)
    projection = dr.detach(frame.projection)
    x, y, z = (dr.gather(mi.Float, values, splat, seen) for values in (projection.x, projection.y, projection.depth))
    centre = (x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z

    quats, log_scales = (
        [mi.Float(value) for value in read_row(detached(params[name]), detached(splat), count, count, detached(seen))]
        for name, count in (("quats", 4), ("log_scales", 3))
    )
    longest = dr.maximum(dr.maximum(log_scales[0], log_scales[1]), log_scales[2])
    scales = [dr.maximum(dr.exp(s - longest), 1 / MAX_FLATNESS) for s in log_scales]  # of the longest
    R = rotation_matrix(quats)
    turned = [[sum(camera.rotation[k][c] * R[c][a] for c in range(3)) for k in range(3)] for a in range(3)]  # axis a
    along_ray = [_dot(axis, ray) / scale for axis, scale in zip(turned, scales, strict=True)]
    to_centre = [_dot(axis, centre) / scale for axis, scale in zip(turned, scales, strict=True)]
    found = _dot(along_ray, to_centre) / _dot(along_ray, along_ray)
    deviation = dr.exp(longest) * dr.sqrt(sum(dr.square(axis[2] * s) for axis, s in zip(turned, scales, strict=True)))
    found = dr.clip(found, z - DEVIATIONS * deviation, z + DEVIATIONS * deviation)
    return dr.select(seen, dr.maximum(found, camera.near_clip), 0)


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
