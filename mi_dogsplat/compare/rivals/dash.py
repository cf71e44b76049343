"""DashGaussian (Chen et al. 2025): small pictures and few primitives first, both after what the photographs hold.

Resolution: X(r), the share of the amplitude of the photographs' spectra that pictures r times smaller still have (the
window of frequencies below 1/r of the highest). Densification begins at the r with X(r) = 1/8, or 8, and is at that
r for which X has risen in proportion to the steps done: most steps see small pictures if small pictures hold most.
Factors are whole numbers here, and pictures are box-averaged like those of --downscale.

Primitives: N = N_0 + (N_max - N_0) / r^(2 - i/S) after step i of the S that densify, those with the largest gradients
first. The paper sets N_max by momentum from what would densify; here it is the budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...training.milestones import scaled_milestone
from ...training.presets import Recipe
from ...training.strategy.densify import Choice, Densification
from ...training.strategy.densify_stats import DensifyStats
from ...training.strategy.strategy import Strategy, Training
from .growth import START_SHARE, fill, progress

LARGEST = 8  # factor


def significance(images: Sequence[np.ndarray], largest: int = LARGEST) -> np.ndarray:
    """X(1), X(2), ... X(largest): share of the summed amplitudes of the spectra of images [H, W, C], falling from 1."""
    inside, total = np.zeros(largest), 0.0
    for image in images:
        amplitude = np.abs(np.fft.fft2(image, axes=(0, 1))).sum(-1)  # [H, W]
        y, x = (np.abs(np.fft.fftfreq(n)) * 2 for n in amplitude.shape)  # 1 is the highest
        total += amplitude.sum()
        for k in range(largest):
            inside[k] += amplitude[np.ix_(y <= 1 / (k + 1), x <= 1 / (k + 1))].sum()
    return inside / total


def resolution(significances: np.ndarray, progress: float) -> int:
    """The factor at ``progress`` 0 to 1 of densification."""
    first = int(np.flatnonzero(significances >= 1 / LARGEST)[-1])  # index of the smallest pictures
    level = significances[first] + (1 - significances[first]) * progress
    return 1 + int(np.flatnonzero(significances[: first + 1] >= level - 1e-12)[-1])


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
        return max(t.optimizer.n, planned)


@dataclass
class Spectra:
    """State of ``SmallPictures``: the significance of each factor, once it is known."""

    significance: np.ndarray


@dataclass(frozen=True)
class SmallPictures(Strategy[Spectra]):
    """Shows pictures that grow with the model."""

    stop: int = Densification.stop  # step from which on they are whole

    def scaled(self, factor: float) -> SmallPictures:
        return SmallPictures(scaled_milestone(self.stop, factor))

    def new_state(self, t: Training) -> Spectra:
        images = [view.image[..., :3] for view in t.photographs.originals]
        return Spectra(significance(images, min(LARGEST, *(min(image.shape[:2]) for image in images))))

    def before_step(self, t: Training, state: Spectra) -> None:
        whole = t.step_count >= self.stop
        t.photographs.shrink(1 if whole else resolution(state.significance, t.step_count / self.stop))


RECIPE = Recipe(
    densification=Densification(growth=GrowWithPictures()), also=(SmallPictures(),), start_share=START_SHARE
)
