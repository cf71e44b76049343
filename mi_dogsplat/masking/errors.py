"""By how much a photograph differs from the render of a model, pixel by pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

BLUR = 0.01  # standard deviation of the mean over neighbours, as a share of the longer side


def smooth_error(
    render: NDArray, photograph: NDArray, counts: NDArray[np.bool_], known: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """[h, w], the mean over neighbours that are known of the absolute difference of colours; 0 where none is.

    The exposure and white balance of the photograph are divided out (``gains``). The mean over neighbours leaves what
    is wrong over an area, rather than the fine detail that a small model lacks.

    Args:
        render, photograph: [h, w, 3] display values.
        counts: [h, w], pixels by which exposure and white balance are found.
        known: [h, w], pixels whose difference means something.
    """
    error = np.abs(gains(render[counts], photograph[counts]) * render - photograph).mean(axis=2)
    blur = BLUR * max(error.shape)
    weight = gaussian_filter(known.astype(np.float64), blur)
    mean = gaussian_filter(error * known, blur)
    return np.divide(mean, weight, out=np.zeros_like(mean), where=weight > 1e-6).astype(np.float32)


def gains(render: NDArray, photograph: NDArray) -> NDArray[np.float64]:
    """[3], by which the channels of a render [M, 3] are multiplied to be nearest to the photograph [M, 3] in L1.

    Least squares would give way to what stands in the photograph alone. The best g for Σ |g r - t| is the median of
    t / r where each pixel has the weight r. Of display values, too, since these follow a power of the light, about.
    """
    found = np.ones(3)
    for c, (r, t) in enumerate(zip(render.T.astype(np.float64), photograph.T.astype(np.float64), strict=True)):
        lit = r > 0
        order = np.argsort(t[lit] / r[lit])
        weight = np.cumsum(r[lit][order])
        if len(weight):
            middle = order[np.searchsorted(weight, weight[-1] / 2)]
            found[c] = (t[lit] / r[lit])[middle]
    return found
