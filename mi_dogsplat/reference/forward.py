"""The rasteriser once more, in plain float64 NumPy: the oracle that the fast stages are tested against.

Same stages, same argument order as the engine (project -> tiles -> composite), written for reading.
`render` needs no tiles at all: it evaluates every primitive at every pixel, so it checks the tile lists as
well.

Notation. A primitive has the centre mu, the rotation R, the scales s and Sigma = R S S^T R^T. W is the
rotation of the camera, J the Jacobian of the perspective projection at mu, and Sigma' = J W Sigma W^T J^T +
0.3 I its covariance in pixels (EWA splatting). A DoG primitive is primary minus pseudo: the pseudo-Gaussian
has the same centre, rotation and colour, the opacity f_a o and the scales F s. `alpha` is what gets
composited and may be negative. Symmetric 2x2 matrices are stored as rows (xx, xy, yy). The pixel in column
i, row j has its centre at (i + .5, j + .5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np

from .mixed_sh import group_names, padded_sh, sh_groups

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats

LOW_PASS = 0.3  # px^2, added to the diagonal of every screen covariance
MIN_ALPHA = 1 / 255  # weaker contributions are skipped
# The nearest float32, as the engine has it: behind two saturated primitives T = (1 - .99)^2 lies on the stop
# threshold, and the rounding of this constant alone decides between stopping and blending one more.
MAX_ALPHA = float(np.float32(0.99))
MIN_T = 1e-4  # the walk stops before the transmittance falls below this
MAX_T = 2.0**30  # and before negative alphas take it above this
MIN_ANTIALIAS_RATIO = 2.5e-5

RAW_PARAMETERS = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs",
                  "dog_logit_opacities", "dog_log_scales")


@dataclass
class Projection:
    """All primitives as one camera sees them, float64; rows are zero where `visible` is false."""

    visible: np.ndarray  # [N] bool, in front of the near plane and everything finite (but for logit opacities)
    means2d: np.ndarray  # [N, 2] px
    depths: np.ndarray  # [N] camera z of the centre
    cov2d: np.ndarray  # [N, 3] px^2, with the low-pass
    conics: np.ndarray  # [N, 3] inverse of cov2d
    opacities: np.ndarray  # [N] with the antialias factor, if any
    colors: np.ndarray  # [N, 3]
    dog: np.ndarray  # [N] bool; the pseudo_* rows are zero where false
    pseudo_cov2d: np.ndarray  # [N, 3]
    pseudo_conics: np.ndarray  # [N, 3]
    pseudo_opacities: np.ndarray  # [N]
    extents: np.ndarray  # [N, 2] px, half size of the box around {G or G_p >= 1/255}; 0 where that is empty


def sh_basis(dirs: np.ndarray, degree: int) -> np.ndarray:
    """Real spherical harmonics of unit vectors [N, 3], signs and order as in 3DGS -> [N, (degree + 1)^2].

    Within a degree the order is m = -l..l; odd m carry the Condon-Shortley sign. Orthonormal on the sphere.
    """
    if not 0 <= degree <= 3:
        raise ValueError(f"sh_basis: degree is {degree}; 0, 1, 2 and 3 exist")
    x, y, z = dirs.T
    xx, yy, zz, pi = x * x, y * y, z * z, np.pi
    c1 = np.sqrt(3 / (4 * pi))
    c2, c20 = np.sqrt(15 / (4 * pi)), np.sqrt(5 / (16 * pi))
    c33, c32, c31, c30 = np.sqrt(np.array([35 / 32, 105 / 4, 21 / 32, 7 / 16]) / pi)
    basis = [np.full_like(x, np.sqrt(1 / (4 * pi)))]
    if degree >= 1:
        basis += [-c1 * y, c1 * z, -c1 * x]
    if degree >= 2:
        basis += [c2 * x * y, -c2 * y * z, c20 * (2 * zz - xx - yy), -c2 * x * z, c2 / 2 * (xx - yy)]
    if degree >= 3:
        basis += [-c33 * y * (3 * xx - yy), c32 * x * y * z, -c31 * y * (4 * zz - xx - yy),
                  c30 * z * (2 * zz - 3 * xx - 3 * yy),
                  -c31 * x * (4 * zz - xx - yy), c32 / 2 * z * (xx - yy), -c33 * x * (xx - 3 * yy)]
    return np.stack(basis, axis=1)


def rotations(quats: np.ndarray) -> np.ndarray:
    """Rotation matrices [N, 3, 3] of quaternions [N, 4] (x, y, z, w) of any length; 0 gives the identity."""
    length = np.linalg.norm(quats, axis=1, keepdims=True)
    unit = np.where(length > 0, quats / np.where(length > 0, length, 1), [0, 0, 0, 1])
    v, w = unit[:, :3], unit[:, 3, None, None]
    cross = np.cross(v[:, None, :], np.eye(3)[None]).swapaxes(1, 2)  # [N, 3, 3], cross @ u = v x u
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def sigmoid(x: np.ndarray) -> np.ndarray:
    """The logistic function; small values keep their relative precision."""
    return np.exp(-np.logaddexp(0, -x))


def _covariance(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From A = J W R S [N, 2, 3]: Sigma' = A A^T + 0.3 I [N, 3], its inverse, the antialias factor [N].

    det A A^T is the squared length of the cross product of the rows of A (Lagrange): for needle-shaped
    primitives xx yy - xy^2 would cancel.
    """
    xx, xy, yy = (A[:, 0] ** 2).sum(1), (A[:, 0] * A[:, 1]).sum(1), (A[:, 1] ** 2).sum(1)
    det_raw = (np.cross(A[:, 0], A[:, 1]) ** 2).sum(1)
    det = det_raw + LOW_PASS * (xx + yy) + LOW_PASS**2
    xx, yy = xx + LOW_PASS, yy + LOW_PASS
    cov2d = np.stack([xx, xy, yy], axis=1)
    conics = np.stack([yy, -xy, xx], axis=1) / det[:, None]
    return cov2d, conics, np.sqrt(np.maximum(MIN_ANTIALIAS_RATIO, det_raw / det))


