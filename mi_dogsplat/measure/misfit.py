"""Why a photograph differs from the render of a model: what part of the squared error each likely cause explains.

======== =======================================================================================================
exposure the render after the affine map of its colours that fits best (``metrics.color_corrected``)
pose     the render after the affine motion that fits best, by Gauss-Newton from coarse to fine (Lucas and Kanade 1981)
blur     the render blurred, by the Gaussian or the motion along a line that fits best
region   all but the connected part of the picture where most of the error is: something stands in the way, or moved
======== =======================================================================================================

A cause is what explains much more than it does in other views: every view gains a little from each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label, map_coordinates

from .metrics import color_corrected

Image = NDArray[np.float64]
CAUSES = ("exposure", "pose", "blur", "region")
LONGEST = 400  # pixels of a side in which causes are looked for
COARSE_TO_FINE = (8.0, 4.0, 2.0, 1.0, 0.0)  # standard deviations of the blur under which motion is found, pixels
ITERATIONS = 3
DEVIATIONS = (0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # of Gaussians, pixels
LINES = (2, 4, 7, 11)  # half lengths of motions, pixels
DIRECTIONS = ((1, 0), (0, 1), (1, 1), (1, -1))
BLOCKS = 24  # along the longer side, by which regions are found
MOST_REGION = 0.3  # of the picture: a larger part is no region
TIMES_MEDIAN = 4.0  # what the error of a block of a region is, at least, over that of most blocks
CLEAR = 0.25  # what a cause explains more than in other views, at least
FINE = 1.0  # standard deviation below which detail is fine, pixels


def explained(render: Image, photograph: Image, mask: NDArray | None = None) -> dict[str, float]:
    """The share of the squared error, 0..1, that each of ``CAUSES`` explains.

    Args:
        render, photograph: [H, W, 3], display values.
        mask: pixels that count [H, W]; None: all.
    """
    counts = np.ones(photograph.shape[:2]) if mask is None else np.asarray(mask, np.float64)
    render, photograph, counts = (_shrunk(image) for image in (render, photograph, counts[..., None]))
    counts = counts[..., 0]
    before = _error(render - photograph, counts)
    if before <= 0:
        return dict.fromkeys(CAUSES, 0.0)
    grey, truth = render.mean(axis=2), photograph.mean(axis=2)
    in_grey = max(_error(grey - truth, counts), 1e-12)
    corrected = np.asarray(color_corrected(render, photograph, counts > 0.5 if mask is not None else None))
    after = {
        "exposure": _error(corrected - photograph, counts) / before,
        "pose": _error_after_motion(grey, truth, counts) / in_grey,
        "blur": min(_error(blurred - truth, counts) for blurred in _blurred(grey)) / in_grey,
        "region": _error_outside(((render - photograph) ** 2).mean(axis=2) * counts),
    }
    return {cause: float(np.clip(1 - share, 0, 1)) for cause, share in after.items()}


def likely_cause(found: Mapping[str, float], usual: Mapping[str, float]) -> str:
    """The cause that explains most beyond what is usual; empty where none stands out by ``CLEAR``."""
    beyond = {cause: found[cause] - usual[cause] for cause in CAUSES}
    best = max(CAUSES, key=lambda cause: beyond[cause])
    return best if beyond[best] >= CLEAR else ""


def usual_shares(views: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The median of each cause over views."""
    return {cause: float(np.median([view[cause] for view in views])) if views else 0.0 for cause in CAUSES}


def relative_sharpness(render: Image, photograph: Image, mask: NDArray | None = None) -> float:
    """Logarithm of the energy of fine detail in a photograph over that in its render."""
    counts = np.ones(photograph.shape[:2]) if mask is None else np.asarray(mask, np.float64)
    energy = []
    for image in (photograph, render):
        red, green, blue = np.moveaxis(np.asarray(image), 2, 0)
        grey = (red.astype(np.float64) + green + blue) / 3  # the bits of ``mean``, in a tenth of the time
        energy.append(_error(grey - gaussian_filter(grey, FINE), counts))
    return float(np.log(max(energy[0], 1e-12) / max(energy[1], 1e-12)))


