"""Which frames of a video to take: as many as its motion asks for, the sharpest of each bucket.

Buckets have equal amounts of motion, not of time: a camera that rests makes no second frame, one that hurries makes
many. Motion is the median, over the blocks of a small picture, of each block's shift by phase correlation (Kuglin and
Hines 1975), which does not mind a change of exposure. Sharpness is the mean squared gradient over the variance, so that
contrast and exposure do not count; it is compared within a bucket alone, where all frames show about the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SMALL = 320  # longest side of the pictures that are compared
BLOCK = 64  # pixels of a block; a shift is below half of it
STEP = 0.03  # of the longest side: motion between two frames that are taken
FAR = 3.0  # pixels: shifts are measured from one frame up to here, so that slow ones are not lost in rounding
FLAT = 2 / 255  # standard deviation below which a block shows nothing
CERTAIN = 0.1  # height of a peak that is no noise: of 4,096 random values the highest is about 0.06
MOST, LEAST = 300, 60


@dataclass(frozen=True)
class FrameMark:
    """``travelled`` from the first frame, in longest sides; ``sharpness`` above 0, more is sharper."""

    index: int
    travelled: float
    sharpness: float


class Odometer:
    """How far a video has moved: shifts from a frame that is kept, until they are large and the next one is kept."""

    def __init__(self) -> None:
        self._kept: np.ndarray | None = None
        self._before = 0.0  # pixels travelled up to the frame that is kept

    def mark(self, index: int, grey: np.ndarray) -> FrameMark:
        """The mark of the next small picture [H, W] in 0..1."""
        if self._kept is None or self._kept.shape != grey.shape:
            self._kept = grey
        moved = shift(self._kept, grey)
        travelled = self._before + moved
        if moved >= FAR:
            self._kept, self._before = grey, travelled
        return FrameMark(index, travelled / max(grey.shape), sharpness(grey))


def sharpness(grey: np.ndarray) -> float:
    """Mean squared gradient of a picture [H, W] over its variance, 1/pixel²."""
    rows, columns = np.gradient(grey)
    return float((rows**2 + columns**2).mean() / (grey.var() + 1e-6))


def shift(a: np.ndarray, b: np.ndarray) -> float:
    """Median over the blocks of two pictures [H, W] of the length by which each block has moved, in whole pixels.

    A block that shows nothing does not count; one that is not found again has moved by half of its size.
    """
    size = min(BLOCK, *a.shape)
    window = np.outer(np.hanning(size), np.hanning(size))
    tops, lefts = (np.arange(0, n - size + 1, size // 2) for n in a.shape)
    pairs = [(p[top : top + size, left : left + size]) for p in (a, b) for top in tops for left in lefts]
    blocks = np.stack(pairs).reshape(2, -1, size, size)
    blocks = blocks[:, (blocks.std(axis=(2, 3)) > FLAT).any(axis=0)]  # [2, B, size, size]
    if not blocks.size:
        return 0.0
    first, second = np.fft.rfft2((blocks - blocks.mean(axis=(2, 3), keepdims=True)) * window)
    cross = second * first.conj()
    peaks = np.fft.irfft2(cross / (np.abs(cross) + 1e-9), s=(size, size)).reshape(len(cross), -1)  # [B, size²]
    offsets = np.stack(np.unravel_index(peaks.argmax(axis=1), (size, size)), -1)  # [B, 2]
    offsets = np.where(offsets > size // 2, offsets - size, offsets)
    found = peaks.max(axis=1) > CERTAIN
    return float(np.median(np.where(found, np.linalg.norm(offsets, axis=1), size / 2)))


def choose(marks: Sequence[FrameMark], n: int | None = None) -> list[int]:
    """Indices of the frames to take, rising; ``n`` of them at most, or as many as the motion asks for.

    A video that does not move gives one frame.
    """
    path = np.maximum.accumulate([m.travelled for m in marks])  # [F] where the camera is along its way
    wanted = n or int(np.clip(np.ceil(path[-1] / STEP), LEAST, MOST))
    bucket = np.minimum((path / max(path[-1], 1e-9) * wanted).astype(int), wanted - 1)  # [F]
    sharp = np.array([m.sharpness for m in marks])
    best = [int(np.flatnonzero(bucket == k)[np.argmax(sharp[bucket == k])]) for k in np.unique(bucket)]
    return [marks[i].index for i in best]
