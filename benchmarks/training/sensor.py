"""A camera's sensor, simulated: what it records of radiance in one exposure, with its noise and where it is full."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WELL = 20_000  # electrons of a full pixel
READ_NOISE = 4  # electrons, standard deviation
LEVELS = 2**14 - 1


@dataclass(frozen=True)
class Sensor:
    """A sensor whose pixels are full at the radiance ``full``."""

    full: float

    def recorded(self, radiance: NDArray, rng: np.random.Generator) -> NDArray[np.float32]:
        """Of radiance of any shape: with the noise of light and of reading, in levels, between 0 and ``full``."""
        electrons = rng.poisson(np.asarray(radiance, np.float64) / self.full * WELL)
        levels = np.rint((electrons + rng.normal(scale=READ_NOISE, size=electrons.shape)) / WELL * LEVELS)
        return (np.clip(levels, 0, LEVELS) / LEVELS * self.full).astype(np.float32)
