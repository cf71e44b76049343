"""Standard deviations of primitives, which models hold as their logarithms."""

from __future__ import annotations

import math

SMALLEST_SCALE = 1e-30  # in place of 0, which has no logarithm: far below what float32 tells apart beside any other
SMALLEST_LOG_SCALE = math.log(SMALLEST_SCALE)
