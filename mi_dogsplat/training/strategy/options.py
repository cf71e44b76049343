"""What a primitive may be left with, and what that loses and costs: the options among which bytes are divided.

Option 0 is to be removed. Then come the bands of colour up to degree 0, 1, 2, 3 of those that it has: without and with
its DoG row, all these again with its slopes, and so on with its curvatures, its cut and its second cut. The loss of
each is in one unit, the energy of the change of the training pictures (``scores/``), and is measured as if nothing else
changed: of a removal by leave-one-out, of bands with the others fitted anew, of a DoG row by the pictures with the
primary alone, of a cut by those without it; those of slopes and curvatures are estimates. What an option is worth is
the loss of a removal minus its own. What is lost without shifts is not measured: they stay with their primitive, and
raise its price.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...formats.sizes import Prices
from ...scene.row_groups import CURVATURES, CUTS, DOG, MAX_SH_DEGREE, SECOND_CUTS, SHIFTS, SLOPES, RowGroup
from ...scene.splats import Splats
from ...scores.bands import Bands, bands
from ...scores.score import ScoreRule, energies
from ...scores.slope_losses import curvature_losses, slope_losses
from .allocation import allocate
from .strategy import Training

REMOVAL = ScoreRule("leave-one-out", spectral_weight=0.0)
NO_DOG = ScoreRule("leave-dog-out", spectral_weight=0.0)
NO_CUT = ScoreRule("leave-cut-out", spectral_weight=0.0)
NO_SECOND_CUT = ScoreRule("leave-second-cut-out", spectral_weight=0.0)
DEGREES = MAX_SH_DEGREE + 1
NEVER = 1e6  # times as much as the primitive that matters most


@dataclass(frozen=True)
class Chosen:
    """What an allocation leaves."""

    kept: np.ndarray  # [n] rows, increasing
    degrees: np.ndarray  # [n] their SH degrees
    rows: Mapping[RowGroup, np.ndarray]  # of each group of ``Options``: who keeps its row, as places [m] in ``kept``


@dataclass(frozen=True)
class Rows:
    """Of a group of rows: who has one, and what is lost without it."""

    has: np.ndarray  # [N]
    without: np.ndarray  # [N], 0 where there is none

    @classmethod
    def of(cls, index: np.ndarray, n: int, losses: np.ndarray | float) -> Rows:
        """Of the primitives ``index`` of ``n``; ``losses`` [N] without a row, or one for all."""
        has = np.isin(np.arange(n), index)
        return cls(has, np.where(has, losses, 0.0))

    @property
    def held(self) -> Rows:
        """Where no row may go."""
        return replace(self, without=np.where(self.has, np.inf, self.without))

    @property
    def stay(self) -> bool:
        """Whether no row may go."""
        return not np.isfinite(self.without[self.has]).any()


@dataclass(frozen=True)
class Options:
    """Of all primitives of a model."""

    removal: np.ndarray  # [N] what is lost without the primitive
    by_degree: np.ndarray  # [N, highest degree + 1] ... without the bands above
    degrees: np.ndarray  # [N] that it has
    rows: Mapping[RowGroup, Rows]  # that may go: of DoG, slopes, curvatures and cuts, where the model has any
    shifted: np.ndarray  # [N] bool, whether it has a row of shifts, which stays with it
    bands: Bands

    @classmethod
    def of(cls, t: Training, splats: Splats) -> Options:
        """Measured over all training views of a run, as its loss sees them, linear ones through the curve.

        ``splats`` is its model, with rows that are to come.
        """
        params, views = t.optimizer.params, t.training_views
        n, whole = splats.n_splats, splats.uniform_sh()
        found = bands(params, whole.sh_coeffs, views)

        def energy(rule: ScoreRule) -> np.ndarray:
            return energies(rule, params, views, seed=0)[0]

        measures = {
            DOG: lambda: energy(NO_DOG),
            SLOPES: lambda: slope_losses(params, views),
            CURVATURES: lambda: curvature_losses(params, views),
            CUTS: lambda: energy(NO_CUT),
            SECOND_CUTS: lambda: energy(NO_SECOND_CUT),
        }
        rows = {}
        for group, losses in measures.items():
            index = getattr(splats, group.index)
            if len(index):
                trained = len(t.optimizer.index_of(group)) > 0
                rows[group] = Rows.of(index, n, losses() if trained else np.inf)  # what is to come is as good as needed
        shifted = np.isin(np.arange(n), splats.shift_index)
        return cls(energy(REMOVAL), found.losses(), splats.sh_degrees, rows, shifted, found)

    def of_whole_primitives(self, means: np.ndarray) -> Options:
        """The same, when a primitive can only go or stay as it is; those that are outermost are the last to go.

        They are the bounds between which SOG has its positions. ``means``: [N, 3].
        """
        removal = self.removal.copy()
        removal[np.concatenate([means.argmin(axis=0), means.argmax(axis=0)])] = NEVER * max(removal.max(), 1.0)
        whole = np.arange(self.by_degree.shape[1]) == self.degrees[:, None]
        by_degree = np.where(whole, self.by_degree, np.inf)
        rows = {group: rows.held for group, rows in self.rows.items()}
        return replace(self, removal=removal, by_degree=by_degree, rows=rows)

    def chosen(self, prices: Prices, budget: float) -> Chosen:
        """What gains most for its bytes in a file of at most ``budget`` bytes, as far as prices tell."""
        free = [group for group, rows in self.rows.items() if not rows.stay]
        values, bytes_of = self._table(prices, free)
        choice = allocate(values, bytes_of, max(0.0, budget - prices.fixed))
        kept = np.flatnonzero(choice)
        what = choice[kept] - 1  # degree, and DEGREES << k if it keeps its row of the k-th group that is free
        rows = {group: np.flatnonzero(self.rows[group].has[kept]) for group in self.rows}
        rows |= {group: np.flatnonzero(what // (DEGREES << k) % 2) for k, group in enumerate(free)}
        return Chosen(kept, what % DEGREES, rows)

    def _table(self, prices: Prices, free: Sequence[RowGroup]) -> tuple[np.ndarray, np.ndarray]:
        """(values [N, options], bytes [options] or [N, options]), as ``allocate`` takes them: to go, then each degree,
        then for each group that is ``free`` all of these again with its row kept."""
        n, highest = self.by_degree.shape[0], self.by_degree.shape[1] - 1
        values, bytes_of = np.full((n, DEGREES), -np.inf), np.array(prices.bands)
        values[:, : highest + 1] = self.removal[:, None] - self.by_degree
        values[np.arange(DEGREES) > self.degrees[:, None]] = -np.inf
        for group in free:
            rows = self.rows[group]
            having = np.where(rows.has[:, None], values, -np.inf)
            values = np.concatenate([values - rows.without[:, None], having], axis=1)
            bytes_of = np.concatenate([bytes_of, bytes_of + _price(prices, group)])
        values, bytes_of = np.concatenate([np.zeros((n, 1)), values], axis=1), np.append(0.0, bytes_of)
        own = self._bytes_that_stay(prices, free)
        return values, bytes_of + np.outer(own, bytes_of > 0) if own.any() else bytes_of

    def _bytes_that_stay(self, prices: Prices, free: Sequence[RowGroup]) -> np.ndarray:
        """[N] of rows that stay with a primitive: no option, but dearer ones."""
        own = prices.rows[SHIFTS] * self.shifted
        for group, rows in self.rows.items():
            if group not in free:
                own = own + _price(prices, group) * rows.has
        return own


def _price(prices: Prices, group: RowGroup) -> float:
    """Bytes of a row; above 0, as ``allocate`` needs it."""
    return max(prices.rows[group], 1e-9)
