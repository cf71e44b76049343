"""The 3D filter of Mip-Splatting (Yu et al. 2024), which its files and those that follow it keep beside raw numbers.

Each primitive is drawn convolved with a Gaussian of its own width, the column ``filter_3D``, and as much fainter as its
volume grew. Viewers that pass over the column show primitives that are too thin and too opaque.
"""

from __future__ import annotations

import numpy as np

from .opacity import LARGEST_LOGIT
from .row_groups import Array


def filtered(log_scales: Array, logit_opacities: Array, widths: Array) -> tuple[Array, Array]:
    """Log scales [N, 3] and logits of opacities [N] as they are drawn; a width [N] of 0 leaves a primitive as it is.

    A scale s becomes sqrt(s² + f²), and an opacity is multiplied by the old scales over the new ones.
    """
    before, logits = log_scales.astype(np.float64), logit_opacities.astype(np.float64)
    with np.errstate(divide="ignore"):  # log 0 = -∞ is what it is meant to be
        after = np.logaddexp(2 * before, 2 * np.log(np.abs(widths.astype(np.float64)))[:, None]) / 2  # [N, 3]
        log_opacities = (before - after).sum(axis=1) - np.logaddexp(0, -logits)
        faded = log_opacities - np.log(-np.expm1(log_opacities))
    faded = np.clip(faded, -np.inf, max(LARGEST_LOGIT, logits.max(initial=0)))
    return after, np.where(widths == 0, logits, faded)
