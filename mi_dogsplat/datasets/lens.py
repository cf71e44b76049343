"""Lens distortion, and its removal: photographs are resampled to those of a pinhole when they are loaded.

Notation: (u, v) a ray's pinhole coordinates x/z and y/z, r its length, θ = atan r; (u', v') where the lens puts it. The
models and the order of their parameters are COLMAP's ("Camera Models"), which shares them with OpenCV:

    radial      u' = u (1 + k1 r² + k2 r⁴)
    OPENCV      the same, and + 2 p1 u v + p2 (r² + 2 u²) in u', + 2 p2 u v + p1 (r² + 2 v²) in v'
    FULL_OPENCV as OPENCV, but (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
    fisheye     u' = u θ/r (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter, minimum_filter, spline_filter

from ..scene.cameras import Camera

MAX_GROWTH = 2.0  # of width and height of the pinhole's image: what a fisheye sees beyond is stretched too far
MAX_COEFFICIENT = 1e6  # those of real lenses are below 10
NEWTON_STEPS = 30
EDGE = 64  # points per side of the border
BAND = 256  # rows that are resampled at a time, so that memory stays small


@dataclass(frozen=True)
class Lens:
    """Coefficients as above; ``radial`` k1, k2, ..., ``tangential`` p1, p2, ``divisor`` k4, k5, k6 of FULL_OPENCV."""

    radial: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)
    fisheye: bool = False
    divisor: tuple[float, ...] = ()

    @property
    def straight(self) -> bool:
        """A pinhole. A fisheye is none even if all of its coefficients are 0."""
        return not (self.fisheye or any(self.radial) or any(self.tangential) or any(self.divisor))

    def distort(self, rays: np.ndarray) -> np.ndarray:
        """(u, v) [..., 2] to (u', v') [..., 2]."""
        u, v = rays[..., 0], rays[..., 1]
        r2 = u * u + v * v
        r = np.sqrt(r2)
        angle = np.arctan(r) if self.fisheye else r
        factor = sum((k * angle ** (2 * i) for i, k in enumerate(self.radial, 1)), np.ones_like(r))
        if any(self.divisor):
            factor = factor / sum((k * r ** (2 * i) for i, k in enumerate(self.divisor, 1)), np.ones_like(r))
        if self.fisheye:
            factor = factor * np.divide(angle, r, out=np.ones_like(r), where=r > 0)
        p1, p2 = self.tangential
        return np.stack(
            [
                u * factor + 2 * p1 * u * v + p2 * (r2 + 2 * u * u),
                v * factor + 2 * p2 * u * v + p1 * (r2 + 2 * v * v),
            ],
            axis=-1,
        )

    @np.errstate(over="ignore", invalid="ignore")  # of points out of all reason, for which no ray is found
    def undistort(self, points: np.ndarray) -> np.ndarray:
        """(u', v') [..., 2] to (u, v) [..., 2] by Newton's method; NaN where no ray of a pinhole arrives there."""
        r = np.linalg.norm(points, axis=-1, keepdims=True)
        largest = self.largest_radius
        rays = np.array(points, np.float64)
        if self.fisheye:  # start from the equidistant lens
            angle = np.minimum(r, 1.4)
            rays = rays * np.divide(np.tan(angle), r, out=np.ones_like(r), where=r > 0)
        for _ in range(NEWTON_STEPS):
            error = self.distort(rays) - points
            size = 1e-6 * (1 + np.linalg.norm(rays, axis=-1, keepdims=True))
            du = (self.distort(rays + size * (1, 0)) - self.distort(rays - size * (1, 0))) / (2 * size)
            dv = (self.distort(rays + size * (0, 1)) - self.distort(rays - size * (0, 1))) / (2 * size)
            det = du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]
            det = np.where(np.abs(det) > 1e-12, det, 1e-12)
            step = np.stack(
                [
                    dv[..., 1] * error[..., 0] - dv[..., 0] * error[..., 1],
                    du[..., 0] * error[..., 1] - du[..., 1] * error[..., 0],
                ],
                axis=-1,
            )
            rays = rays - step / det[..., None]
            length = np.linalg.norm(rays, axis=-1, keepdims=True)
            rays = rays * np.minimum(1, largest / np.maximum(length, 1e-12))
        found = np.linalg.norm(self.distort(rays) - points, axis=-1, keepdims=True) < 1e-6
        return np.where(found, rays, np.nan)

    @property
    def largest_radius(self) -> float:
        """r up to which r' grows: beyond, a second ray arrives at the same place."""
        r = np.concatenate([np.linspace(0, 4, 4001), np.geomspace(4, 50, 200)[1:]])
        across = Lens(self.radial, fisheye=self.fisheye, divisor=self.divisor).distort(np.stack([r, 0 * r], -1))[:, 0]
        falls = np.flatnonzero(np.diff(across) <= 0)
        return float(r[falls[0]]) if len(falls) else float(r[-1])


