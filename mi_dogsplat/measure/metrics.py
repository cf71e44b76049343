"""How far a render is from the photograph: PSNR, SSIM, FLIP and L1.

Images are [H, W, 3], display-referred sRGB values in 0..1. Values outside 0..1 (signed blending can leave
the range) are clamped first, as a display would: all four metrics judge what is seen. A value that is not
finite is an error, because every mean over it would be meaningless.

A mask [H, W] says which pixels count: 1, or 0 for those that do not, where the render is taken to be the truth, so that
no window of SSIM or FLIP sees what is there. Means are then over the pixels that count, of which there must be one.

But for ``masked`` all functions raise ``ValueError`` if shapes differ or a value is NaN or infinite.
"""

from __future__ import annotations

import math
from typing import Any

import flip_evaluator
import numpy as np
from numpy.typing import ArrayLike, NDArray

# dB. Identical images have infinite PSNR, which JSON cannot hold; 8-bit rounding alone is at 59 dB.
PSNR_CAP = 100.0

SSIM_RADIUS, SSIM_SIGMA = 5, 1.5  # 11x11 Gaussian window
SSIM_C1, SSIM_C2 = 0.01**2, 0.03**2


def evaluate(
    image: ArrayLike,
    truth: ArrayLike,
    name: str = "image",
    mask: ArrayLike | None = None,
    mean_flip: float | None = None,
) -> dict[str, float]:
    """All metrics of one view, as plain floats that JSON can hold.

    Args:
        image: render [H, W, 3].
        truth: photograph [H, W, 3].
        name: what an error message calls the render (the name of the view).
        mask: pixels that count [H, W], at least one; None: all.
        mean_flip: what ``flip`` gave for these, where it is known; None: it is asked.

    Returns ``psnr`` in dB, at most ``PSNR_CAP``; ``ssim``, 1 if identical; ``flip`` and ``l1``, 0 if identical. Raises
    ``ValueError`` where shapes differ, or a value is NaN or infinite.
    """
    a, b = _displayed(image, truth, name)
    mean_flip = flip(a, b, mask)[0] if mean_flip is None else mean_flip
    return {"psnr": psnr(a, b, mask), "ssim": ssim(a, b, mask), "flip": mean_flip, "l1": l1(a, b, mask)}


