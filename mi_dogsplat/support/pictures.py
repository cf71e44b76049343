"""Pictures out: PNG for eyes and browsers, multi-layer OpenEXR for compositing; and the heat map of an error.

Arrays are display-referred sRGB values, as in the whole package. PNG stores them as they are (8 bit).
OpenEXR holds linear radiance by convention, so its colour layer passes through `srgb_to_linear`.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import ArrayLike, NDArray

from .files import replacing
from .srgb import srgb_to_linear

HEADER = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}  # lossless
SATURATION = "sensorSaturation"  # attribute: the value of a channel from which on the sensor was full
COLORS = ("RGBA", "RGB", "XYZA", "XYZ", "YA", "Y")  # of a film: letters of its channels, and name of its format
# The magma colour map (van der Walt and Smith, CC0) at 17 points; linear between them is within 2.3/255.
MAGMA = (
    "#000004 #0a0822 #1d1147 #36106b #51127c #6a1c81 #832681 #9c2e7f #b73779 "
    "#d0416f #e75263 #f56b5c #fc8961 #fea772 #fec488 #fde2a3 #fcfdbf"
).split()


def heat_map(error: ArrayLike) -> NDArray[np.float32]:
    """Magma colours [H, W, 3] of an error map [H, W]: 0 is black, 1 pale yellow, as FLIP shows it."""
    anchors = np.array([[int(h[i : i + 2], 16) / 255 for i in (1, 3, 5)] for h in MAGMA])  # [17, 3]
    positions = np.linspace(0, 1, len(MAGMA))
    e = np.asarray(error)
    return np.stack([np.interp(e, positions, anchors[:, c]) for c in range(3)], axis=-1).astype(np.float32)


def write_png(path: str | Path, image: ArrayLike) -> None:
    """Writes [H, W, 3], [H, W, 4] or [H, W] as 8-bit sRGB: clamped to 0..1, rounded to nearest.

    Raises ``ValueError`` where the shape is another one or the picture holds NaN (8 bits could only hide it), and
    ``OSError`` where the file cannot be written.
    """
    values = np.asarray(image)
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] not in (3, 4)) or values.size == 0:
        raise ValueError(f"{path}: a picture is [H, W] or [H, W, 3 or 4], this one is {list(values.shape)}")
    broken = np.count_nonzero(np.isnan(values))
    if broken:
        raise ValueError(f"{path}: has values that are NaN: {broken} of {values.size}; OpenEXR can show where they are")
    pixels = np.round(np.clip(values, 0, 1) * 255).astype(np.uint8)
    import mitsuba as mi  # here: models and data sets can be read without it

    written = mi.MemoryStream()  # Mitsuba opens no path that is not UTF-8
    mi.Bitmap(pixels).write(written, mi.Bitmap.FileFormat.PNG)
    with replacing(path) as part:
        part.write_bytes(written.raw_buffer())


def write_exr(path: str | Path, layers: Mapping[str, ArrayLike]) -> None:
    """Writes one multi-layer OpenEXR file (scanlines, 32-bit floats, lossless).

    Args:
        layers: ``color`` [H, W, 3 or 4] becomes R, G, B and A: display-referred and premultiplied here, linear in the
            file, alpha as it is (over black the file shows what was trained). Every other layer is stored as it is:
            [H, W] as ``name.Y`` (``depth`` as ``depth.Z``), [H, W, 3 or 4] as ``name.R``, ``.G``, ``.B``, ``.A``; a
            channel ``name.X`` of [H, W] under that name.

    Raises ``ValueError`` where there is no layer, or shapes do not fit together, and ``OSError`` where the file cannot
    be written.
    """
    planes: dict[str, NDArray[np.float32]] = {}
    size: tuple[int, ...] | None = None
    for name, layer in layers.items():
        values = np.asarray(layer, np.float32)
        size = size or values.shape[:2]
        count = {2: 1, 3: values.shape[-1]}.get(values.ndim, 0)
        fits = (count in (3, 4) and "." not in name) or (count == 1 and name != "color")
        if values.shape[:2] != size or values.size == 0 or not fits:
            raise ValueError(f'{path}: layer "{name}" is {list(values.shape)}, the picture is {list(size)}')
        if name == "color":
            values = np.concatenate([srgb_to_linear(values[..., :3]), values[..., 3:]], axis=-1)
        suffixes = "RGBA" if count > 1 else "Z" if name == "depth" else "Y"
        values = values.reshape(*size, count)  # [H, W, count]
        for c, suffix in enumerate(suffixes[:count]):
            channel = suffix if name == "color" else name if "." in name else f"{name}.{suffix}"
            planes[channel] = values[..., c]
    if not planes:
        raise ValueError(f"{path}: no layer to write")
    write_channels(path, planes)


def write_radiance(path: str | Path, image: NDArray, saturation: float | None = None) -> None:
    """Write linear radiance [H, W, 3], or premultiplied [H, W, 4], to an OpenEXR file of half floats.

    What is brighter than they can hold becomes the most that they can. ``saturation``: the value of a channel from
    which on the sensor was full; None where there was none. Raises ``OSError``.
    """
    halves = np.minimum(image, np.finfo(np.float16).max).astype(np.float16)
    attributes = {} if saturation is None else {SATURATION: float(saturation)}
    write_channels(path, {name: halves[..., c] for c, name in enumerate("RGBA"[: image.shape[2]])}, attributes)


def write_channels(
    path: str | Path, planes: Mapping[str, NDArray], attributes: Mapping[str, float] = MappingProxyType({})
) -> None:
    """Write [H, W] planes of float16, float32 or uint32 to an OpenEXR file as they are, by their names.

    ``attributes`` are written beside those that OpenEXR needs.

    Raises ``OSError``. Mitsuba's own writer takes all planes in one array, and waits for ever where there is one core.
    """
    whole = {name: np.ascontiguousarray(plane) for name, plane in planes.items()}  # strides are not looked at
    written = io.BytesIO()  # OpenEXR opens no path that is not UTF-8
    OpenEXR.File({**HEADER, **attributes}, whole).write(written)
    with replacing(path) as part:
        part.write_bytes(written.getbuffer())


def without_aovs(bitmap: Any) -> Any:
    """The colours of what a film has recorded, a ``mi.Bitmap``, which come with alpha where the film has it.

    They are its first channels. ``Bitmap.split`` puts the AOV ``alpha``, whose name has no point, among them.
    """
    formats = type(bitmap).PixelFormat
    if bitmap.pixel_format() != formats.MultiChannel:
        return bitmap
    names = [field.name for field in bitmap.struct_()]
    colors = next(letters for letters in COLORS if names[: len(letters)] == list(letters))
    return type(bitmap)(np.ascontiguousarray(np.array(bitmap)[..., : len(colors)]), getattr(formats, colors))
