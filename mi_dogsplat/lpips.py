"""LPIPS (Zhang et al. 2018), the learned distance of the papers' tables: by VGG16, version 0.1, in NumPy.

Two pictures go through the network; at five depths the features of each pixel are scaled to length 1, and squared
differences are weighted per feature, averaged over the picture and added up. The weights (59 MB) are not ours to ship,
and nothing is downloaded here: ``make lpips`` fetches them once. No framework is needed: a convolution is a matrix
product, and NumPy's takes all cores.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import read_arrays
from .errors import DataError
from .scene.cameras import Camera

Floats = NDArray[np.float32]

BLOCKS = (2, 2, 3, 3, 3)  # convolutions between two halvings; a block's last output is what is compared
SHIFT = np.array([-0.030, -0.088, -0.188], np.float32)  # of ImageNet, for pictures in -1..1
SCALE = np.array([0.458, 0.448, 0.450], np.float32)
SMALLEST = 2 ** (len(BLOCKS) - 1)  # side of a picture, in pixels: one is left at the last depth
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

    def __call__(self, image: ArrayLike, truth: ArrayLike) -> float:
        """Of two pictures [H, W, 3] in 0..1, at least 16 x 16: 0 if they are identical, below 1 as a rule."""
        return self.distance(self.features(image), self.features(truth))

    def features(self, image: ArrayLike) -> list[Floats]:
        """After each block, [features, H / 2^k, W / 2^k], of length 1 in each pixel (or 0)."""
        pixels = np.asarray(image, np.float32)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or min(pixels.shape[:2]) < SMALLEST:
            raise ValueError(f"LPIPS needs pictures [H, W, 3] of at least 16 x 16 pixels, not {list(pixels.shape)}")
        maps, result, layer = ((2 * pixels - 1 - SHIFT) / SCALE).transpose(2, 0, 1), [], 0
        for block, convolutions in enumerate(BLOCKS):
            if block:
                maps = _halved(maps)
            for _ in range(convolutions):
                maps = np.maximum(_convolved(maps, self.kernels[layer], self.biases[layer]), 0)
                layer += 1
            result.append(maps / (np.sqrt(np.sum(maps**2, axis=0)) + 1e-10))
        return result

    def distance(self, a: Sequence[Floats], b: Sequence[Floats]) -> float:
        """Between the features of two pictures of one size."""
        layers = zip(self.linear, a, b, strict=True)
        return float(sum(np.mean(np.tensordot(weights, (x - y) ** 2, 1), dtype=np.float64) for weights, x, y in layers))


def _as_matrix(kernel: Floats) -> Floats:
    """[outputs, inputs, 3, 3] as [outputs, 9 inputs], tap after tap as ``_convolved`` wants it."""
    return np.ascontiguousarray(kernel.transpose(0, 2, 3, 1).reshape(len(kernel), -1))


def _convolved(maps: Floats, kernel: Floats, bias: Floats) -> Floats:
    """3 x 3 correlation of [inputs, H, W], zero outside; [outputs, H, W].

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
    return result.reshape(-1, height, pitch)[..., :width]


def _halved(maps: Floats) -> Floats:
    """The largest of each 2 x 2 pixels; an odd last row or column is left out."""
    channels, height, width = maps.shape
    whole = maps[:, : height // 2 * 2, : width // 2 * 2]
    return whole.reshape(channels, height // 2, 2, width // 2, 2).max(axis=(2, 4))
