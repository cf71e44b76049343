"""What several formats share: unit quaternions without their largest component, places, order in space, and axes.

A unit quaternion is told by its three smallest components, each within ±1/√2, and by which one is left out; q and -q
are the same rotation, so that the missing one can be taken as positive ("smallest three").
"""

from __future__ import annotations

import numpy as np

from ..scene.opacity import SMALLEST_OPACITY
from ..scene.row_groups import SH
from ..scene.splats import Array, Splats

SQRT2 = np.sqrt(2.0)
DUST = 0.1  # of the median size
OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])  # components beside the one left out, in order
MORTON_BITS = 10  # per axis: 2^30 cells are finer than any sorting needs
# Half turns from RDF (x right, y down, z forward), the axes of 3DGS PLY and of COLMAP's cameras: signs of x, y and z,
# and of the 16 basis functions of SH, in the order of 3DGS.
RUB = (1, -1, -1), (1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1)  # right, up, back: SPZ
LUF = (-1, -1, 1), (1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1)  # left, up, forward: glTF
Turn = tuple[tuple[int, ...], tuple[int, ...]]


def turned(splats: Splats, turn: Turn) -> Splats:
    """A model of plain Gaussians by half a turn, ``RUB`` or ``LUF``; again, and it is as it was. It loses nothing."""
    axes, bands = (np.array(signs, np.float32) for signs in turn)
    groups: dict[str, Array] = {group.index: getattr(splats, group.index) for group in SH.values()}
    for degree, group in SH.items():
        groups |= {name: getattr(splats, name) * bands[1 : (degree + 1) ** 2, None] for name in group.names}
    return Splats(
        means=splats.means * axes,
        log_scales=splats.log_scales,
        quats=splats.quats * np.append(axes, np.float32(1)),  # of D R D, D the turn: the axes of a like ellipsoid
        logit_opacities=splats.logit_opacities,
        sh_coeffs=splats.sh_coeffs * bands[: splats.sh_coeffs.shape[1], None],
        **groups,
    )


def smallest_three(quats: Array) -> tuple[Array, Array]:
    """Index [N] of the largest component of unit quaternions [N, 4], and the others [N, 3] where it is positive."""
    largest = np.abs(quats).argmax(axis=1)  # [N]
    sign = np.where(np.take_along_axis(quats, largest[:, None], axis=1) < 0, -1, 1)  # [N, 1]
    return largest, np.take_along_axis(quats, OTHERS[largest], axis=1) * sign


def from_smallest_three(largest: Array, three: Array) -> Array:
    """Unit quaternions [N, 4] of what ``smallest_three`` returns."""
    quats = np.zeros((len(largest), 4))
    np.put_along_axis(quats, OTHERS[largest], three, axis=1)
    rest = np.sqrt(np.maximum(0, 1 - (three**2).sum(axis=1, keepdims=True)))  # [N, 1]
    np.put_along_axis(quats, largest[:, None].astype(np.int64), rest, axis=1)
    return quats


def signed_log(x: Array) -> Array:
    """sign(x) ln(1 + |x|): places far away in coarser steps, as SOG has them."""
    return np.sign(x) * np.log1p(np.abs(x))


def signed_exp(logs: Array) -> Array:
    """The inverse of ``signed_log``."""
    return np.sign(logs) * np.expm1(np.abs(logs))


def logits(opacities: Array) -> Array:
    """Finite logits of opacities 0..1."""
    p = np.clip(opacities.astype(np.float64), SMALLEST_OPACITY, 1 - SMALLEST_OPACITY)
    return np.log(p / (1 - p))


def misplaced(splats: Splats, means: Array) -> Array:
    """[N] whether a primitive that is read at ``means`` [N, 3] has left its place by more than its size.

    Of dust it is a part of the usual size: nobody sees it move.
    """
    sizes = splats.scales.max(axis=1)
    return np.abs(means - splats.means).max(axis=1) > np.maximum(sizes, DUST * np.median(sizes))


def morton_order(means: Array) -> Array:
    """Order [N] of positions [N, 3] along a Z-shaped curve: neighbours in a file are then neighbours in space."""
    if not len(means):
        return np.zeros(0, np.int64)
    low, high = (end(means, axis=0).astype(np.float64) for end in (np.min, np.max))  # float32 may hold no difference
    cells = (means.astype(np.float64) - low) / np.maximum(high - low, 1e-30) * (2**MORTON_BITS - 1)  # [N, 3]
    codes = np.zeros(len(means), np.int64)
    for axis, cell in enumerate(cells.astype(np.int64).T):
        for bit in range(MORTON_BITS):  # one by one: a table of all bits would be ten times as large as the positions
            codes |= (cell >> bit & 1) << (3 * bit + axis)
    return np.argsort(codes, kind="stable")


def in_space(splats: Splats) -> Array:
    """``morton_order`` of a model."""
    return morton_order(splats.means)


def by_color(splats: Splats) -> Array:
    """Order [N] in which equal SH coefficients, all but the first, follow each other, if they are mostly of a palette.

    A stream of bytes with repetitions compresses them to nothing. Beside that, and else, neighbours in space.
    """
    order, n = in_space(splats), splats.n_splats
    rest = splats.sh_coeffs[:, 1:]
    if not rest.size:
        return order
    rest = np.ascontiguousarray(rest.reshape(n, -1))
    entries, labels = np.unique(rest, axis=0, return_inverse=True)
    labels = labels.reshape(n)  # NumPy 2.0 has a column
    return order if len(entries) > n / 2 else order[np.argsort(labels[order], kind="stable")]
