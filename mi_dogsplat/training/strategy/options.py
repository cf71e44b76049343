"""What a primitive may be left with, and what that loses and costs: the options among which bytes are divided.

Option 0 is to be removed. Then come, without and with its DoG row, and again with its slopes, the bands of colour up to
degree 0, 1, 2, 3 of those that it has. The loss of each is in one unit, the energy of the change of the training
pictures (``scores/``), and is measured as if nothing else changed: of a removal by leave-one-out, of bands with the
others fitted anew, of a DoG row by the pictures with the primary alone; that of slopes is an estimate. What an option
is worth is the loss of a removal minus its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...formats.sizes import Prices
from ...scene.row_groups import MAX_SH_DEGREE
from ...scene.splats import Splats
from ...scores.bands import Bands, bands
from ...scores.score import ScoreRule, energies
from ...scores.slope_losses import slope_losses
from .allocation import allocate
from .strategy import Training

REMOVAL = ScoreRule("leave-one-out", spectral_weight=0.0)
DOG = ScoreRule("leave-dog-out", spectral_weight=0.0)
DEGREES = MAX_SH_DEGREE + 1
NEVER = 1e6  # times as much as the primitive that matters most


@dataclass(frozen=True)
class Chosen:
    """What an allocation leaves."""

    kept: np.ndarray  # [n] rows, increasing
    degrees: np.ndarray  # [n] their SH degrees
    dog: np.ndarray  # [m] those of the rows kept that stay DoG, as places among them
    slopes: np.ndarray  # [s] those that keep their slopes


@dataclass(frozen=True)
class Options:
    """Of all primitives of a model."""

    removal: np.ndarray  # [N] what is lost without the primitive
    by_degree: np.ndarray  # [N, highest degree + 1] ... without the bands above
    without_dog: np.ndarray  # [N] ... without the DoG row, 0 where there is none
    degrees: np.ndarray  # [N] that it has
    is_dog: np.ndarray  # [N]
    without_slopes: np.ndarray  # [N] ... without the slopes, 0 where there are none
    has_slopes: np.ndarray  # [N]
    bands: Bands

    @classmethod
    def of(cls, t: Training, splats: Splats) -> Options:
        """Measured over all training views of a run; ``splats`` is its model on the host.

        Slopes that the model has and the run has not yet are as good as needed.
        """
        params, cameras, options = t.optimizer.params, t.photographs.cameras, t.options
        whole = splats.uniform_sh()
        found = bands(params, whole.sh_coeffs, cameras, options)
        background = t.photographs.background

        def energy(rule: ScoreRule) -> np.ndarray:
            return energies(rule, params, cameras, options, background, 0)[0]

        is_dog, has_slopes = (np.zeros(splats.n_splats, bool) for _ in range(2))
        is_dog[splats.dog_index], has_slopes[splats.slope_index] = True, True
        without_dog = energy(DOG) if splats.n_dog else np.zeros(splats.n_splats)
        without_slopes = np.where(has_slopes, np.inf, 0.0)
        if t.optimizer.n_slopes:
            without_slopes = slope_losses(params, cameras, options)
        losses = found.losses(), without_dog, splats.sh_degrees, is_dog, without_slopes, has_slopes
        return cls(energy(REMOVAL), *losses, found)

    def of_whole_primitives(self, means: np.ndarray) -> Options:
        """The same, when a primitive can only go or stay as it is; those that are outermost are the last to go.

        They are the bounds between which SOG has its positions. ``means``: [N, 3].
        """
        removal = self.removal.copy()
        removal[np.concatenate([means.argmin(axis=0), means.argmax(axis=0)])] = NEVER * max(removal.max(), 1.0)
        whole = np.arange(self.by_degree.shape[1]) == self.degrees[:, None]
        return replace(
            self,
            removal=removal,
            by_degree=np.where(whole, self.by_degree, np.inf),
            without_dog=np.where(self.is_dog, np.inf, self.without_dog),
            without_slopes=np.where(self.has_slopes, np.inf, self.without_slopes),
        )

    def chosen(self, prices: Prices, budget: float) -> Chosen:
        """What gains most for its bytes in a file of at most ``budget`` bytes, as far as prices tell."""
        n, highest = self.by_degree.shape[0], self.by_degree.shape[1] - 1
        plain = np.full((n, DEGREES), -np.inf)
        plain[:, : highest + 1] = self.removal[:, None] - self.by_degree
        plain[np.arange(DEGREES) > self.degrees[:, None]] = -np.inf
        values, bytes_of = plain, np.array(prices.bands)
        rows = [(self.is_dog, self.without_dog, prices.dog)]
        rows += [(self.has_slopes, self.without_slopes, prices.slopes)] if self.has_slopes.any() else []
        for has, without, price in rows:
            values = np.concatenate([values - without[:, None], np.where(has[:, None], values, -np.inf)], axis=1)
            bytes_of = np.concatenate([bytes_of, bytes_of + max(price, 1e-9)])
        values, bytes_of = np.concatenate([np.zeros((n, 1)), values], axis=1), np.append(0.0, bytes_of)
        choice = allocate(values, bytes_of, max(0.0, budget - prices.fixed))
        kept = np.flatnonzero(choice)
        what = choice[kept] - 1
        dog, slopes = what // DEGREES % 2, what // (2 * DEGREES)
        return Chosen(kept, what % DEGREES, np.flatnonzero(dog), np.flatnonzero(slopes))
