"""Opacities from their logits, which is how models hold them; on the host."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def sigmoid(x: NDArray[Any]) -> NDArray[Any]:
    """Values in 0..1 of the type and shape of ``x``, accurate to full relative precision at both ends.

    Of ±∞ they are 1 and 0, of NaN NaN; nothing overflows.
    """
    e = np.exp(-np.abs(x))
    return np.where(x >= 0, np.ones_like(e), e) / (1 + e)
