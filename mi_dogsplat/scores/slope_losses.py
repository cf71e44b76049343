"""What slopes contribute to the training views, primitive by primitive: an estimate in the units of the other scores.

Without its slopes s_a a primitive has one colour all over, and the pictures change by α T Σ w_a s_a. With T nearly the
same all over it, (α T)² falls as exp(-|z|²), z the pixel in standard deviations of the kernel on the screen, so that
each axis of z has a mean square of 1/2. There w is z in the plane of the primitive's own axes that the view shows: all
but the direction x = S⁻¹ Rᵀ d, along which the ray d runs. The energy of the change is

    h / 2 Σ_c |s_c - x̂ (x̂·s_c)|²,   h = Σ (α T)² over the pixels,

of which h is known for all views together (``scores/bands.py``), and the rest is the mean over the views. What the
low-pass filter takes from slopes of primitives as small as a pixel is left out, and so is that something in front may
hide one side: measured against the pictures, within 3 % for one primitive alone (tests/scores/test_slope_losses.py).
"""

from __future__ import annotations

import numpy as np

from ..scene.quaternions import rotation_from_quaternion
from ..scene.splats import Splats

ROWS = 4096  # primitives at a time, which bounds the memory


def slope_losses(splats: Splats, weights: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """[N] energy of the change of the pictures without the slopes of a primitive; 0 where it has none.

    Args:
        weights: [N] h, squares of what each primitive weighs in the pixels of all views.
        positions: [V, 3] of the cameras, world space.
    """
    losses = np.zeros(splats.n_splats)
    for start in range(0, splats.n_slopes, ROWS):
        rows = slice(start, start + ROWS)
        index = splats.slope_index[rows]
        rays = splats.means[index, None].astype(np.float64) - positions  # [n, V, 3]
        x = np.einsum("nji,nvj->nvi", rotation_from_quaternion(splats.quats[index]), rays)
        x /= splats.scales[index, None]
        x /= np.maximum(np.linalg.norm(x, axis=2, keepdims=True), np.finfo(np.float64).tiny)
        slopes = splats.color_slopes[rows].astype(np.float64)  # [n, axis, channel]
        hidden = np.square(np.einsum("nva,nac->nvc", x, slopes)).sum(axis=2).mean(axis=1)
        losses[index] = weights[index] / 2 * (np.square(slopes).sum(axis=(1, 2)) - hidden)
    return losses
