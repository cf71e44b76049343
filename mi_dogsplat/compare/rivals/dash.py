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
from dataclasses import replace
from functools import cached_property

import numpy as np

from ...datasets.dataset import View
from ...datasets.images import box_downscale
from ...engine.project import DeviceCamera
from ...training.photographs import Photographs
from ...training.presets import Recipe
from .growth import Growth

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


class Dash(Growth):
    """Trains on pictures that grow with the model."""

    factor = 1

    @cached_property
    def _significance(self) -> np.ndarray:
        side = min(min(view.image.shape[:2]) for view in self.dataset.train)
        return significance([view.image[..., :3] for view in self.dataset.train], min(LARGEST, side))

    def _factor(self) -> int:
        stop = self.densification.stop
        return 1 if self.step_count >= stop else resolution(self._significance, self.step_count / stop)

    def step(self) -> dict:
        """As always, on pictures of the factor of this step."""
        if (factor := self._factor()) != self.factor:
            self.factor = factor
            self._show(factor)
        return super().step()

    def _show(self, factor: int) -> None:
        views = [
            View(view.name, view.camera.downscaled(factor), box_downscale(view.image, factor), view.straight)
            for view in self.dataset.train
        ]
        self.cameras = [DeviceCamera.upload(view.camera, self.config.near_clip) for view in views]
        exposure = self.photographs.exposure
        self.photographs = Photographs(self.config, replace(self.dataset, train=views), self.background)
        self.photographs.exposure = exposure

    def budget(self) -> int:
        if self.progress() >= 1:
            return self.count
        start = min(self.n_start, self.count)
        return max(
            self.optimizer.n, count_at(self.factor, self.step_count / self.densification.stop, start, self.count)
        )

    def growth_scores(self) -> np.ndarray:
        """The gradients that 3DGS densifies by."""
        return self.stats.mean_gradient()


RECIPE = Recipe()
