"""Where the passes of a render with several samples per pixel look: inside of the pixels, and through the lens.

A pass is a whole image by one pinhole. All its pixels are sampled at the same place inside of them, and through the
same point of the lens, so that it is as cheap as a render of one sample. Over the passes these places cover the pixel,
and the lens, evenly. They come in pairs that are mirror images of each other, which moves no edge to either side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Multiples of such numbers cover the unit interval evenly, and pairs of them the unit square: the first two are best
# for a square (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences"), all four are independent.
STEPS = (0.7548776662466927, 0.5698402909980532, 2**0.5 - 1, 3**0.5 - 1)


@dataclass(frozen=True)
class Sample:
    """One pass. All but the seed are in [0, 1)."""

    x: float = 0.5  # inside of every pixel, from its left
    y: float = 0.5  # from its top
    lens_x: float = 0.5  # of the square that Mitsuba maps to the lens
    lens_y: float = 0.5
    seed: int = 0  # of random numbers that the pass needs


def samples(count: int, seed: int = 0) -> list[Sample]:
    """The passes of a render: one through the centres of pixels and lens, or several that cover both evenly.

    ``seed`` moves the places of several samples; renders of different seeds are independent.
    """
    start = np.random.default_rng(seed).random(4)
    half = (start + np.arange(count // 2)[:, None] * STEPS) % 1  # [count // 2, 4]
    mirrored = np.minimum(1 - half, np.nextafter(1, 0))
    places = np.concatenate([np.full((count % 2, 4), 0.5), half, mirrored])
    return [Sample(*map(float, place), seed=(seed * count + k) % 2**32) for k, place in enumerate(places)]
