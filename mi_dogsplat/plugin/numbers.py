"""Random numbers of light paths, which over the passes of a render fall as evenly as they can.

Of each pair of numbers that a pixel draws at a vertex, the values of its passes are a Sobol sequence in two dimensions,
whose order and digits are shuffled by that pixel, vertex and pair (Burley 2020, "Practical Hash-based Owen
Scrambling"; padding as there). So each number alone is uniform, those of two pixels or pairs are independent, and 2^k
passes have one value in each of 2^k equal parts of the unit interval, and of the square.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from .samples import STREAM, Sample

HALVES = ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555))


class Streams:
    """What the rays of a wavefront draw from.

    Args:
        passes: of each of its views, which lie one after the other, the pass; all are of one render. One that has no
            number in a sequence has independent random numbers.
        pixels: of a view.
    """

    def __init__(self, passes: Sequence[Sample], pixels: int):
        numbers, first = [one.number for one in passes], passes[0]
        self._seed = first.seed if first.number is None else first.shared_seed
        self._pixels = dr.opaque(mi.UInt32, pixels)
        self._numbers: Any = None
        if first.number is not None:
            self._numbers = mi.UInt32(numbers)
            dr.make_opaque(self._numbers)

    def at(self, ray: Any, segment: int) -> Numbers:
        """What lanes draw at a vertex.

        Args:
            ray: [n] that of each lane.
            segment: at whose end the vertex is; -1 for what is drawn before the first.
        """
        view = ray // self._pixels
        number = None if self._numbers is None else dr.gather(mi.UInt32, self._numbers, view)
        return Numbers(ray - view * self._pixels, (self._seed + (segment + 1) * STREAM) % 2**32, number)


class Numbers:
    """Random numbers of pixels at a vertex, in [0, 1).

    Args:
        pixel: [n] of each lane.
        seed: of the vertex.
        number: [n] the place of the pass in the sequences; None: numbers are independent.
    """

    def __init__(self, pixel: Any, seed: int, number: Any):
        opaque: Any = dr.opaque(mi.UInt32, seed)
        state, sequence = mi.sample_tea_32(pixel, opaque)
        generator: Any = mi.PCG32
        self._generator = generator(1, mi.UInt64(state), mi.UInt64(sequence))
        self._reversed = None if number is None else dr.brev(number)

    def next_1d(self) -> Any:
        if self._reversed is None:
            return self._generator.next_float32()
        return _unit(_scrambled(self._place(), self._generator.next_uint32()))

    def next_2d(self) -> Any:
        if self._reversed is None:
            return mi.Point2f(self._generator.next_float32(), self._generator.next_float32())
        place = self._place()
        x, y = (_scrambled(p, self._generator.next_uint32()) for p in (place, _second_dimension(place)))
        return mi.Point2f(_unit(x), _unit(y))

    def _place(self) -> Any:
        """Of this pass in the shuffled sequence."""
        return dr.brev(_scrambled(self._reversed, self._generator.next_uint32()))


def _unit(x: Any) -> Any:
    """The number whose binary digits after the point are the bits of x, the last one first."""
    return mi.Float(dr.brev(x) >> 8) * 2**-24


def _scrambled(x: Any, key: Any) -> Any:
    """Each bit of x, flipped or not as the bits below it say: Owen scrambling of the reversed number.

    The hash is that of Laine and Karras (2011), with the constants of Vegdahl (2021).
    """
    x = x ^ x * mi.UInt32(0x3D20ADEA)
    x = (x + key) * ((key >> 16) | 1)
    x = x ^ x * mi.UInt32(0x05526C56)
    return x ^ x * mi.UInt32(0x53A22864)


def _second_dimension(place: Any) -> Any:
    """Of the Sobol sequence, its bits reversed: digits times Pascal's triangle modulo 2, halves of halves at a time."""
    for shift, low in HALVES:
        place = place ^ ((place >> shift) & low)
    return place
