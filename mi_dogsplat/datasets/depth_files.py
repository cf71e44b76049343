"""Files of depth maps: depth along the view axis, float32 [H, W]; 0 where it is not known.

- **PNG and TIFF** of 16 or 32 bits hold millimetres, as those of phones, Polycam and Record3D do; TIFF of floats holds
  depths as they are.
- Maps of inverse depth may have 8 bits, as networks write them, also in three equal channels.
- **OpenEXR** holds them in a channel ``depth.Z``, ``Z``, ``depth`` or ``Y``, or in its only one; **NumPy** in an array.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..support.arrays import array_of
from ..support.errors import DataError
from .exr import is_exr, read_exr_planes
from .images import UNREADABLE, open_image, stored

SUFFIXES = (".exr", ".npy", ".png", ".tif", ".tiff")
MILLIMETRE = np.float32(0.001)  # metres
CHANNELS = ("depth.Z", "Z", "depth", "Y")  # of OpenEXR, the likelier first
REMEDY = "write it as PNG of 16 bits in millimetres, or as .npy or .exr"


def read_depth(path: Path, coarse: bool = False) -> np.ndarray:
    """Depth float32 [H, W] of a file: metres of whole numbers, which are millimetres, else as it is; 0 where it is not
    a finite number above 0. ``coarse``: also of grey pictures of 8 bits. Raises ``DataError``."""
    if is_exr(path):
        depth = _of_exr(path)
    elif path.suffix.lower() == ".npy":
        depth = _of_array(path, _loaded(path))
    else:
        depth = _of_image(path, coarse)
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))


def _of_exr(path: Path) -> np.ndarray:
    planes = read_exr_planes(path)
    found = next((name for name in CHANNELS if name in planes), next(iter(planes)) if len(planes) == 1 else None)
    if found is None:
        problem = f"has no channel {', '.join(CHANNELS)}, but {', '.join(planes) or 'none'}"
        raise DataError(path, problem, "name the channel of depth so")
    return planes[found]


def _loaded(path: Path) -> np.ndarray:
    try:
        return array_of(path.read_bytes())
    except (OSError, ValueError) as error:
        remedy = "write an array of numbers, row by row, by numpy.save"
        raise DataError(path, f"cannot be read as a NumPy array ({error})", remedy) from None


def _of_array(path: Path, array: np.ndarray) -> np.ndarray:
    if array.dtype.kind not in "fui":
        raise DataError(path, "holds no array of real numbers", REMEDY)
    plane = array[..., 0] if array.ndim == 3 and array.shape[2] == 1 else array
    if plane.ndim != 2 or not plane.size:
        raise DataError(path, f"holds an array of shape {array.shape}; depth needs [height, width]", REMEDY)
    with np.errstate(over="ignore"):  # what no float32 holds becomes infinite, which is not known
        depth = plane.astype(np.float32)
    return depth if plane.dtype.kind == "f" else depth * MILLIMETRE


def _of_image(path: Path, coarse: bool) -> np.ndarray:
    try:
        with open_image(path) as image:
            picture = stored(image)
            pixels = np.asarray(picture.convert("RGB") if picture.mode == "P" else picture)  # a palette's are no depths
    except UNREADABLE as error:
        raise DataError(path, f"cannot be read as an image ({error})", "replace the file") from None
    if coarse and pixels.ndim == 3 and (pixels[..., :3] == pixels[..., :1]).all():
        pixels = pixels[..., 0]
    if pixels.ndim != 2 or (pixels.dtype.itemsize < 2 and not coarse):
        kind = "8 bits" if pixels.ndim == 2 else f"{pixels.shape[2]} channels"
        raise DataError(path, f"has {kind}, and depth needs one channel of 16 bits", REMEDY)
    return _of_array(path, pixels)
