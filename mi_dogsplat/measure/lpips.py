"""LPIPS (Zhang et al. 2018), the learned distance of the papers' tables: by VGG16, version 0.1, in NumPy.

Two pictures go through the network; at five depths the features of each pixel are scaled to length 1, and squared
differences are weighted per feature, averaged over the picture and added up. The weights (59 MB) are not ours to ship,
and nothing is downloaded here: ``make lpips`` fetches them once. No framework is needed: a convolution is a matrix
product, and NumPy's takes all cores.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..datasets.images import box_downscale
from ..scene.cameras import Camera
from ..support.arrays import read_arrays
from ..support.errors import DataError

Floats = NDArray[np.float32]

BLOCKS = (2, 2, 3, 3, 3)  # convolutions between two halvings; a block's last output is what is compared
SHIFT = np.array([-0.030, -0.088, -0.188], np.float32)  # of ImageNet, for pictures in -1..1
SCALE = np.array([0.458, 0.448, 0.450], np.float32)
SMALLEST = 2 ** (len(BLOCKS) - 1)  # side of a picture, in pixels: one is left at the last depth
AROUND = 112  # rows that the network sees beyond a pixel: 90 by convolutions, 15 by halvings; a multiple of SMALLEST
BAND = 2**19  # pixels of a band: 1.5 GB at a time where the picture is 2,000 wide
COLUMNS = 4096  # pixels per matrix product: the patches of so many stay in the cache


def weights_path() -> Path:
    """Where the weights are, or would be."""
    cache = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(cache).expanduser() / "mi_dogsplat" / "lpips_vgg16.npz"


class Lpips:
    """The distance, with its weights.

    Args:
        weights: by name, float32: ``kernel_0`` … ``kernel_12`` [outputs, inputs, 3, 3], ``bias_0`` … ``bias_12``
            [outputs], ``linear_0`` … ``linear_4`` [features].
    """

    def __init__(self, weights: Mapping[str, Floats]):
        count = sum(BLOCKS)
        self.kernels = [_as_matrix(weights[f"kernel_{i}"]) for i in range(count)]
        self.biases = [weights[f"bias_{i}"] for i in range(count)]
        self.linear = [weights[f"linear_{i}"] for i in range(len(BLOCKS))]

    @classmethod
    def installed(cls, cameras: Iterable[Camera]) -> Lpips | None:
        """With the weights of this machine; None where there are none, or for cameras with too small a picture.

        Raises ``DataError`` for a broken file.
        """
        if any(min(camera.width, camera.height) < SMALLEST for camera in cameras):
            return None
        path = weights_path()
        try:
            return cls(read_arrays(path))
        except FileNotFoundError:
            return None
        except (ValueError, KeyError) as error:
            raise DataError(path, f"does not hold the weights of LPIPS ({error})", "remove it; make lpips") from None

    def __call__(self, image: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
        """Of two pictures [H, W, 3] in 0..1, at least 16 x 16: 0 if they are identical, below 1 as a rule."""
        return self.distances([image], truth, mask)[0]

    def distances(self, images: Sequence[ArrayLike], truth: ArrayLike, mask: ArrayLike | None = None) -> list[float]:
        """Of several pictures [H, W, 3] in 0..1 to one, whose features are found once; a number each.

        Large pictures are taken in bands, with as much around each as the network sees: the result is the same, and the
        memory bounded. ``mask`` [H, W]: weights 0..1 of the pixels; where the features are coarser, their means. Raises
        ``ValueError`` if sizes differ or are below 16 x 16.
        """
        pictures = [np.asarray(picture, np.float32) for picture in (truth, *images)]
        shape = pictures[0].shape
        if len(shape) != 3 or shape[2] != 3 or min(shape[:2]) < SMALLEST or any(p.shape != shape for p in pictures):
            found = ", ".join(str(list(p.shape)) for p in pictures)
            raise ValueError(f"LPIPS needs pictures [H, W, 3] of one size, at least 16 x 16 pixels, not {found}")
        weights = np.ones(shape[:2], np.float32) if mask is None else np.asarray(mask, np.float32)
        sums, totals = np.zeros((len(images), len(BLOCKS))), np.zeros(len(BLOCKS))
        for rows, first, last in _bands(*shape[:2]):
            of_truth, *others = (self._features(picture[rows], first, last) for picture in pictures)
            pixels = weights[rows][first:last]
            for depth, linear in enumerate(self.linear):
                pixels = box_downscale(pixels[..., None], 2)[..., 0] if depth else pixels
                totals[depth] += np.sum(pixels, dtype=np.float64)
                for k, features in enumerate(others):
                    errors = np.tensordot(linear, (of_truth[depth] - features[depth]) ** 2, 1)
                    sums[k, depth] += np.sum(errors * pixels, dtype=np.float64)
        return (sums / np.maximum(totals, 1e-30)).sum(axis=1).tolist()

    def _features(self, pixels: Floats, first: int, last: int) -> list[Floats]:
        """After each block, [features, rows / 2^d, W / 2^d], of length 1 in each pixel (or 0); of the rows from
        ``first`` to ``last`` of the picture only."""
        maps, result, layer = ((2 * pixels - 1 - SHIFT) / SCALE).transpose(2, 0, 1), [], 0
        for depth, convolutions in enumerate(BLOCKS):
            if depth:
                maps = _halved(maps)
            for _ in range(convolutions):
                maps = _convolved(maps, self.kernels[layer], self.biases[layer])
                layer += 1
            own = maps[:, first >> depth : last >> depth]
            result.append(own / (np.sqrt(np.sum(own**2, axis=0)) + 1e-10))
        return result


def _bands(height: int, width: int) -> Iterator[tuple[slice, int, int]]:
    """Rows that are worked on at a time, and which of them count: from the first to the last, as counted there."""
    step = max(BAND // width // SMALLEST, 1) * SMALLEST
    starts = range(0, height, step)
    if height - starts[-1] < SMALLEST and len(starts) > 1:
        starts = starts[:-1]  # too few rows for a band of their own
    for top, bottom in zip(starts, [*starts[1:], height], strict=True):
        rows = slice(max(top - AROUND, 0), min(bottom + AROUND, height))
        yield rows, top - rows.start, bottom - rows.start


def _as_matrix(kernel: Floats) -> Floats:
    """[outputs, inputs, 3, 3] as [outputs, 9 inputs], tap after tap as ``_convolved`` wants it."""
    return np.ascontiguousarray(kernel.transpose(0, 2, 3, 1).reshape(len(kernel), -1))


def _convolved(maps: Floats, kernel: Floats, bias: Floats) -> Floats:
    """3 x 3 correlation of [inputs, H, W], zero outside, where it is positive; [outputs, H, W].

    Rows lie one after another with a zero between them, and a row of zeros before and after all: so each of the nine
    neighbours of all pixels is one slice, and no border is special.
    """
    inputs, height, width = maps.shape
    pitch = width + 1
    size, margin = height * pitch, pitch + 1
    padded = np.zeros((inputs, size + 2 * margin), np.float32)
    padded[:, margin : margin + size].reshape(inputs, height, pitch)[..., :width] = maps
    taps = [dy * pitch + dx for dy in (0, 1, 2) for dx in (0, 1, 2)]  # the first pixel's neighbours, from 0
    result = np.empty((len(kernel), size), np.float32)
    for start in range(0, size, COLUMNS):
        stop = min(start + COLUMNS, size)
        patches = np.concatenate([padded[:, start + tap : stop + tap] for tap in taps])  # [9 inputs, columns]
        np.matmul(kernel, patches, out=result[:, start:stop])
    result += bias[:, None]
    np.maximum(result, 0, out=result)
    return result.reshape(-1, height, pitch)[..., :width]


def _halved(maps: Floats) -> Floats:
    """The largest of each 2 x 2 pixels; an odd last row or column is left out."""
    channels, height, width = maps.shape
    whole = maps[:, : height // 2 * 2, : width // 2 * 2]
    return whole.reshape(channels, height // 2, 2, width // 2, 2).max(axis=(2, 4))
