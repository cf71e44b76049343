"""Primitives that a plane cuts off as whole ones, for what knows no cuts: each becomes the Gaussian nearest to it.

In units of its standard deviations a primitive is e^(-|w|²/2), and a cut multiplies it by g(n·w) (docs/cuts.md). Beside
the direction of n nothing changes. Along it, with t = n·w / |n|, what is left is nearest, in the mean of squares, to

    a e^(-(t - m)² / 2r²)

with three numbers that depend on |n| alone. So the centre moves by m towards n, the primitive gets narrower by r along
it, and its opacity is multiplied by a. Its pseudo-Gaussian goes along as a part of it. Where the colour varies over the
primitive, each place keeps its own.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .cuts import LARGEST, OFFSET
from .linear_map import kernels_of
from .quaternions import rotation_from_quaternion
from .sh_basis import C0
from .splats import Array, Splats

LENGTHS = np.concatenate([[0], np.geomspace(0.05, 1000, 60)])  # |n| of the table; beyond it nothing changes any more
PLACES = np.linspace(-6, 6, 601)  # t of the integrals
ROUNDS, TRIED = 8, np.linspace(-1, 1, 9)  # of the search for m and r, each round about the best of the one before
OPACITIES = 1e-4, 1 - 1e-4  # least and most


def whole(splats: Splats) -> Splats:
    """The model with each primitive that is cut off replaced by the whole one nearest to it; itself without cuts."""
    at = splats.cut_index
    if not len(at):
        return splats
    found = splats.without_cuts()
    normals = splats.cut_normals.astype(np.float64)
    lengths = np.linalg.norm(normals, axis=1)
    shift, ratio, factor = nearest_whole(lengths)
    towards = normals / np.where(lengths > 0, lengths, 1)[:, None]  # [C, 3] n / |n|
    moved = towards * shift[:, None]
    narrower = np.eye(3) + (ratio - 1)[:, None, None] * towards[:, :, None] * towards[:, None]  # [C, 3, 3]
    before = rotation_from_quaternion(splats.quats[at].astype(np.float64)) * splats.scales[at][:, None]  # [C, 3, 3]
    columns = before @ narrower
    quats, scales = kernels_of(columns)
    back = rotation_from_quaternion(quats).swapaxes(1, 2)  # to the new axes
    found.means[at] += np.einsum("cxa,ca->cx", before, moved)
    found.quats[at], found.log_scales[at] = quats, np.log(scales)
    opacities = np.clip(splats.opacities[at] * factor, *OPACITIES)
    found.logit_opacities[at] = np.log(opacities / (1 - opacities))

    dog, rows = _common(splats.dog_index, at)
    pseudo = back[rows] @ (columns[rows] * splats.dog_scales[dog].astype(np.float64)[:, None])
    found.dog_log_scales[dog] = np.log(np.linalg.norm(pseudo, axis=2) / scales[rows])

    sloped, rows = _common(splats.slope_index, at)
    slopes = splats.color_slopes[sloped].astype(np.float64)
    found.sh_coeffs[at[rows], 0] += np.einsum("ma,mac->mc", moved[rows], slopes) / C0
    turn = back[rows] @ columns[rows] / scales[rows][:, :, None]
    found.color_slopes[sloped] = turn @ narrower[rows] @ slopes
    return found


def nearest_whole(lengths: Array) -> tuple[Array, Array, Array]:
    """m, r and a of cuts whose normals have these ``lengths`` [C]."""
    known = np.log1p(LENGTHS)
    m, r, a = (np.interp(np.log1p(lengths), known, values) for values in _table())
    return m, r, a


@lru_cache(maxsize=1)
def _table() -> tuple[Array, Array, Array]:
    """m, r and a at ``LENGTHS``: what is largest is <G, f>² / <G, G>, and a = <G, f> / <G, G>."""
    exponents = np.clip(-OFFSET - LENGTHS[:, None] * PLACES, -700, 700)
    left = np.exp(-0.5 * PLACES**2) * LARGEST / (1 + np.exp(exponents))  # f [L, places]
    m, r, width = np.full(len(LENGTHS), 0.4), np.full(len(LENGTHS), 0.7), 0.4
    a = np.ones(len(LENGTHS))
    rows = np.arange(len(LENGTHS))
    for _ in range(ROUNDS):
        ms = np.repeat(m[:, None] + width * TRIED, len(TRIED), axis=1)  # [L, 81]
        rs = np.tile(r[:, None] + width * TRIED, len(TRIED))
        tried = np.exp(-0.5 * ((PLACES - ms[..., None]) / rs[..., None]) ** 2)  # [L, 81, places]
        with_cut, with_itself = np.einsum("lkt,lt->lk", tried, left), np.einsum("lkt,lkt->lk", tried, tried)
        best = (with_cut**2 / with_itself).argmax(axis=1)
        m, r, a = ms[rows, best], rs[rows, best], (with_cut / with_itself)[rows, best]
        width /= 3
    return m, r, a


def _common(index: Array, at: Array) -> tuple[Array, Array]:
    """The rows of primitives that are in both indices, in each of them."""
    _, first, second = np.intersect1d(index, at, assume_unique=True, return_indices=True)
    return first, second