def _extents(cov2d: np.ndarray, opacities: np.ndarray) -> np.ndarray:
    """Half size [N, 2] of the box around {o exp(-d^T conic d / 2) >= 1/255}; 0 where o is below 1/255."""
    t = 2 * np.log(np.maximum(opacities / MIN_ALPHA, 1))
    return np.sqrt(t[:, None] * cov2d[:, [0, 2]])


def _finite_parameters(splats: Splats, sh: np.ndarray) -> np.ndarray:
    """[N] no parameter in use is NaN or infinite, `sh` those of the colour; logit opacities may be infinite."""
    raw = [splats.means, splats.log_scales, splats.quats, sh]
    finite = np.logical_and.reduce([np.isfinite(r).all(axis=tuple(range(1, r.ndim))) for r in raw])
    finite &= ~np.isnan(splats.logit_opacities)
    dog = np.asarray(splats.dog_index, np.int64)
    finite[dog] &= np.isfinite(splats.dog_log_scales).all(1) & ~np.isnan(splats.dog_logit_opacities)
    return finite


@np.errstate(all="ignore")  # what is not finite or not in front of the camera is computed, then discarded
def project(splats: Splats, camera: Camera, *, near_clip: float = 0.2, antialiased: bool = False,
            sh_degree: int | None = None) -> Projection:
    """Project primitives into a camera; `sh_degree` uses that many degrees only (None: all there are).

    Raises ValueError if `sh_degree` exceeds what the primitives have.
    """
    means, sh = np.asarray(splats.means, np.float64), padded_sh(splats)
    scales = np.exp(np.asarray(splats.log_scales, np.float64))
    n, degree = len(means), int(np.sqrt(sh.shape[1])) - 1
    if sh_degree is not None and sh_degree > degree:
        raise ValueError(f"project: sh_degree is {sh_degree}, the splats have {degree}; ask for at most that")
    degree = degree if sh_degree is None else sh_degree
    W, t = camera.w2c[:3, :3], camera.w2c[:3, 3]

    x, y, z = (means @ W.T + t).T
    means2d = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=1)
    # Far outside the image the linearisation explodes: take J at most 15 % of an image outside.
    margin_x, margin_y = 0.15 * camera.width, 0.15 * camera.height
    cx, cy = camera.cx, camera.cy
    u = np.clip(x / z, -(cx + margin_x) / camera.fx, (camera.width - cx + margin_x) / camera.fx)
    v = np.clip(y / z, -(cy + margin_y) / camera.fy, (camera.height - cy + margin_y) / camera.fy)
    J = np.zeros((n, 2, 3))
    J[:, 0, 0], J[:, 0, 2] = camera.fx / z, -camera.fx * u / z
    J[:, 1, 1], J[:, 1, 2] = camera.fy / z, -camera.fy * v / z
    JWR = J @ W @ rotations(np.asarray(splats.quats, np.float64))  # [N, 2, 3]

    cov2d, conics, factor = _covariance(JWR * scales[:, None, :])
    raw_opacities = sigmoid(np.asarray(splats.logit_opacities, np.float64))
    opacities = raw_opacities * factor if antialiased else raw_opacities

    dog, pseudo_opacities = np.zeros(n, bool), np.zeros(n)
    pseudo_cov2d, pseudo_conics = np.zeros((n, 3)), np.zeros((n, 3))
    i = np.asarray(splats.dog_index, np.int64)  # [M]
    f_a = sigmoid(np.asarray(splats.dog_logit_opacities, np.float64))  # [M]
    F = np.exp(np.asarray(splats.dog_log_scales, np.float64))  # [M, 3]
    pseudo_cov2d[i], pseudo_conics[i], pseudo_factor = _covariance(JWR[i] * (F * scales[i])[:, None, :])
    pseudo_opacities[i] = f_a * raw_opacities[i] * (pseudo_factor if antialiased else 1)
    dog[i] = True

    dirs = means + W.T @ t  # from the camera centre -W^T t, world space
    dirs /= np.linalg.norm(dirs, axis=1, keepdims=True)
    basis = sh_basis(dirs, degree)  # [N, K]
    sh = sh[:, :basis.shape[1]]
    colors = np.maximum(0, np.einsum("nk,nkc->nc", basis, sh) + 0.5)

    extents = np.maximum(_extents(cov2d, opacities), _extents(pseudo_cov2d, pseudo_opacities))
    rows = [means2d, z, cov2d, conics, opacities, colors, pseudo_cov2d, pseudo_conics,
            pseudo_opacities, extents]
    visible = (z > near_clip) & np.isfinite(np.column_stack(rows)).all(axis=1) & _finite_parameters(splats, sh)
    for row in rows:
        row[~visible] = 0
    return Projection(visible, means2d, z, cov2d, conics, opacities, colors, dog & visible, pseudo_cov2d,
                      pseudo_conics, pseudo_opacities, extents)