@dataclass(frozen=True, eq=False)
class Undistortion:
    """How images by a lens become those of the pinhole ``camera``, whose pixels all lie inside of the photograph."""

    camera: Camera
    lens: Lens
    source: Camera  # intrinsics of the photograph

    def source_pixels(self, band: slice = slice(None)) -> np.ndarray:
        """[H, W, 2] (x, y) in the photograph of the centres of the pinhole's pixels; of a ``band`` of rows."""
        camera, source = self.camera, self.source
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height)[band] + 0.5)
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy], -1)
        return self.lens.distort(rays) * (source.fx, source.fy) + (source.cx, source.cy)

    def image(self, pixels: np.ndarray, unlimited: bool = False) -> np.ndarray:
        """A photograph [H, W, C] resampled by cubic splines: float32 [H', W', C], between the limits of the input.

        ``unlimited``: of radiance, whose lamps may be so bright that splines ring around them, brighter than what is
        there. Each value is between those of the four pixels around it then.
        """
        planes = np.moveaxis(pixels, -1, 0)
        limits = [_limits(plane) if unlimited else (plane.min(), plane.max()) for plane in planes]
        splines = [spline_filter(plane, mode="mirror").astype(np.float32) for plane in planes]
        result = np.empty((self.camera.height, self.camera.width, len(splines)), np.float32)
        for top in range(0, self.camera.height, BAND):
            x, y = np.moveaxis(self.source_pixels(slice(top, top + BAND)), -1, 0) - 0.5
            for c, (spline, (low, high)) in enumerate(zip(splines, limits, strict=True)):
                sampled = map_coordinates(spline, (y, x), np.float32, mode="mirror", prefilter=False)
                if unlimited:
                    corner = np.floor((y, x))
                    low, high = (map_coordinates(e, corner, np.float32, 0, mode="nearest") for e in (low, high))
                result[top : top + BAND, :, c] = np.clip(sampled, low, high)
        return result

    def points(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels [M, 2] of the photograph to those of the pinhole; NaN where no ray of a pinhole arrives there."""
        source, camera = self.source, self.camera
        rays = self.lens.undistort((pixels - (source.cx, source.cy)) / (source.fx, source.fy))
        return rays * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def _limits(plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values [H, W] of each pixel, the one to its right, and those below the two."""
    return minimum_filter(plane, 2, origin=-1), maximum_filter(plane, 2, origin=-1)


def undistortion(source: Camera, lens: Lens) -> Undistortion:
    """The pinhole of the same pose and focal length that sees the largest rectangle inside of the photograph.

    source: intrinsics and size of the photograph, and its pose. Raises ``ValueError`` where no such rectangle is left.
    """
    rectangle = _largest_rectangle(source.fx, source.fy, source.cx, source.cy, source.width, source.height, lens)
    return Undistortion(Camera(source.w2c, source.fx, source.fy, *rectangle), lens, source)


@lru_cache(maxsize=256)  # the photographs of a capture share a lens, and it takes as long as to read one
@np.errstate(over="ignore", invalid="ignore")  # of a principal point out of all reason, for which nothing is left
def _largest_rectangle(
    fx: float, fy: float, cx: float, cy: float, width: int, height: int, lens: Lens
) -> tuple[float, float, int, int]:
    """Principal point and size of that pinhole, from the intrinsics and the size of the photograph."""
    if not all(abs(k) <= MAX_COEFFICIENT for k in (*lens.radial, *lens.tangential, *lens.divisor)):  # NaN is not
        raise ValueError(f"the lens {lens} has coefficients that no lens has")
    along = np.linspace(0, 1, EDGE)
    zero, one = np.zeros(EDGE), np.ones(EDGE)
    left, right, top, bottom = (
        lens.undistort((np.stack(side, -1) * (width, height) - (cx, cy)) / (fx, fy))
        for side in ((zero, along), (one, along), (along, zero), (along, one))
    )  # [EDGE, 2] each; a part of the border that no pinhole sees limits nothing
    limits = np.array(
        [
            [np.nanmax(left[:, 0], initial=-np.inf), np.nanmin(right[:, 0], initial=np.inf)],
            [np.nanmax(top[:, 1], initial=-np.inf), np.nanmin(bottom[:, 1], initial=np.inf)],
        ]
    )  # [axis, low and high], in pinhole coordinates
    focal, center, size = np.array([fx, fy]), np.array([cx, cy]), np.array([width, height])
    widest = lens.largest_radius / np.sqrt(2)
    # px from the principal point, which may be outside of a photograph that was cut out of a larger one
    first, last = (np.stack([end * MAX_GROWTH, end / MAX_GROWTH]) for end in (-center, size - center))
    low = np.maximum(np.maximum(limits[:, 0], -widest) * focal, first.min(axis=0))
    high = np.minimum(np.minimum(limits[:, 1], widest) * focal, last.max(axis=0))
    across, down = (int(n) for n in np.floor(np.clip(high - low, 0, MAX_GROWTH * max(width, height)) + 1e-6))
    is_inside = (0 < center) & (center < size)
    if min(across, down) < 1 or not (~is_inside | ((low < 0) & (high > 0))).all():
        raise ValueError(f"the lens {lens} leaves no pinhole image of a {width}x{height} photograph")
    return float(-low[0]), float(-low[1]), across, down
