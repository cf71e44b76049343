"""What a model holds that no picture of it shows; without it every picture has the same bits.

invisible   a primitive whose opacity is below 1/255, the smallest α that is blended, or with a parameter that is not
            finite: it enters no list of a tile.
faded DoG   a pseudo-Gaussian whose peak f_a o is below 2^-33. Its primary is blended where 2^p is at least 1/255, and
            there float32 has a spacing of 2^-31 or more: 2^p - 2^p' rounds to 2^p. Elsewhere α is ignored, as without.
zero SH     the highest bands of all primitives, where every coefficient is 0: they add 0 to a colour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.geometry import Cutoffs
from ..scene.splats import Array, Splats

LEAST_ALPHA = Cutoffs().alpha * (1 - 1e-4)  # below the cutoff by more than the rounding of the engine's opacity
FADED = 2.0**-33  # of f_a o; half of what could round, for the same reason
FLOAT = 4  # bytes


@dataclass(frozen=True)
class Unneeded:
    """What can leave; ``sh_degree`` is the highest that is needed."""

    invisible: Array
    """[N] bool"""
    faded_dog: Array
    """[M] bool, rows of primitives that are visible"""
    sh_degree: int

    @staticmethod
    def of(splats: Splats) -> Unneeded:
        """Found from the parameters alone."""
        invisible = ~_finite(splats) | (_opacities(splats) < LEAST_ALPHA)  # [N]
        with np.errstate(over="ignore"):
            f_a = 1 / (1 + np.exp(-splats.dog_logit_opacities.astype(np.float64)))  # [M]
        faded = f_a * _opacities(splats)[splats.dog_index] < FADED
        return Unneeded(invisible, faded & ~invisible[splats.dog_index], used_sh_degree(splats.select(~invisible)))

    def taken_out(self, splats: Splats) -> Splats:
        """The model without it."""
        coefficients = (self.sh_degree + 1) ** 2
        arrays = {name: getattr(splats, name) for name in ("means", "log_scales", "quats", "logit_opacities")}
        lean = Splats(
            **arrays,
            sh_coeffs=splats.sh_coeffs[:, :coefficients],
            dog_index=splats.dog_index[~self.faded_dog],
            dog_logit_opacities=splats.dog_logit_opacities[~self.faded_dog],
            dog_log_scales=splats.dog_log_scales[~self.faded_dog],
        )
        return lean.select(~self.invisible)


def used_sh_degree(splats: Splats) -> int:
    """Highest degree with a coefficient that is not zero."""
    bands = [splats.sh_coeffs[:, degree**2 : (degree + 1) ** 2] for degree in range(splats.sh_degree + 1)]
    return max((degree for degree, band in enumerate(bands) if band.any()), default=0)


def _opacities(splats: Splats) -> Array:
    """[N] float64; of a logit of ±∞ it is 0 or 1."""
    with np.errstate(over="ignore"):
        return 1 / (1 + np.exp(-splats.logit_opacities.astype(np.float64)))


def _finite(splats: Splats) -> Array:
    """[N] whether the engine takes the parameters: all are finite, but opacities may be those of ±∞."""
    n = splats.n_splats
    rows = (splats.means, splats.log_scales, splats.quats, splats.sh_coeffs.reshape(n, -1))
    finite = np.all([np.isfinite(values).all(axis=1) for values in rows], axis=0) & ~np.isnan(splats.logit_opacities)
    finite[splats.dog_index] &= np.isfinite(splats.dog_log_scales).all(axis=1) & ~np.isnan(splats.dog_logit_opacities)
    return finite
