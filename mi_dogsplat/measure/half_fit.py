"""PSNR on one half of a photograph after its exposure was fitted on the other: what a test image can be judged by.

Nobody has learned the exposure of a test photograph. As in NeRF in the Wild (Martin-Brualla et al. 2021, Sec. 5) it is
found on the left half, and the right half is measured. Here it is the gains
that ``scene/appearance.py`` explains, by least squares, and the vignetting of the camera is as learned.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from ..scene.appearance import N_OF_DEVICE, N_OF_IMAGE, photographed
from .metrics import psnr

MAX_PIXELS = 20_000  # that are fitted, in even steps
BOUND = 6.0  # EV
STEP = 1e-3  # of differences, as pictures are in float32


def half_psnr(
    image: ArrayLike,
    truth: ArrayLike,
    r_sq: NDArray[np.float64],
    vignetting: ArrayLike = (0.0,) * N_OF_DEVICE,
    mask: ArrayLike | None = None,
) -> float:
    """PSNR in dB of the right half, after the gains of the image were fitted on the left one.

    Args:
        image: what the model shows, [H, W, 3].
        truth: the photograph, [H, W, 3].
        r_sq: squared distance from the centre, 1 at the corner, [H, W].
        vignetting: of its camera, [2].
        mask: pixels that count [H, W]; None: all.

    Where no pixel of a half counts, that half is fitted by nothing, or measured whole.
    """
    image, truth = np.asarray(image, np.float64), np.asarray(truth, np.float64)
    half = image.shape[1] // 2
    counts = np.full(image.shape[:2], True) if mask is None else np.asarray(mask) > 0
    left, right = counts.copy(), counts.copy()
    left[:, half:], right[:, :half] = False, False
    right = right if right.any() else counts
    numbers = np.concatenate([fitted_gains(image[left], truth[left], r_sq[left], vignetting), vignetting])
    return psnr(photographed(image, r_sq, numbers), truth, right)


def fitted_gains(
    image: NDArray[np.float64], truth: NDArray[np.float64], r_sq: NDArray[np.float64], vignetting: ArrayLike
) -> NDArray[np.float64]:
    """The gains [3] that bring pixels [P, 3] nearest to the truth in least squares."""
    step = max(1, len(image) // MAX_PIXELS)
    image, truth, r_sq = image[::step], truth[::step], r_sq[::step]
    if not len(image):
        return np.zeros(N_OF_IMAGE)

    def residuals(of_image: NDArray[np.float64]) -> NDArray[np.float64]:
        shown = photographed(image, r_sq, np.concatenate([of_image, vignetting]))
        return (np.clip(shown, 0, 1) - truth).ravel()

    return least_squares(residuals, np.zeros(N_OF_IMAGE), bounds=(-BOUND, BOUND), diff_step=STEP).x
