"""Primitives that planes cut off as whole ones, for what knows no cuts: each becomes the Gaussian nearest to it.

In units of its standard deviations a primitive is e^(-|w|²/2), and a cut multiplies it by g(n·w) (docs/cuts.md). A
picture takes g at the mean of w along each ray. So of n it knows what lies across the view: a plane that faces the
camera cuts nothing off, and what n has along the thinnest axis of a flat primitive counts little (``counted``).

Beside the direction of the n that counts nothing changes. Along it, with t = n·w / |n|, what is left is nearest, in
the mean of squares, to

    a e^(-(t - m)² / 2r²)

with three numbers that depend on |n| alone. So the centre moves by m towards n, the primitive gets narrower by r along
it, and its opacity is multiplied by a. Its pseudo-Gaussian goes along as a part of it. Where the colour varies over the
primitive, each place of a picture keeps its own, on average over the views. But a primitive that had no slopes ends
without: those that its curvatures give it about the new centre are left out. What a second plane cuts off is then a
Gaussian again, along other axes and at another distance, so that it follows the first one. A primitive whose place
depends on the view moves as it did.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import shifts
from .across import across_views
from .curvatures import matrices, turned
from .cuts import LARGEST, OFFSET
from .linear_map import kernels_of
from .quaternions import rotation_from_quaternion
from .row_groups import PLANES, RowGroup
from .sh_basis import C0
from .splats import Array, Splats

PLACES = np.linspace(-6, 6, 601)  # t of the integrals
ROUNDS = 25  # of the search for m and r
AT_ONCE = 2048  # primitives, whose integrals fill some MB
OPACITIES = 1e-4, 1 - 1e-4  # least and most


@dataclass
class _Plane:
    """One that cuts off the primitives ``index`` [C]: at w it leaves (1 + e⁻⁴) / (1 + e^(-offsets - normals·w))."""

    index: Array
    normals: Array  # [C, 3]
    offsets: Array  # [C]

    @classmethod
    def of(cls, splats: Splats, group: RowGroup) -> _Plane:
        (name,) = group.names
        index = getattr(splats, group.index)
        return cls(index, getattr(splats, name).astype(np.float64), np.full(len(index), OFFSET))


def whole(splats: Splats) -> Splats:
    """The model with each primitive that is cut off replaced by the whole one nearest to it; itself without cuts."""
    planes = [_Plane.of(splats, group) for group in PLANES if len(getattr(splats, group.index))]
    if not planes:
        return splats
    found = _with_slopes(splats.without_cuts(), splats.curvature_index)  # which a second plane has to know
    while planes:
        _make_whole(found, planes.pop(0), planes)
    had = np.searchsorted(found.slope_index, splats.slope_index)
    return replace(found, slope_index=found.slope_index[had], color_slopes=found.color_slopes[had])


def _with_slopes(splats: Splats, index: Array) -> Splats:
    """The model in which these primitives have slopes too, of zero."""
    sloped = np.union1d(splats.slope_index, index)
    slopes = np.zeros((len(sloped), 3, 3), np.float32)
    slopes[np.searchsorted(sloped, splats.slope_index)] = splats.color_slopes
    return replace(splats, slope_index=sloped, color_slopes=slopes)


def _make_whole(splats: Splats, plane: _Plane, others: list[_Plane]) -> None:
    """Make primitives whole that a plane cuts off, in place; other planes stay where pictures show them."""
    at = plane.index
    across = across_views(splats.log_scales[at])  # [C, 3]
    normals = counted(across) * plane.normals
    lengths = np.linalg.norm(normals, axis=1)
    nearer, ratio, factor = nearest_whole(lengths, plane.offsets)
    towards = normals / np.where(lengths > 0, lengths, 1)[:, None]  # [C, 3] n / |n|
    moved = towards * nearer[:, None]
    narrower = np.eye(3) + (ratio - 1)[:, None, None] * towards[:, :, None] * towards[:, None]  # [C, 3, 3]
    rotations = rotation_from_quaternion(splats.quats[at].astype(np.float64))
    before = rotations * splats.scales[at][:, None]  # [C, 3, 3]
    columns = before @ narrower
    quats, scales = kernels_of(columns)
    back = rotation_from_quaternion(quats).swapaxes(1, 2)  # to the new axes
    opacities = np.clip(splats.opacities[at] * factor, *OPACITIES)
    splats.means[at] += np.einsum("cxa,ca->cx", before, moved)
    splats.quats[at], splats.log_scales[at] = quats, np.log(scales)
    splats.logit_opacities[at] = np.log(opacities / (1 - opacities))

    dog, rows = _common(splats.dog_index, at)
    along = back @ columns / scales[:, :, None]  # [C, 3, 3] orthogonal
    splats.dog_log_scales[dog] = np.log(nearest_factors(along[rows], splats.dog_scales[dog].astype(np.float64)))

    turn = along @ narrower  # what is told by the old axes, by the new ones
    seen = across * moved  # in a picture, on average
    _keep_colors(splats, at, seen, turn)
    shifted, rows = _common(splats.shift_index, at)
    moves, directions = (back @ before / scales[:, :, None])[rows], (back @ rotations).swapaxes(1, 2)[rows]
    given = splats.view_shifts[shifted], splats.mean_views[shifted]
    splats.view_shifts[shifted], splats.mean_views[shifted] = shifts.turned(*given, moves, directions)
    for other in others:
        own, rows = _common(other.index, at)
        other.offsets[own] += np.einsum("ma,ma->m", seen[rows], other.normals[own])
        other.normals[own] = np.einsum("mba,ma->mb", turn[rows], other.normals[own])


def _keep_colors(splats: Splats, at: Array, moved: Array, turn: Array) -> None:
    """Let each place of a picture keep its colour, in place, where primitives have moved and got other axes.

    Args:
        at: [C] the primitives.
        moved: [C, 3] by how much a picture shows it, in standard deviations along the old axes.
        turn: [C, 3, 3] from the old axes to the new ones.
    """
    sloped, rows = _common(splats.slope_index, at)
    slopes = splats.color_slopes[sloped].astype(np.float64)
    splats.sh_coeffs[at[rows], 0] += np.einsum("ma,mac->mc", moved[rows], slopes) / C0
    splats.color_slopes[sloped] = turn[rows] @ slopes
    curved, rows = _common(splats.curvature_index, at)
    Q = matrices(splats.brightness_curvatures[curved])  # q(m + w') = q(m) + mᵀ Q w' + q(w')
    rises = np.einsum("mab,mb->ma", Q, moved[rows])
    splats.sh_coeffs[at[rows], 0] += 0.5 * np.einsum("ma,ma->m", rises, moved[rows])[:, None] / C0
    splats.brightness_curvatures[curved] = turned(splats.brightness_curvatures[curved], turn[rows])
    _, of_slopes, of_curved = np.intersect1d(splats.slope_index, at[rows], return_indices=True)
    splats.color_slopes[of_slopes] += np.einsum("mba,ma->mb", turn[rows], rises)[of_curved][:, :, None]


def counted(across: Array) -> Array:
    """[C, 3] what normals are multiplied by along each axis: how much of it lies across views, 1 for that of a ball.

    Found by how near pictures from all sides come to those of the model (docs/export_details.md).
    """
    return np.minimum(1, 1.5 * across)


def nearest_whole(lengths: Array, offsets: Array) -> tuple[Array, Array, Array]:
    """m, r and a of cuts whose normals have these ``lengths`` and ``offsets`` [C]."""
    parts = range(0, len(lengths), AT_ONCE)
    found = [_nearest_whole(lengths[k : k + AT_ONCE], offsets[k : k + AT_ONCE]) for k in parts]
    m, r, a = np.concatenate(found, axis=1) if found else np.zeros((3, 0))
    return m, r, a


def _nearest_whole(lengths: Array, offsets: Array) -> Array:
    """[3, C], of some.

    f is what is left and G = e^(-(t - m)² / 2r²). The error of a G with the best a, <G, f> / <G, G>, is least where f G
    has the mean m and the variance r²/2, as G² has. Of a Gaussian f, f G is half-way between: in its mean, if r is
    right, and in 1 / variance. A step of twice the way there would end the search, and here it soon does.
    """
    exponents = np.clip(-offsets[:, None] - lengths[:, None] * PLACES, -700, 700)
    log_left = -0.5 * PLACES**2 - np.log1p(np.exp(exponents))  # [C, places]
    log_left -= log_left.max(axis=1, keepdims=True)  # of a sliver far out, all would be next to nothing
    m, precision = PLACES[log_left.argmax(axis=1)], np.ones(len(lengths))  # 1 / r²
    for _ in range(ROUNDS):
        away = PLACES - m[:, None]
        both = np.exp(log_left - 0.5 * precision[:, None] * away**2)
        both /= both.sum(axis=1, keepdims=True)
        mean = (both * away).sum(axis=1)
        variance = (both * away**2).sum(axis=1) - mean**2
        m, precision = m + mean * 2, np.maximum(1 / variance - precision, precision / 4)
    gaussians = np.exp(-0.5 * precision[:, None] * (PLACES - m[:, None]) ** 2)
    left = np.exp(-0.5 * PLACES**2) * LARGEST / (1 + np.exp(exponents))
    a = (gaussians * left).sum(axis=1) / (gaussians**2).sum(axis=1)
    return np.stack([m, 1 / np.sqrt(precision), a])


def nearest_factors(turns: Array, factors: Array) -> Array:
    """F' [M, 3] of pseudo-Gaussians with F [M, 3] whose axes have become other ones by orthogonal ``turns`` [M, 3, 3].

    The covariance is U F² Uᵀ then. With its variances along the new axes a long and thin one would get as wide as it is
    long, and hide all around it. Those of a cut through its middle would be too small by as much. Their geometric mean
    is nearest in the mean of squares where two of the axes turn, and then keeps the volume.
    """
    weights = turns**2
    squares = np.einsum("mab,mb->ma", weights, factors**2), np.einsum("mab,mb->ma", weights, factors**-2.0)
    return (squares[0] / squares[1]) ** 0.25


def _common(index: Array, at: Array) -> tuple[Array, Array]:
    """The rows of primitives that are in both indices, in each of them."""
    _, first, second = np.intersect1d(index, at, assume_unique=True, return_indices=True)
    return first, second
