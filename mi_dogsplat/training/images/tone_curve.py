"""The curve through which the loss sees linear radiance: an error counts by how visible it is, not by how bright.

An absolute error of radiance is all about lamps, of which a pixel may outweigh a room. Through a curve that falls in
slope as 1 / x, errors of bright pixels count relative to their brightness, as in RawNeRF's loss (Mildenhall et al.
2022); through one that is the sRGB curve below white, what lies there counts as in a training on photographs, and
thresholds, step sizes and the constants of SSIM, which were found there, mean what they did. Which curve and why:
docs/hdr.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr

from ...engine.srgb import encoded, encoded_slope_of
from ...support.srgb import WHITE_SLOPE


class ToneCurve(Protocol):
    """Increasing, with a continuous slope; 0 stays 0. Of planes on the device, in units of white."""

    def __call__(self, x: Any) -> Any:
        """The curve."""
        ...

    def slope(self, x: Any) -> Any:
        """Its derivative."""
        ...


@dataclass(frozen=True)
class SrgbLog:
    """The sRGB curve up to white, from there on the logarithm that continues it: 1 + 0.44 ln x."""

    def __call__(self, x: Any) -> Any:
        """The curve; below 0 it goes on as a line."""
        above = dr.fma(WHITE_SLOPE, dr.log(dr.maximum(x, 1)), 1)
        return dr.select(x > 1, above, encoded(x))

    def slope(self, x: Any) -> Any:
        """Its derivative."""
        return dr.select(x > 1, WHITE_SLOPE / dr.maximum(x, 1), encoded_slope_of(x))