def _error(difference: Image, counts: Image) -> float:
    """Mean square over the pixels that count."""
    squares = difference**2 if difference.ndim == 2 else (difference**2).mean(axis=2)
    return float((squares * counts).sum() / max(float(counts.sum()), 1e-12))


def _shrunk(image: NDArray) -> Image:
    """[H, W, C] by means of k x k pixels, so that no side is much longer than ``LONGEST``, as far as there are k."""
    k = min(*image.shape[:2], max(1, -(-max(image.shape[:2]) // LONGEST)))
    height, width = (side // k * k for side in image.shape[:2])
    blocks = np.asarray(image[:height, :width], np.float64).reshape(height // k, k, width // k, k, -1)
    return blocks.mean(axis=(1, 3))


def _error_after_motion(grey: Image, truth: Image, counts: Image) -> float:
    """Mean square after the affine motion of the render that fits best."""
    height, width = grey.shape
    rows, columns = np.mgrid[:height, :width].astype(np.float64)
    size = max(height, width) / 2
    basis = np.stack([np.ones_like(grey), (columns - width / 2) / size, (rows - height / 2) / size])  # [3, H, W]
    motion, best = np.zeros((2, 3)), _error(grey - truth, counts)  # x and y of the motion, by the basis
    for deviation in COARSE_TO_FINE:
        a, b = (gaussian_filter(image, deviation) if deviation else image for image in (grey, truth))
        smooth = gaussian_filter(a, max(deviation, 0.5))
        slopes = [_slope(smooth, axis) for axis in (1, 0)]  # by x, by y
        for _ in range(ITERATIONS):
            x, y = _moved(motion, basis, columns, rows)
            moved = _at(a, x, y)
            J = np.concatenate([_at(slope, x, y) * basis for slope in slopes])  # [6, H, W], by the motion
            weighted = (J * counts).reshape(6, -1)
            normal = weighted @ J.reshape(6, -1).T  # of least squares, as the right side is
            right = weighted @ (b - moved).ravel()
            motion = motion + np.linalg.lstsq(normal, right, rcond=1e-6)[0].reshape(2, 3)
        best = min(best, _error(_at(grey, *_moved(motion, basis, columns, rows)) - truth, counts))
    return best


def _slope(image: Image, axis: int) -> Image:
    return np.gradient(image, axis=axis) if image.shape[axis] > 1 else np.zeros_like(image)


def _moved(motion: Image, basis: Image, columns: Image, rows: Image) -> tuple[Image, Image]:
    """Where in the render the pixels are, x and y [H, W]."""
    return columns + np.tensordot(motion[0], basis, 1), rows + np.tensordot(motion[1], basis, 1)


def _at(image: Image, x: Image, y: Image) -> Image:
    return map_coordinates(image, (y, x), order=1, mode="nearest")


def _blurred(grey: Image) -> list[Image]:
    """The render under each of the blurs."""
    found = [gaussian_filter(grey, deviation, mode="nearest") for deviation in DEVIATIONS]
    for dx, dy in DIRECTIONS:
        for half in LINES:
            padded = np.pad(grey, half, mode="edge")
            height, width = grey.shape
            steps = [(half + k * dy, half + k * dx) for k in range(-half, half + 1)]
            found.append(np.mean([padded[t : t + height, u : u + width] for t, u in steps], axis=0))
    return found


def _error_outside(squares: Image) -> float:
    """The share of the error [H, W] that is not in the connected region of a picture that has most of it."""
    side = max(1, max(squares.shape) // BLOCKS)
    height, width = (max(side, n // side * side) for n in squares.shape)
    kept = squares[:height, :width]
    blocks = np.add.reduceat(kept, np.arange(0, kept.shape[0], side), axis=0)
    blocks = np.add.reduceat(blocks, np.arange(0, kept.shape[1], side), axis=1)
    total = float(blocks.sum())
    parts: NDArray = np.zeros(blocks.shape, int)
    label(blocks > TIMES_MEDIAN * np.median(blocks), output=parts)
    regions = [blocks[part].sum() for k in range(1, parts.max() + 1) if (part := parts == k).mean() <= MOST_REGION]
    return 1.0 if total <= 0 or not regions else 1 - float(max(regions)) / total
