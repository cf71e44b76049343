"""Primitives that a plane cuts off: what all that draw them agree on (docs/cuts.md)."""

import math

OFFSET = 4.0  # o: a kernel is multiplied by (1 + e^-o) / (1 + e^(-o - n·w)), so the plane lies at n·w = -o
LARGEST = 1 + math.exp(-OFFSET)  # what that factor tends to, far on the side that is kept
STEEPEST = 16.0  # change of n·w from pixel to pixel: no fall is steeper in a picture, where it then takes .3 px
