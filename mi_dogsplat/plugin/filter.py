"""The film's reconstruction filter over the passes of a render.

A narrow filter is sampled: passes look at places that fall as it says, around the middle of every pixel, and all count
the same (Ernst, Stamminger and Greiner 2006, "Filter Importance Sampling"). So random numbers that fall evenly over the
passes do so with any such filter, pixels share no noise, and no sample is wasted where the filter is nearly 0. A wide
one spreads each sample over the pixels around it, as Mitsuba does: they have more samples together than one pixel has
alone. So does one with negative lobes, which cannot be sampled. For a denoiser wide ones are sampled, too: it takes the
noise of each pixel for its own.
"""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.parameters import device_array
from .film import image_block
from .samples import Sample

CELLS = 4096  # of the filter's extent, in which it is taken as constant
EVEN = 1e-3  # relative: rounding in the width of a box of one pixel


class Filter:
    """That of a film.

    border: pixels to sample around its window. apart: pixels are to share no noise, where that is possible.
    """

    def __init__(self, film: mi.Film, apart: bool = False):
        self.film, self.filter = film, film.rfilter()
        extent = self.filter.radius()
        self._edges = np.linspace(-extent, extent, CELLS + 1)
        middles = device_array((self._edges[1:] + self._edges[:-1]) / 2)  # aligned, as kernels differ where it is not
        self._values = np.array(self.filter.eval(middles), np.float64)
        self.sampled = self._values.min() >= 0 and (apart or self._width() <= 1 + EVEN)
        self.border = self.filter.border_size() if film.sample_border() and not self.sampled else 0

    def _width(self) -> float:
        """Pixels across of the box that would average as many samples: the variance of a pixel is inverse to its square
        where the samples of all pixels are independent."""
        return float(self._values.sum() ** 2 / (self._values**2).sum() * (self._edges[1] - self._edges[0]))

    def places(self, passes: list[Sample]) -> list[Sample]:
        """The passes at the places that the filter asks for, which then may lie beside the pixel. Their mean is the
        middle, so that no edge moves to either side."""
        if not self.sampled:
            return passes
        shares = np.concatenate([[0], np.cumsum(self._values)]) / self._values.sum()
        at = np.interp([[sample.x, sample.y] for sample in passes], shares, self._edges)
        at += 0.5 - at.mean(0)
        return [replace(sample, x=x, y=y) for sample, (x, y) in zip(passes, at.tolist(), strict=True)]

    def spread(self, planes: list[mi.Float], sample: Sample) -> list[mi.Float]:
        """Sums over the samples of a pass, per pixel, of each plane times the filter; last the sum of the filter."""
        width, height = self.film.crop_size()
        left, top = self.film.crop_offset()
        planes = [*planes, mi.Float(1)]
        if self.sampled:
            return [*planes[:-1], dr.full(mi.Float, 1, width * height)]
        size = width + 2 * self.border, height + 2 * self.border
        index = dr.arange(mi.UInt32, size[0] * size[1])
        columns = dr.opaque(mi.UInt32, size[0])
        y = index // columns
        column, row = mi.Float(index - y * columns), mi.Float(y)
        x, y = (
            dr.opaque(mi.Float, first - self.border + within)
            for first, within in zip((left, top), (sample.x, sample.y), strict=True)
        )
        block = image_block((width, height), (left, top), len(planes), self.filter, border=self.border > 0)
        block.set_coalesce(False)  # neighbouring lanes are neighbouring pixels, not samples of one
        block.put(mi.Point2f(column + x, row + y), planes)
        pixel = dr.arange(mi.UInt32, width * height)
        if self.border:  # of the block too: Mitsuba writes beyond one that a sample does not reach
            line = pixel // dr.opaque(mi.UInt32, width)
            pixel = dr.fma(line, 2 * self.border, pixel + dr.opaque(mi.UInt32, self.border * (size[0] + 1)))
        values = block.tensor().array
        return [dr.gather(mi.Float, values, dr.fma(pixel, len(planes), c)) for c in range(len(planes))]


def normalized(sums: list[mi.Float]) -> list[mi.Float]:
    """Weighted means from what ``Filter.spread`` returns, added up over the passes; 0 where there is no sample."""
    inverse = dr.select(sums[-1] != 0, dr.rcp(sums[-1]), 0)
    dr.make_opaque(inverse)  # the number of passes, where all count the same: a kernel for each would be compiled
    return [plane * inverse for plane in sums[:-1]]
