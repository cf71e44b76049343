"""The float64 projection: primitives as one camera sees them, with their colours. Notation of `forward.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..scene.row_groups import BESIDE_DOG, CURVATURES, PLANES, SLOPES
from .directions import directions
from .linearised import Linearised
from .mixed_sh import padded_sh
from .own_axes import arrays_of, index_of, largest_kept, no_steeper, quadratic_forms, values_of
from .quaternions import rotations
from .shifts import seen_from

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats

LOW_PASS = 0.3  # px^2, added to the diagonal of every screen covariance
MIN_ALPHA = 1 / 255  # weaker contributions are skipped
MIN_ANTIALIAS_RATIO = 2.5e-5


@dataclass
class Projection:
    """All primitives as one camera sees them, float64; rows are zero where `visible` is false."""

    visible: np.ndarray  # [N] bool, in front of the near plane and everything finite (but for logit opacities)
    means2d: np.ndarray  # [N, 2] px
    depths: np.ndarray  # [N] camera z of the centre, where the camera sees it
    cov2d: np.ndarray  # [N, 3] px^2, with the low-pass
    conics: np.ndarray  # [N, 3] inverse of cov2d
    opacities: np.ndarray  # [N] with the antialias factor, if any
    colors: np.ndarray  # [N, 3] at the centre
    sloped: np.ndarray  # [N] bool, their colour varies over them
    slopes: np.ndarray  # [N, 3, 2] change of colour per px in x and in y, zero elsewhere
    curved: np.ndarray  # [N] bool, their brightness curves over them
    curvatures: np.ndarray  # [N, 2, 2] second derivatives of their brightness per px in x and in y, zero elsewhere
    cut: np.ndarray  # [2, N] bool, of each plane, that it cuts them off
    cuts: np.ndarray  # [2, N, 2] change of its n.w per px in x and in y, zero elsewhere
    dog: np.ndarray  # [N] bool; the pseudo_* rows are zero where false
    pseudo_cov2d: np.ndarray  # [N, 3]
    pseudo_conics: np.ndarray  # [N, 3]
    pseudo_opacities: np.ndarray  # [N]
    extents: np.ndarray  # [N, 2] px, half size of a box around {G or G_p >= 1/255}; 0 where that is empty


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


def sigmoid(x: np.ndarray) -> np.ndarray:
    """The logistic function; small values keep their relative precision."""
    return np.exp(-np.logaddexp(0, -x))


@dataclass
class _Kernels:
    """n kernels on the image plane, fields as in `Projection`."""

    cov2d: np.ndarray
    conics: np.ndarray
    opacities: np.ndarray


def _kernels(V: np.ndarray, opacities: np.ndarray, antialiased: bool) -> _Kernels:
    """From V = J W R S [n, 2, 3]: Sigma' = V V^T + 0.3 I, its inverse, and the opacity with the antialias factor.

    det V V^T is the squared length of the cross product of the rows of V (Lagrange): for needle-shaped
    primitives xx yy - xy^2 would cancel.
    """
    xx, xy, yy = (V[:, 0] ** 2).sum(1), (V[:, 0] * V[:, 1]).sum(1), (V[:, 1] ** 2).sum(1)
    det_raw = (np.cross(V[:, 0], V[:, 1]) ** 2).sum(1)
    det = det_raw + LOW_PASS * (xx + yy) + LOW_PASS**2
    xx, yy = xx + LOW_PASS, yy + LOW_PASS
    factor = np.sqrt(np.maximum(MIN_ANTIALIAS_RATIO, det_raw / det)) if antialiased else 1.0
    return _Kernels(np.stack([xx, xy, yy], axis=1), np.stack([yy, -xy, xx], axis=1) / det[:, None], opacities * factor)


def symmetric(rows: np.ndarray) -> np.ndarray:
    """[n, 2, 2] matrices of their rows (xx, xy, yy) [n, 3]."""
    return rows[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def determinants(cov2d: np.ndarray, conics: np.ndarray) -> np.ndarray:
    """det Sigma' [n, 1, 1], without cancellation: the conic, its inverse, has yy / det Sigma' for xx."""
    return (cov2d[:, 2] / conics[:, 0])[:, None, None]


def turned_columns(C: np.ndarray) -> np.ndarray:
    """The columns of C [n, 2, 3], each turned by 90 degrees."""
    return np.stack([-C[:, 1], C[:, 0]], axis=1)


def conics_times_axes(C: np.ndarray, variances: np.ndarray, cov2d: np.ndarray, conics: np.ndarray) -> np.ndarray:
    """Sigma'^-1 C [N, 2, 3] from C = J W R and the variances [N, 3] along its columns.

    Taken from cross products of the columns, which do not cancel on needles as the conic times C would.
    """
    minors = C[:, 0, :, None] * C[:, 1, None, :] - C[:, 1, :, None] * C[:, 0, None, :]  # [n, j, k] = C_j x C_k
    return (LOW_PASS * C + (turned_columns(C) * variances[:, None, :]) @ minors) / determinants(cov2d, conics)


def _extents(cov2d: np.ndarray, opacities: np.ndarray) -> np.ndarray:
    """Half size [N, 2] of the box around {o exp(-d^T conic d / 2) >= 1/255}; 0 where o is below 1/255."""
    t = 2 * np.log(np.maximum(opacities / MIN_ALPHA, 1))
    return np.sqrt(t[:, None] * cov2d[:, [0, 2]])


def _finite_rows(*arrays: np.ndarray) -> np.ndarray:
    """[N] whether all numbers of a row are finite, in each of the arrays [N, ...]."""
    return np.logical_and.reduce([np.isfinite(a).all(axis=tuple(range(1, a.ndim))) for a in arrays])


def _finite_parameters(splats: Splats, sh: np.ndarray) -> np.ndarray:
    """[N] no parameter in use is NaN or infinite, `sh` those of the colour; logit opacities may be infinite."""
    finite = _finite_rows(splats.means, splats.log_scales, splats.quats, sh)
    finite &= ~np.isnan(splats.logit_opacities)
    dog = np.asarray(splats.dog_index, np.int64)
    finite[dog] &= np.isfinite(splats.dog_log_scales).all(1) & ~np.isnan(splats.dog_logit_opacities)
    for group in BESIDE_DOG:
        finite[index_of(splats, group)] &= _finite_rows(*arrays_of(splats, group))
    return finite


def _own_axes_on_screen(splats: Splats, C: np.ndarray, scales: np.ndarray, kernels: _Kernels) -> dict[str, np.ndarray]:
    """`sloped`, `slopes`, `curved`, `curvatures`, `cut` and `cuts` of a `Projection`, from C = J W R [N, 2, 3]."""
    n = len(scales)

    def per_pixel(i: np.ndarray) -> np.ndarray:
        # [m, 2, 3] P = Sigma'^-1 V: at the offset d it is w = P^T d standard deviations away that primitives are seen
        return conics_times_axes(C[i], scales[i] ** 2, kernels.cov2d[i], kernels.conics[i]) * scales[i, None, :]

    sloped, slopes = np.zeros(n, bool), np.zeros((n, 3, 2))
    i = index_of(splats, SLOPES)
    slopes[i], sloped[i] = (per_pixel(i) @ values_of(splats, SLOPES)).swapaxes(1, 2), True
    curved, curvatures = np.zeros(n, bool), np.zeros((n, 2, 2))
    i = index_of(splats, CURVATURES)
    curvatures[i] = per_pixel(i) @ quadratic_forms(values_of(splats, CURVATURES)) @ per_pixel(i).swapaxes(1, 2)
    curved[i] = True
    cut, cuts = np.zeros((len(PLANES), n), bool), np.zeros((len(PLANES), n, 2))
    for k, plane in enumerate(PLANES):
        i = index_of(splats, plane)
        cuts[k, i], cut[k, i] = no_steeper(np.einsum("nij,nj->ni", per_pixel(i), values_of(splats, plane))), True
    return {"sloped": sloped, "slopes": slopes, "curved": curved, "curvatures": curvatures, "cut": cut, "cuts": cuts}


@np.errstate(all="ignore")  # what is not finite or not in front of the camera is computed, then discarded
def project(splats: Splats, camera: Camera, *, near_clip: float = 0.2, antialiased: bool = False,
            sh_degree: int | None = None) -> Projection:
    """Project primitives into a camera; `sh_degree` uses that many degrees only (None: all there are).

    Raises ValueError if `sh_degree` exceeds what the primitives have.
    """
    sh = _used_sh(splats, sh_degree)
    scales = np.exp(np.asarray(splats.log_scales, np.float64))
    linear = Linearised(camera, seen_from(splats, camera))
    C = linear.JW @ rotations(np.asarray(splats.quats, np.float64))  # [N, 2, 3]
    opacities = sigmoid(np.asarray(splats.logit_opacities, np.float64))
    kernels = _kernels(C * scales[:, None, :], opacities, antialiased)
    dog, pseudo = _pseudo_kernels(splats, C, scales, opacities, antialiased)
    own_axes = _own_axes_on_screen(splats, C, scales, kernels)
    largest = largest_kept(own_axes["cut"])
    values = {
        "means2d": linear.means2d, "depths": linear.z[:, 0],
        "cov2d": kernels.cov2d, "conics": kernels.conics, "opacities": kernels.opacities,
        "colors": _colors(splats, camera, sh), **own_axes,
        "dog": dog, "pseudo_cov2d": pseudo.cov2d, "pseudo_conics": pseudo.conics, "pseudo_opacities": pseudo.opacities,
        "extents": np.maximum(*(_extents(of.cov2d, of.opacities * largest) for of in (kernels, pseudo))),
    }  # fmt: skip
    of_planes = "cut", "cuts"
    rows = [row for name, value in values.items() for row in (value if name in of_planes else [value])]  # [N, ...]
    visible = (values["depths"] > near_clip) & _finite_rows(*rows) & _finite_parameters(splats, sh)
    for row in rows:
        row[~visible] = 0
    return Projection(visible, **values)


def _used_sh(splats: Splats, sh_degree: int | None) -> np.ndarray:
    """[N, K, 3] the coefficients that are evaluated. Raises ValueError, see `project`."""
    sh = padded_sh(splats)
    degree = int(np.sqrt(sh.shape[1])) - 1
    if sh_degree is not None and sh_degree > degree:
        raise ValueError(f"project: sh_degree is {sh_degree}, the splats have {degree}; ask for at most that")
    return sh if sh_degree is None else sh[:, :(sh_degree + 1) ** 2]


def _colors(splats: Splats, camera: Camera, sh: np.ndarray) -> np.ndarray:
    """[N, 3] at the centres, in the direction from the camera to where they are stored."""
    W, t = camera.w2c[:3, :3], camera.w2c[:3, 3]
    dirs, _ = directions(np.asarray(splats.means, np.float64) + W.T @ t)  # from the camera centre -W^T t, world space
    basis = sh_basis(dirs, int(np.sqrt(sh.shape[1])) - 1)  # [N, K]
    return np.maximum(0, np.einsum("nk,nkc->nc", basis, sh) + 0.5)


def _pseudo_kernels(splats: Splats, C: np.ndarray, scales: np.ndarray, opacities: np.ndarray,
                    antialiased: bool) -> tuple[np.ndarray, _Kernels]:
    """([N] which primitives are DoG, their pseudo-Gaussians, zero elsewhere)."""
    n, i = len(scales), np.asarray(splats.dog_index, np.int64)  # [M]
    f_a = sigmoid(np.asarray(splats.dog_logit_opacities, np.float64))  # [M]
    F = np.exp(np.asarray(splats.dog_log_scales, np.float64))  # [M, 3]
    of_dog = _kernels(C[i] * (F * scales[i])[:, None, :], f_a * opacities[i], antialiased)
    dog, pseudo = np.zeros(n, bool), _Kernels(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n))
    dog[i] = True
    pseudo.cov2d[i], pseudo.conics[i], pseudo.opacities[i] = of_dog.cov2d, of_dog.conics, of_dog.opacities
    return dog, pseudo