def depth_order(projection: Projection) -> np.ndarray:
    """Indices of the visible primitives, nearest first; equal depths keep the order of their indices."""
    order = np.argsort(projection.depths, kind="stable")
    return order[projection.visible[order]]


def kernels(projection: Projection, i: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """G and G_p of primitive i at the points (x, y), not yet limited to .99; G_p is 0 for a Gaussian."""
    dx, dy = x - projection.means2d[i, 0], y - projection.means2d[i, 1]

    def gaussian(opacity, conic):
        return opacity * np.exp(-0.5 * (conic[0] * dx * dx + 2 * conic[1] * dx * dy + conic[2] * dy * dy))

    G = gaussian(projection.opacities[i], projection.conics[i])
    if not projection.dog[i]:
        return G, np.zeros_like(G)
    return G, gaussian(projection.pseudo_opacities[i], projection.pseudo_conics[i])


def pixel_centres(x0: int, y0: int, x1: int, y1: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres (x, y) of the pixels in columns x0..x1-1 and rows y0..y1-1, row by row."""
    y, x = np.mgrid[y0:y1, x0:x1] + 0.5
    return x.ravel(), y.ravel()


def _tile_boxes(width: int, height: int, tile_width: int, tile_height: int) -> list[tuple[int, ...]]:
    # x0, y0, x1, y1 as `pixel_centres` takes them, row-major, cut at the image border
    return [(x, y, min(x + tile_width, width), min(y + tile_height, height))
            for y in range(0, height, tile_height) for x in range(0, width, tile_width)]


def tiles(projection: Projection, width: int, height: int, tile_width: int = 16,
          tile_height: int = 16) -> list[np.ndarray]:
    """Per tile (row-major) the primitives with G or G_p >= 1/255 at one of its pixel centres, in depth order.

    An engine that intersects ellipses with tiles instead may list more than these, never less.
    """
    lists: list[list[int]] = []
    order = depth_order(projection)
    for box in _tile_boxes(width, height, tile_width, tile_height):
        x, y = pixel_centres(*box)
        lists.append([i for i in order if max(G.max() for G in kernels(projection, i, x, y)) >= MIN_ALPHA])
    return [np.array(indices, np.int64) for indices in lists]


def _blend(projection: Projection, order: np.ndarray, x: np.ndarray, y: np.ndarray, features: np.ndarray,
           negative_transmittance: bool, smooth: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Walk through `order` front to back at P points -> features [P, C], T [P], depth [P]; no background."""
    out, T, depth = np.zeros((len(x), features.shape[1])), np.ones(len(x)), np.zeros(len(x))
    walking = np.ones(len(x), bool)
    for i in order:
        G, G_p = kernels(projection, i, x, y)
        alpha = np.minimum(MAX_ALPHA, G) - np.minimum(MAX_ALPHA, G_p)
        if not smooth:
            alpha[np.abs(alpha) < MIN_ALPHA] = 0
        T_next = T * (1 - (alpha if negative_transmittance else np.maximum(alpha, 0)))
        walking &= T_next <= MAX_T
        if not smooth:
            walking &= T_next >= MIN_T
        weight = np.where(walking, alpha * T, 0)
        out += weight[:, None] * features[i]
        depth += weight * projection.depths[i]
        T = np.where(walking, T_next, T)
    return out, T, depth


def composite(projection: Projection, tiles: Sequence[np.ndarray], width: int, height: int,
              background: Sequence[float] | np.ndarray = (0, 0, 0), *, negative_transmittance: bool = True,
              features: np.ndarray | None = None, smooth: bool = False, tile_width: int = 16,
              tile_height: int = 16) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Blend tile lists -> image [H, W, 3] (not clamped), T [H, W], depth [H, W] = sum of depth alpha T.

    `features` [N, C] takes the place of the colours (image [H, W, C], background of C values).
    `negative_transmittance=False`: negative alpha subtracts colour but leaves T alone.
    `smooth=True`: no 1/255 skip, no stop, for derivatives; the lists must then hold every visible primitive.
    Raises ValueError if the number of lists is not that of the tiles.
    """
    boxes = _tile_boxes(width, height, tile_width, tile_height)
    if len(boxes) != len(tiles):
        raise ValueError(f"composite: {len(tiles)} lists for {len(boxes)} tiles; pass one list per tile")
    features = projection.colors if features is None else np.asarray(features, np.float64)
    image = np.empty((height, width, features.shape[1]))
    T, depth = np.empty((height, width)), np.empty((height, width))
    for (x0, y0, x1, y1), order in zip(boxes, tiles, strict=True):
        x, y = pixel_centres(x0, y0, x1, y1)
        blended = _blend(projection, order, x, y, features, negative_transmittance, smooth)
        for whole, part in zip((image, T, depth), blended, strict=True):
            whole[y0:y1, x0:x1] = part.reshape(y1 - y0, x1 - x0, *part.shape[1:])
    return image + T[..., None] * np.asarray(background, np.float64), T, depth


def render(splats: Splats, camera: Camera, background: Sequence[float] | np.ndarray = (0, 0, 0), *,
           near_clip: float = 0.2, antialiased: bool = False, sh_degree: int | None = None,
           negative_transmittance: bool = True, smooth: bool = False,
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All primitives at all pixels -> image [H, W, 3], T, depth [H, W]; options of `project`, `composite`."""
    projection = project(splats, camera, near_clip=near_clip, antialiased=antialiased, sh_degree=sh_degree)
    width, height = camera.width, camera.height
    return composite(projection, [depth_order(projection)], width, height, background, smooth=smooth,
                     negative_transmittance=negative_transmittance, tile_width=width, tile_height=height)


def loss_gradients(splats: Splats, camera: Camera, adjoint: np.ndarray, *,
                   keys: Sequence[str] | None = None, eps: float = 1e-5,
                   background: Sequence[float] | np.ndarray = (0, 0, 0), smooth: bool = True,
                   **options) -> dict[str, np.ndarray]:
    """Central differences of sum(adjoint [H, W, 3] * image) by every entry of the raw parameters in `keys`, or of all.

    Perturbs in float64, one entry at a time: two renders each, for small scenes. `options` go to `render`.
    """
    if np.shape(adjoint) != (camera.height, camera.width, 3):
        raise ValueError(f"loss_gradients: adjoint has the shape {np.shape(adjoint)}, the image "
                         f"{(camera.height, camera.width, 3)}; both need to be equal")
    raw = {name: np.array(getattr(splats, name), np.float64) for name in RAW_PARAMETERS + group_names(splats)}
    indices = {f"sh{degree}_index": index for degree, index in sh_groups(splats).items()}
    # Not a `Splats`, which is float32: too coarse for these steps.
    perturbed = cast("Splats", SimpleNamespace(**raw, **indices, dog_index=splats.dog_index))

    def loss() -> float:
        return float(np.sum(adjoint * render(perturbed, camera, background, smooth=smooth, **options)[0]))

    gradients = {}
    for key in raw if keys is None else keys:
        gradients[key] = np.zeros_like(raw[key])
        for index in np.ndindex(raw[key].shape):
            value = raw[key][index]
            raw[key][index] = value + eps
            above = loss()
            raw[key][index] = value - eps
            below = loss()
            raw[key][index] = value
            gradients[key][index] = (above - below) / (2 * eps)
    return gradients
