"""What a model holds that no picture of it shows; without it every picture has the same bits, or nearly.

invisible   a primitive whose opacity is below 1/255, the smallest α that is blended, or with a parameter that is not
            finite: it enters no list of a tile. What a plane cuts off is a little more opaque on the side that is left.
faded DoG   a pseudo-Gaussian whose peak f_a o is below 2^-33. Its primary is blended where 2^p is at least 1/255, and
            there float32 has a spacing of 2^-31 or more: 2^p - 2^p' rounds to 2^p. Elsewhere α is ignored, as without.
zero slope  a row of slopes, or of curvatures, that are all 0: they add 0 to a colour.
zero cut    a normal of three times 0: it multiplies a kernel by 1, and pictures are equal to the rounding of that.
zero shift  a row of shifts that are all 0: it adds 0 to a place, whatever the view.
zero SH     the highest bands of primitives whose every coefficient is 0: they add 0 to a colour. Where a model of one
            degree becomes one of several, sums are made in another order, and pictures are equal to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..engine.geometry import Cutoffs
from ..scene.cuts import LARGEST
from ..scene.finite import finite_in, finite_rows
from ..scene.opacity import sigmoid
from ..scene.ply import rows_save
from ..scene.row_groups import BESIDE_DOG, DOG, NAMED, PLANES, SH, RowGroup
from ..scene.splats import Array, Splats
from ..support.wording import count, file_size

LEAST_ALPHA = Cutoffs().alpha * (1 - 1e-4)  # below the cutoff by more than the rounding of the engine's opacity
FADED = 2.0**-33  # of f_a o; half of what could round, for the same reason
FLOAT = 4  # bytes
GAUSSIAN = 14 * FLOAT  # bytes of a primitive of SH degree 0
WORDS = {DOG: "DoG without effect"} | {
    group: f"{name.replace('_', ' ')} that are zero" for name, group in NAMED.items()
}


@dataclass(frozen=True)
class Unneeded:
    """What can leave, of a model of N primitives."""

    invisible: Array
    """[N] bool"""
    rows: Mapping[RowGroup, Array]
    """of each group of ``BESIDE_COLORS`` with M rows: [M] bool, faded or zero, of primitives that are visible"""
    sh_degrees: Array
    """[N] the highest degree with a coefficient that is not zero"""

    @staticmethod
    def of(splats: Splats) -> Unneeded:
        """Found from the parameters alone."""
        opacities = largest_alphas(splats)  # [N]
        invisible = ~_finite(splats) | (opacities < LEAST_ALPHA)
        peaks = sigmoid(splats.dog_logit_opacities.astype(np.float64)) * opacities[splats.dog_index]  # [M]
        idle = {DOG: peaks < FADED} | {group: _zero(splats, group) for group in BESIDE_DOG}
        rows = {group: found & ~invisible[getattr(splats, group.index)] for group, found in idle.items()}
        return Unneeded(invisible, rows, used_sh_degrees(splats))

    def degrees_left(self, splats: Splats, mixed_sh: bool) -> Array:
        """[N] SH degree of each primitive without its zero bands: its own one, or the same for all (``taken_out``)."""
        if splats.mixed_sh or (mixed_sh and self.saved_by_mixing > 0):
            return self.sh_degrees
        return np.full(splats.n_splats, self.sh_degrees[~self.invisible].max(initial=0))

    @property
    def saved_by_mixing(self) -> int:
        """Bytes of a PLY, if each primitive has the SH degree that it needs; negative where that makes it larger."""
        return rows_save(self.sh_degrees[~self.invisible])

    def described(self, splats: Splats, mixed_sh: bool = True) -> list[str]:
        """A line for each kind that there is: how many, and how many bytes they take in float32."""
        left = self.degrees_left(splats, mixed_sh)
        bands = 3 * FLOAT * ((splats.sh_degrees + 1) ** 2 - 1)  # [N] bytes above the constant band
        kinds = [("invisible primitives", self.invisible, GAUSSIAN + bands)]
        for group, idle in self.rows.items():
            kinds.append((WORDS[group], idle, np.full(len(idle), FLOAT * (1 + group.row_size))))  # with its index
        for degree in SH:
            zero = ~self.invisible & (splats.sh_degrees >= degree) & (left < degree)
            sizes = np.full(splats.n_splats, 3 * FLOAT * (2 * degree + 1))
            kinds.append((f"zero bands of SH degree {degree}", zero, sizes))
        there = [(name, rows.sum(), sizes[rows].sum()) for name, rows, sizes in kinds if rows.any()]
        return [f"{name}: {count(number)}, {file_size(size)}" for name, number, size in there]

    def taken_out(self, splats: Splats, mixed_sh: bool = False) -> Splats:
        """The model without it.

        Args:
            splats: what it was found in.
            mixed_sh: a model of one SH degree may become one of several, where that makes its file smaller; else it
                keeps one that all can do with.
        """
        left: dict[str, Array] = {}
        for group, idle in self.rows.items():
            left |= {name: getattr(splats, name)[~idle] for name in (group.index, *group.names)}
        lean = replace(splats, **left).select(~self.invisible)
        return lean.with_sh_degrees(self.degrees_left(splats, mixed_sh)[~self.invisible])


def _zero(splats: Splats, group: RowGroup) -> Array:
    """[M] whether a row of a group is all 0; the mean views of shifts do not count."""
    values = getattr(splats, group.names[0])
    return ~values.any(axis=tuple(range(1, values.ndim)))


def used_sh_degrees(splats: Splats) -> Array:
    """[N] highest degree of each primitive with a coefficient that is not zero."""
    used = np.zeros(splats.n_splats, int)
    for degree in range(1, splats.sh_degree + 1):
        if not splats.mixed_sh:
            band = splats.sh_coeffs[:, degree**2 : (degree + 1) ** 2]  # [N, 2 degree + 1, 3]
            used[band.any(axis=(1, 2))] = degree
            continue
        for group in SH.values():
            (name,) = group.names
            band = getattr(splats, name)[:, degree**2 - 1 : (degree + 1) ** 2 - 1]
            used[getattr(splats, group.index)[band.any(axis=(1, 2))]] = degree
    return used


def largest_alphas(splats: Splats) -> Array:
    """[N] the largest value of each kernel, its opacity; with cuts it may be a little more."""
    found = sigmoid(splats.logit_opacities.astype(np.float64))
    for plane in PLANES:
        found[getattr(splats, plane.index)] *= LARGEST
    return found


def _finite(splats: Splats) -> Array:
    """[N] whether the engine takes the parameters: all are finite, but opacities may be those of ±∞."""
    finite = finite_rows(splats.means, splats.log_scales, splats.quats, splats.sh_coeffs)
    finite &= ~np.isnan(splats.logit_opacities) & finite_in(splats, (*BESIDE_DOG, *SH.values()))
    finite[splats.dog_index] &= finite_rows(splats.dog_log_scales) & ~np.isnan(splats.dog_logit_opacities)
    return finite
