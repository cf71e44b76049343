"""Where the passes of a render with several samples per pixel look: inside of the pixels, and through the lens.

A pass is a whole image by one pinhole. All its pixels are sampled at the same place inside of them, and through the
same point of the lens, so that it is as cheap as a render of one sample. Over the passes these places cover the pixel,
and the lens, evenly, and their mean is the middle, so that no edge moves to either side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST_PASSES = 2**18  # of a render: their places are all known before the first
STREAM = 0x9E3779B9  # between seeds
CENTERINGS = 8  # moving all to the middle pushes some against the border, and the mean off again, a little less
# Multiples of such numbers cover the unit interval evenly, and pairs of them the unit square: the first two are best
# for a square (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences"), the other two nearly so.
STEPS = (0.7548776662466927, 0.5698402909980532, 3 ** (1 / 3) % 1, 9 ** (1 / 3) % 1)


@dataclass(frozen=True)
class Sample:
    """One pass. Places are in [0, 1), and around that where a filter is sampled (``filter.py``)."""

    x: float = 0.5  # inside of every pixel, from its left
    y: float = 0.5  # from its top
    lens_x: float = 0.5  # of the square that Mitsuba maps to the lens
    lens_y: float = 0.5
    seed: int = 0  # of random numbers that the pass needs for itself
    number: int | None = None  # of the pass among those that share out random numbers, None for one that has its own
    shared_seed: int = 0  # of those


def samples(count: int, seed: int = 0, first: int | None = None) -> list[Sample]:
    """The passes of a render: one through the centres of pixels and lens, or several that cover both evenly.

    ``seed`` moves the places of several samples; renders of different seeds are independent. ``first``: the number of
    the first pass, where a render goes on from others of the same seed.
    """
    if count == 1 and first is None:
        return [Sample(seed=seed)]
    start = np.random.default_rng(seed).random(4)
    numbers = np.arange(count) + (first or 0)
    places = (start + numbers[:, None] * STEPS) % 1  # [count, 4]
    for _ in range(CENTERINGS):
        places = np.clip(places + 0.5 - places.mean(0), 0, np.nextafter(np.float32(1), np.float32(0)))
    seeds = seed * count + numbers if first is None else seed + numbers * STREAM
    return [
        Sample(*map(float, place), seed=int(own) % 2**32, number=int(k), shared_seed=seed % 2**32)
        for place, own, k in zip(places, seeds, numbers, strict=True)
    ]