def l1(image: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean absolute difference."""
    a, b = _displayed(image, truth)
    return _mean(np.abs(a - b), mask)


def psnr(image: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Peak signal-to-noise ratio in dB for peak 1, at most ``PSNR_CAP`` (reached by identical images)."""
    a, b = _displayed(image, truth)
    mse = _mean((a - b) ** 2, mask)
    return min(PSNR_CAP, -10 * math.log10(mse)) if mse > 0 else PSNR_CAP


def ssim(image: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean structural similarity over all pixels and channels, zero outside the image as in the 3DGS papers.

    scikit-image mirrors the border and leaves it out of its mean; everywhere else the maps are the same.
    """
    return _mean(ssim_map(masked(image, truth, mask), truth), mask)


def ssim_map(image: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Structural similarity per pixel and channel, [H, W, 3] (Wang et al. 2004, Gaussian window)."""
    a, b = _displayed(image, truth)
    result = np.empty_like(a)  # [H, W, 3]
    for c in range(3):  # channel by channel: a plane stays in the cache
        x, y = np.ascontiguousarray(a[..., c]), np.ascontiguousarray(b[..., c])  # [H, W]
        mean_x, mean_y = _blurred(x), _blurred(y)
        squares, product = mean_x**2 + mean_y**2, mean_x * mean_y
        variances = _blurred(x * x + y * y) - squares  # of x plus that of y: they occur only as a sum
        covariance = _blurred(x * y) - product
        result[..., c] = ((2 * product + SSIM_C1) * (2 * covariance + SSIM_C2)) / (
            (squares + SSIM_C1) * (variances + SSIM_C2)
        )
    return result


def flip(
    image: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None, name: str = "image"
) -> tuple[float, NDArray[np.float32]]:
    """LDR-FLIP (Andersson et al. 2020), 67 pixels per degree: the mean, and the error map [H, W] in 0..1.

    The library has threads of its own, and holds Python's lock meanwhile. ``name`` is that of ``evaluate``.
    """
    a, b = _displayed(masked(image, truth, mask), truth, name)
    error, _, _ = flip_evaluator.evaluate(  # reference first; inputsRGB: values are sRGB encoded, not linear
        np.ascontiguousarray(b, np.float32),
        np.ascontiguousarray(a, np.float32),
        "LDR",
        inputsRGB=True,
        applyMagma=False,
    )
    error_map = np.asarray(error, np.float32)[..., 0]  # [H, W]
    return _mean(error_map, mask), error_map


def color_corrected(image: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> NDArray[np.float64]:
    """The render after the affine map of colours that brings it nearest to the truth, in least squares, [H, W, 3].

    For photographs whose exposure nobody knows. Others correct otherwise (gsplat's affine map is per channel, fitted
    from the truth to the render and inverted), so that their numbers are not ours.
    """
    a, b = _displayed(image, truth)
    colors = np.concatenate([a, np.ones((*a.shape[:2], 1))], -1)  # [H, W, 4]
    counts = np.full(a.shape[:2], True) if mask is None else np.asarray(mask) > 0
    affine, *_ = np.linalg.lstsq(colors[counts], b[counts], rcond=None)  # [4, 3]
    return colors @ affine


def masked(image: ArrayLike, truth: ArrayLike, mask: ArrayLike | None) -> NDArray[Any]:
    """The render, but the truth where it does not count."""
    return np.asarray(image) if mask is None else np.where(np.asarray(mask)[..., None] > 0, image, truth)


def _mean(values: NDArray[Any], mask: ArrayLike | None) -> float:
    """Over the pixels that count of [H, W] or [H, W, 3]."""
    return float(np.mean(values if mask is None else values[np.asarray(mask) > 0], dtype=np.float64))


def _blurred(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convolution of [H, W] with the SSIM window, zero outside; one axis after the other."""
    offsets = np.arange(SSIM_RADIUS + 1)
    weights = np.exp(-0.5 * (offsets / SSIM_SIGMA) ** 2)
    weights /= weights[0] + 2 * weights[1:].sum()
    for axis in (0, 1):
        padding = [(0, 0), (0, 0)]
        padding[axis] = (SSIM_RADIUS, SSIM_RADIUS)
        padded = np.moveaxis(np.pad(plane, padding), axis, 0)
        size = plane.shape[axis]
        total = weights[0] * padded[SSIM_RADIUS : SSIM_RADIUS + size]
        for k in range(1, SSIM_RADIUS + 1):  # the window is symmetric: two rows share a weight
            before = padded[SSIM_RADIUS - k : SSIM_RADIUS - k + size]
            after = padded[SSIM_RADIUS + k : SSIM_RADIUS + k + size]
            total += weights[k] * (before + after)
        plane = np.moveaxis(total, 0, axis)
    return plane


def _displayed(
    image: ArrayLike, truth: ArrayLike, name: str = "image"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both images checked, float64 and clamped to 0..1."""
    a, b = np.asarray(image), np.asarray(truth)
    if a.shape != b.shape or a.ndim != 3 or a.shape[2] != 3 or a.size == 0:
        raise ValueError(f"{name} is {list(a.shape)}, its truth {list(b.shape)}; both need the same [H, W, 3]")
    for what, values in ((name, a), (f"the truth of {name}", b)):
        broken = ~np.isfinite(values)
        if broken.any():
            row, column, channel = np.argwhere(broken)[0]
            raise ValueError(
                f"{what} has values that are NaN or infinite: {np.count_nonzero(broken)} of {values.size}, "
                f"the first at row {row}, column {column}, channel {channel}"
            )
    return np.clip(a, 0, 1).astype(np.float64), np.clip(b, 0, 1).astype(np.float64)
