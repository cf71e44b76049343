"""Stage 1, *project*: 3D primitives to 2D kernels on the image plane, one lane per primitive (EWA splatting).

Notation (Kerbl et al. 2023; method paper, Sec. 3)
    μ, R, s     centre, rotation, scales of a primitive; Σ = R S Sᵀ Rᵀ
    W, t        rotation and translation of the camera (OpenCV: x right, y down, z forward)
    J           Jacobian of the pinhole projection at the centre, evaluated inside 1.3 x the field of view
    Σ'          screen covariance J W Σ Wᵀ Jᵀ + 0.3 I, in px²
    p(d)        log2 of a kernel's value at offset d = pixel - μ' :  A dx² + B dx dy + C dy² + lo

The quadratic form is kept in units of log2 with the opacity folded in as ``lo``: the compositor then needs neither a
multiplication by the opacity nor a change of base, and logit opacities of any magnitude stay finite.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .cameras import Camera
from .sh import evaluate_sh, read_rows

LOW_PASS = 0.3  # px², added to the diagonal of Σ' so that no primitive falls between the pixels
LOG2_E = 1.4426950408889634
NOT_DOG = 0xFFFFFFFF  # row of a primitive without a pseudo-Gaussian


@dataclass
class DeviceCamera:
    """A pinhole camera as opaque JIT scalars: one compiled kernel serves every camera and every image size."""

    rotation: list  # W, 3 x 3
    translation: list  # t, 3
    position: list  # camera centre in world space, 3
    fx: mi.Float
    fy: mi.Float
    cx: mi.Float
    cy: mi.Float
    limits: list  # x/z and y/z are clamped to [-left, right] x [-top, bottom] in J
    near_clip: mi.Float
    width: int
    height: int
    numbers: tuple  # all of the above on the host

    @staticmethod
    def upload(
        camera: Camera, near_clip: float = 0.2, film: tuple[float, float, float, float] | None = None
    ) -> DeviceCamera:
        """Host camera to device.

        ``film`` is the rectangle (left, top, right, bottom), in pixels of the camera, outside of which J is clamped:
        the whole image, of which the camera may see a crop window only. None: the camera's image.
        """
        x0, y0, x1, y1 = film or (0, 0, camera.width, camera.height)
        margin_x, margin_y = 0.15 * (x1 - x0) / camera.fx, 0.15 * (y1 - y0) / camera.fy
        numbers = [
            *camera.w2c[:3, :3].ravel(), *camera.w2c[:3, 3], *camera.position,
            camera.fx, camera.fy, camera.cx, camera.cy,
            (camera.cx - x0) / camera.fx + margin_x, (x1 - camera.cx) / camera.fx + margin_x,
            (camera.cy - y0) / camera.fy + margin_y, (y1 - camera.cy) / camera.fy + margin_y,
            near_clip,
        ]  # fmt: skip
        numbers = tuple(float(x) for x in numbers)
        packed = mi.Float(numbers)
        v = [dr.gather(mi.Float, packed, k) for k in range(len(numbers))]
        dr.eval(v)  # one launch makes them opaque
        rotation = [v[0:3], v[3:6], v[6:9]]
        size = camera.width, camera.height
        return DeviceCamera(rotation, v[9:12], v[12:15], *v[15:19], v[19:23], v[23], *size, (*numbers, *size))


@dataclass
class Kernels:
    """2D kernels on the image plane, R rows: p(d) = A dx² + B dx dy + C dy² + lo (log2 of the value)."""

    A: mi.Float
    B: mi.Float
    C: mi.Float
    lo: mi.Float
    variance_x: mi.Float  # Σ'_xx
    variance_y: mi.Float  # Σ'_yy


@dataclass
class Projection:
    """What the later stages need of N primitives; ``pseudo`` has one row per DoG primitive, or is None."""

    x: mi.Float  # centre in pixels
    y: mi.Float
    depth: mi.Float  # z in camera space
    kernels: Kernels
    colors: list  # 3 channels, max(0, SH + 0.5)
    visible: mi.Bool
    pseudo: Kernels | None
    dog_row: mi.UInt32 | None  # [N] row in ``pseudo`` or NOT_DOG
    dog_index: mi.UInt32 | None  # [M] its inverse


def rows(array: mi.Float, count: int, index: mi.UInt32, active=True) -> list[mi.Float]:
    """Row ``index`` of a row-major [*, count] array, as ``count`` arrays. Each row may be read by one lane only."""
    return [
        dr.gather(mi.Float, array, dr.fma(index, count, k), active, mode=dr.ReduceMode.Permute)
        for k in range(count)
    ]


def rotation_matrix(q: list[mi.Float]) -> list[list[mi.Float]]:
    """Rotation of a quaternion (x, y, z, w) of any length; the zero quaternion is the identity."""
    norm2 = dr.fma(q[0], q[0], dr.fma(q[1], q[1], dr.fma(q[2], q[2], q[3] * q[3])))
    usable = (norm2 > 0) & dr.isfinite(norm2)
    inv = dr.select(usable, dr.rsqrt(dr.select(usable, norm2, 1)), 0)
    x, y, z = q[0] * inv, q[1] * inv, q[2] * inv
    w = dr.select(usable, q[3] * inv, 1)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def softplus(x: mi.Float) -> mi.Float:
    """log(1 + e^x) without overflow; -softplus(-x) is the log of the sigmoid, finite for every finite logit."""
    positive = x > 0  # not max(x, 0) and |x|: their derivatives would add up to 0 instead of 1/2 at x = 0
    return dr.select(positive, x, 0) + dr.log(1 + dr.exp(dr.select(positive, -x, x)))


def _screen_kernels(axes, scales, log2_opacity, antialiased: bool) -> Kernels:
    """2D kernel of the 3D Gaussian whose scaled axes project to the columns of ``axes`` x ``scales``."""
    v0 = [a * s for a, s in zip(axes[0], scales, strict=True)]  # J W R S, first row
    v1 = [a * s for a, s in zip(axes[1], scales, strict=True)]
    raw_xx = v0[0] * v0[0] + v0[1] * v0[1] + v0[2] * v0[2]
    raw_yy = v1[0] * v1[0] + v1[1] * v1[1] + v1[2] * v1[2]
    xy = v0[0] * v1[0] + v0[1] * v1[1] + v0[2] * v1[2]
    # det(V Vᵀ) as a sum of squared minors (Cauchy-Binet): xx yy - xy² would cancel to noise on needles
    m0, m1, m2 = v0[1] * v1[2] - v0[2] * v1[1], v0[2] * v1[0] - v0[0] * v1[2], v0[0] * v1[1] - v0[1] * v1[0]
    raw_det = m0 * m0 + m1 * m1 + m2 * m2
    det = raw_det + LOW_PASS * (raw_xx + raw_yy) + LOW_PASS * LOW_PASS
    if antialiased:
        log2_opacity = log2_opacity + 0.5 * dr.log2(dr.maximum(2.5e-5, raw_det / det))
    xx, yy = raw_xx + LOW_PASS, raw_yy + LOW_PASS
    k = -0.5 * LOG2_E / det
    return Kernels(k * yy, -2 * k * xy, k * xx, log2_opacity, xx, yy)


def project(params: dict, camera: DeviceCamera, *, sh_degree: int, antialiased: bool = False) -> Projection:
    """Project N primitives; differentiable with respect to every parameter.

    Args:
        params: raw parameters as flat row-major ``mi.Float`` arrays, keys as in ``mi.traverse`` of the ``dog`` shape;
            ``dog_row`` [N] and ``dog_index`` [M] are present when a primitive is DoG.
        camera: the view.
        sh_degree: highest degree evaluated (at most the degree stored).
        antialiased: scale opacities by the area that the low-pass filter adds (Mip-Splatting's 2D filter).
    """
    n = dr.width(params["logit_opacities"])
    index = dr.arange(mi.UInt32, n)
    W, t = camera.rotation, camera.translation

    mean = rows(params["means"], 3, index)
    px, py, depth = (
        dr.fma(W[r][0], mean[0], dr.fma(W[r][1], mean[1], dr.fma(W[r][2], mean[2], t[r]))) for r in range(3)
    )
    visible = (depth > camera.near_clip) & dr.isfinite(depth)
    inv_z = dr.rcp(dr.select(visible, depth, 1))
    u, v = px * inv_z, py * inv_z  # tangents of the viewing angles
    x, y = dr.fma(camera.fx, u, camera.cx), dr.fma(camera.fy, v, camera.cy)

    left, right, top, bottom = camera.limits
    u = dr.clip(u, -left, right)
    v = dr.clip(v, -top, bottom)
    jx, jy = camera.fx * inv_z, camera.fy * inv_z
    JW = [
        [jx * (W[0][c] - u * W[2][c]) for c in range(3)],
        [jy * (W[1][c] - v * W[2][c]) for c in range(3)],
    ]

    R = rotation_matrix(read_rows(params["quats"], 4, 4, index))
    axes = [[JW[r][0] * R[0][c] + JW[r][1] * R[1][c] + JW[r][2] * R[2][c] for c in range(3)] for r in range(2)]
    scales = [dr.exp(s) for s in rows(params["log_scales"], 3, index)]
    log2_opacity = -LOG2_E * softplus(-params["logit_opacities"])
    kernels = _screen_kernels(axes, scales, log2_opacity, antialiased)
    visible &= dr.isfinite(x) & dr.isfinite(y) & dr.isfinite(kernels.A + kernels.B + kernels.C)

    pseudo, dog_row, dog_index = None, None, None
    if "dog_index" in params:
        dog_row, dog_index = params["dog_row"], params["dog_index"]

        def of(value):
            return dr.gather(mi.Float, value, dog_index, mode=dr.ReduceMode.NoConflicts)

        m = dr.arange(mi.UInt32, dr.width(dog_index))
        factors = [dr.exp(f) for f in rows(params["dog_log_scales"], 3, m)]
        pseudo = _screen_kernels(
            [[of(a) for a in row] for row in axes],
            [of(s) * f for s, f in zip(scales, factors, strict=True)],
            of(log2_opacity) - LOG2_E * softplus(-params["dog_logit_opacities"]),
            antialiased,
        )

    direction = [mean[c] - camera.position[c] for c in range(3)]
    colors = evaluate_sh(params, direction, index, visible, sh_degree)
    visible &= dr.isfinite(colors[0] + colors[1] + colors[2])
    return Projection(x, y, depth, kernels, colors, visible, pseudo, dog_row, dog_index)
