"""Depth maps of scans as a training takes them: in millimetres, without what is not to be trusted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from ..datasets.depth_files import read_depth
from ..datasets.images import stored
from ..datasets.scans.scan import REMEDY, ScanFrame
from ..support.errors import DataError
from ..support.files import replacing
from .photographs import readable

FARTHEST = 5.0  # metres that the LiDAR of a phone reaches; ARKit guesses what is farther (README of polyform)
PER_METRE = 1000


def depth_file(frame: ScanFrame, folder: Path) -> Path:
    """The depth map of a frame in a data set."""
    return folder / Path(frame.name).with_suffix(".png")


def trusted_depth(frame: ScanFrame) -> np.ndarray:
    """Metres along the view axis, float32 [H, W], of a frame that has a depth map; 0 where nothing is known, where the
    app has no confidence, and beyond ``FARTHEST``. Raises ``DataError``."""
    assert frame.depth is not None
    depth = read_depth(frame.depth)
    trusted = depth <= FARTHEST
    if frame.confidence is not None:
        trusted &= _confidence(frame.confidence, depth.shape) > 0
    return np.where(trusted, depth, np.float32(0))


def write_depth(frame: ScanFrame, folder: Path) -> float:
    """Write the depth map of a frame as PNG of 16 bits, unless nothing in it is known; the share of it that is."""
    millimetres = np.rint(trusted_depth(frame) * PER_METRE).astype(np.uint16)
    if millimetres.any():
        with replacing(depth_file(frame, folder)) as part:
            Image.fromarray(millimetres).save(part, "PNG")
    return float((millimetres > 0).mean())


def _confidence(file: Path, shape: tuple[int, ...]) -> np.ndarray:
    with readable(file) as image:
        levels = np.asarray(stored(image))
    if levels.shape != shape:
        raise DataError(file, f"has shape {levels.shape}, and its depth map {shape}", REMEDY)
    return levels
