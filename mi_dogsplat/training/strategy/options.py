"""What a primitive may be left with, and what that loses and costs: the options among which bytes are divided.

Option 0 is to be removed. Then come, without and with its DoG row, the bands of colour up to degree 0, 1, 2, 3 of those
that it has. The loss of each is in one unit, the energy of the change of the training pictures (``scores/``), and is
measured as if nothing else changed: of a removal by leave-one-out, of bands with the others fitted anew, of a DoG row
by the pictures with the primary alone. What an option is worth is the loss of a removal minus its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...formats.sizes import Prices
from ...scene.row_groups import MAX_SH_DEGREE
from ...scene.splats import Splats
from ...scores.bands import Bands, bands
from ...scores.score import ScoreRule, energies
from ..allocation import allocate
from .strategy import Training

REMOVAL = ScoreRule("leave-one-out", spectral_weight=0.0)
DOG = ScoreRule("leave-dog-out", spectral_weight=0.0)
DEGREES = MAX_SH_DEGREE + 1


@dataclass(frozen=True)
class Chosen:
    """What an allocation leaves."""

    kept: np.ndarray  # [n] rows, increasing
    degrees: np.ndarray  # [n] their SH degrees
    dog: np.ndarray  # [m] those of the rows kept that stay DoG, as places among them


@dataclass(frozen=True)
class Options:
    """Of all primitives of a model."""

    removal: np.ndarray  # [N] what is lost without the primitive
    by_degree: np.ndarray  # [N, highest degree + 1] ... without the bands above
    without_dog: np.ndarray  # [N] ... without the DoG row, 0 where there is none
    degrees: np.ndarray  # [N] that it has
    is_dog: np.ndarray  # [N]
    bands: Bands

    @classmethod
    def of(cls, t: Training, splats: Splats) -> Options:
        """Measured over all training views of a run; ``splats`` is its model on the host."""
        params, cameras, options = t.optimizer.params, t.photographs.cameras, t.options
        whole = splats.uniform_sh()
        found = bands(params, whole.sh_coeffs, cameras, options)
        background = t.photographs.background

        def energy(rule: ScoreRule) -> np.ndarray:
            return energies(rule, params, cameras, options, background, 0)[0]

        is_dog = np.zeros(splats.n_splats, bool)
        is_dog[splats.dog_index] = True
        without_dog = energy(DOG) if splats.n_dog else np.zeros(splats.n_splats)
        return cls(energy(REMOVAL), found.losses(), without_dog, splats.sh_degrees, is_dog, found)

    def of_whole_primitives(self) -> Options:
        """The same, when a primitive can only go or stay as it is."""
        whole = np.arange(self.by_degree.shape[1]) == self.degrees[:, None]
        return replace(
            self,
            by_degree=np.where(whole, self.by_degree, np.inf),
            without_dog=np.where(self.is_dog, np.inf, self.without_dog),
        )

    def chosen(self, prices: Prices, budget: float) -> Chosen:
        """What gains most for its bytes in a file of at most ``budget`` bytes, as far as prices tell."""
        n, highest = self.by_degree.shape[0], self.by_degree.shape[1] - 1
        plain = np.full((n, DEGREES), -np.inf)
        plain[:, : highest + 1] = self.removal[:, None] - self.by_degree
        plain[np.arange(DEGREES) > self.degrees[:, None]] = -np.inf
        with_dog = np.where(self.is_dog[:, None], plain, -np.inf)
        values = np.concatenate([np.zeros((n, 1)), plain - self.without_dog[:, None], with_dog], axis=1)
        of_bands = np.array(prices.bands)
        bytes_of = np.concatenate([[0.0], of_bands, of_bands + max(prices.dog, 1e-9)])
        choice = allocate(values, bytes_of, max(0.0, budget - prices.fixed))
        kept = np.flatnonzero(choice)
        what = choice[kept] - 1
        return Chosen(kept, what % DEGREES, np.flatnonzero(what >= DEGREES))
