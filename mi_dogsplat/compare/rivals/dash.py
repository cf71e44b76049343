"""DashGaussian (Chen et al. 2025): small pictures and few primitives first, both after what the photographs hold.

Resolution: X(r), the share of the amplitude of the photographs' spectra that pictures r times smaller still have (the
window of frequencies below 1/r of the highest). Densification begins at the largest r, at most 8, at which no
photograph keeps less than a quarter of its amplitude, X_0 there; after the part p of the steps that densify r is the
one with X(r) = X_0^(1 - p), so that the logarithm of X rises evenly, rounded down. Pictures are box-averaged like those
of --downscale. Position steps begin to fall when r does below 2. Of linear pictures the spectra are of what the loss
sees.

Primitives: N = N_0 + (N_max - N_0) / r^(2 - i/S) after step i of the S that densify, those with the largest gradients
first, and never a fifth more at once. The paper sets N_max by momentum from what would densify; here it is the budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...training.milestones import scaled_milestone
from ...training.recipe import Recipe
from ...training.strategy.densify import Choice, Densification
from ...training.strategy.densify_stats import DensifyStats
from ...training.strategy.strategy import Strategy, Training
from .growth import START_SHARE, fill, progress

DEVIATIONS = (
    "the budget is the count that momentum finds in the paper, which the last densification step fills, whatever its "
    "share; gradients have no threshold, so only the budget limits growth; primitives are removed as in 3DGS (the "
    "code: only by opacity); pictures grow at any step (the code: at densification steps); pictures are box-averaged "
    "(the code: resampled by Lanczos); that position steps then fall log-linearly to the end is our interpretation; a "
    "start of at most half the budget; checked with a public copy of the code"
)
LARGEST = 8  # factor
LEAST_SHARE = 0.25  # of a photograph's amplitude at the start
GROWTH = 1.2  # at most, of a refinement


def reach(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of an image [H, W, C]: 1 / r of each frequency, rising, and the amplitude up to it, [H W] each."""
    amplitude = np.abs(np.fft.fft2(image, axes=(0, 1))).sum(-1)  # [H, W]
    y, x = (np.abs(np.fft.fftfreq(n)) * 2 for n in amplitude.shape)  # 1 is the highest
    needed = np.maximum(y[:, None], x).ravel()
    order = np.argsort(needed, kind="stable")
    return needed[order], np.cumsum(amplitude.ravel()[order])


def share_at(factors: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Amplitude of an image within the window of each factor, not divided by the whole."""
    needed, total = reach(image)
    inside = np.searchsorted(needed, 1 / np.asarray(factors, float) + 1e-9, side="right")
    return np.concatenate([[0.0], total])[inside]


def largest_factor(image: np.ndarray) -> float:
    """The largest r at which an image keeps ``LEAST_SHARE`` of its amplitude."""
    needed, total = reach(image)
    return 1 / max(float(needed[np.searchsorted(total, LEAST_SHARE * total[-1])]), 1e-9)


@dataclass(frozen=True)
class Spectra:
    """What the photographs hold: ``start`` is X_0, ``shares`` X(1), X(2), ... up to the whole part of the first r."""

    start: float
    shares: np.ndarray

    @staticmethod
    def of(images: Sequence[np.ndarray]) -> Spectra:
        """Of images [H, W, C], which need not have one size."""
        smallest = min(min(image.shape[:2]) for image in images)
        first = max(1.0, min(float(LARGEST), float(smallest), *(largest_factor(image) for image in images)))
        factors = np.array([*range(1, int(first) + 1), first], float)
        inside = np.sum([share_at(factors, image) for image in images], axis=0)
        if inside[0] == 0:  # black: nothing tells small pictures from whole ones
            return Spectra(1.0, np.ones(1))
        return Spectra(float(inside[-1] / inside[0]), inside[:-1] / inside[0])

    def factor(self, progress: float) -> int:
        """r at ``progress`` 0 to 1 of densification, rounded down."""
        level = self.start ** (1 - min(progress, 1.0))
        return 1 + int(np.flatnonzero(self.shares >= level - 1e-12)[-1])

    @property
    def begins_to_fall(self) -> float:
        """Progress from which on r is below 2."""
        if len(self.shares) < 2 or self.start >= 1:
            return 0.0
        return max(0.0, 1 - float(np.log(self.shares[1]) / np.log(self.start)))


def count_at(factor: int, progress: float, start: int, end: int) -> int:
    """Primitives while pictures are ``factor`` times smaller."""
    return round(start + (end - start) / factor ** (2 - progress))


@dataclass(frozen=True)
class GrowWithPictures:
    """Who grows: those with the largest gradients, as many as pictures of this size are worth."""

    def __call__(self, t: Training, rule: Densification, stats: DensifyStats) -> Choice:
        return fill(t, rule, self.budget(t, rule), stats.mean_gradient)

    def budget(self, t: Training, rule: Densification) -> int:
        """Primitives after the refinement of this step."""
        count = int(t.target)
        if progress(t, rule) >= 1:
            return count
        planned = count_at(t.photographs.factor, t.step_count / rule.stop, min(t.n_start, count), count)
        return max(t.optimizer.n, min(planned, int(GROWTH * t.optimizer.n)))


@dataclass
class Shown:
    """State of ``SmallPictures``: the fields of ``Spectra``."""

    start: float
    shares: np.ndarray


@dataclass(frozen=True)
class SmallPictures(Strategy[Shown]):
    """Shows pictures that grow with the model, and holds the position steps until they are nearly whole."""

    stop: int = Densification.stop  # step from which on they are whole
    holds: bool = True

    def scaled(self, factor: float) -> SmallPictures:
        return SmallPictures(scaled_milestone(self.stop, factor), self.holds)

    def new_state(self, t: Training) -> Shown:
        images = [view.image for view in t.photographs.originals]
        if t.photographs.curve:  # of radiance a single lamp would have most of the amplitude, at all frequencies
            images = [t.photographs.as_seen(image) for image in images]
        spectra = Spectra.of([image[..., :3] for image in images])
        return Shown(spectra.start, spectra.shares)

    def before_step(self, t: Training, state: Shown) -> None:
        spectra, step = Spectra(state.start, state.shares), t.step_count
        t.photographs.shrink(1 if step >= self.stop else spectra.factor(step / self.stop))
        if self.holds:
            rates = t.optimizer.learning_rates
            first = spectra.begins_to_fall * self.stop
            falls = max(0.0, step - first) / max(rates.total_steps - first, 1)
            ratio = rates.means_end / rates.means_start
            t.optimizer.rate_factors["means"] = ratio ** (min(falls, 1.0) - min(step / max(rates.total_steps, 1), 1.0))


RECIPE = Recipe(
    densification=Densification(growth=GrowWithPictures()), also=(SmallPictures(),), start_share=START_SHARE
)
