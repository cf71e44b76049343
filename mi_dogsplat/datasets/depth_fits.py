"""What the values of a depth map mean, by the sparse points that its view sees.

Phones measure depth, and some networks estimate it, with an unknown unit: z = scale * value. Others (MiDaS and DPT,
Ranftl et al. 2020 and 2021; Depth Anything, Yang et al. 2024) estimate relative inverse depth: 1 / z = scale * value +
offset, with another scale and offset for each photograph. In the first kind what is farther away has a larger value, in
the second a smaller one.

Some points are wrong, or lie beside an edge of the map, so all of it is robust: against up to half of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

UNCLEAR = 0.2  # rank correlations nearer to 0 tell neither depth nor inverse depth
MOST_PAIRED = 400  # points; the pairs of as many give the first line
STEPS = 5  # by which the line is refined
OUTLIER = 3.0  # times the median error: farther off a point has no say in the line


@dataclass(frozen=True, eq=False)
class Samples:
    """A map at the points that its view sees: its ``values`` [M] and their depths ``z`` [M], float64, all above 0."""

    values: np.ndarray
    z: np.ndarray


@dataclass(frozen=True)
class Fit:
    """Depth z by the values of a map: z = ``scale`` * value, or if ``inverse`` 1 / z = ``scale`` * value + ``offset``.

    ``error``: median relative error of the depth at the points.
    """

    scale: float
    offset: float
    inverse: bool
    error: float = np.inf

    def depth(self, values: np.ndarray) -> np.ndarray:
        """Depths of values of any shape, in their precision; 0 where the value is not above 0, or its inverse depth is
        not."""
        scale, offset = values.dtype.type(self.scale), values.dtype.type(self.offset)
        if not self.inverse:
            return values * scale
        inverse = np.where(values > 0, values * scale + offset, 0)
        known = inverse > 1 / np.finfo(values.dtype).max
        return np.where(known, 1 / np.where(known, inverse, 1), 0)


def depth_correlation(maps: Iterable[Samples]) -> float:
    """Rank correlation (Spearman) of values with depths within each map, over the points of all maps: near 1 for depth,
    near -1 for inverse depth; 0 where all values of each map are equal."""
    ranks = [(_ranks(samples.values), _ranks(samples.z)) for samples in maps]
    values, z = (np.concatenate(all_of) for all_of in zip(*ranks, strict=True))
    size = np.sqrt((values @ values) * (z @ z))
    return float(values @ z / size) if size > 0 else 0.0


def fitted(samples: Samples, inverse: bool) -> Fit:
    """The line that takes a map to its points. ``Fit.error`` is infinite where nearer things would be farther away."""
    if inverse:
        line = _refined(samples, _repeated_median(samples.values, 1 / samples.z))
        fit = Fit(*line, inverse=True)
    else:
        fit = Fit(float(np.median(samples.z / samples.values)), 0.0, inverse=False)
    if fit.scale <= 0:
        return fit
    error = float(np.median(np.abs(fit.depth(samples.values) / samples.z - 1)))
    return Fit(fit.scale, fit.offset, inverse, error)


def _ranks(values: np.ndarray) -> np.ndarray:
    """Ranks [M] around 0, in -1..1; equal values have the mean of theirs."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    return ((2 * np.cumsum(counts) - counts - len(values)) / len(values))[which]


def _repeated_median(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """(slope, offset) of the line y = slope x + offset (Siegel 1982): the median over points of the median slope to all
    others. Up to half of the points may be anywhere. (0, median of y) where all x are equal."""
    some = np.linspace(0, len(x) - 1, min(len(x), MOST_PAIRED)).astype(np.intp)
    x, y = x[some], y[some]
    slopes = []
    for at, value in zip(x, y, strict=True):
        others = x != at
        if others.any():
            slopes.append(np.median((y[others] - value) / (x[others] - at)))
    slope = float(np.median(slopes)) if slopes else 0.0
    return slope, float(np.median(y - slope * x))


def _refined(samples: Samples, line: tuple[float, float]) -> tuple[float, float]:
    """The line 1 / z of least squares, of relative errors, over the points that are near to the one before: it has a
    third of the error where a third of the points are wrong."""
    slope, offset = line
    for _ in range(STEPS):
        error = np.abs(samples.z * (slope * samples.values + offset) - 1)
        near = error <= OUTLIER * np.median(error)
        z = samples.z[near]
        columns = np.column_stack([z * samples.values[near], z])
        slope, offset = np.linalg.lstsq(columns, np.ones(len(z)), rcond=None)[0]
    return float(slope), float(offset)
