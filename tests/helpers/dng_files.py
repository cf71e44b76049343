"""Raw photographs of a known scene, by the specification of DNG 1.4 (a TIFF with a mosaic), without any library."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from icc_profiles import SRGB, xyz_of

BLACK, WHITE = 512, 16383  # of the sensor's levels
BYTE, ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SIGNED_RATIONAL = 1, 2, 3, 4, 5, 7, 10
DENOMINATOR = 10_000
D65_LIGHT = 21  # of EXIF's light sources


def write_dng(
    path: Path,
    light: np.ndarray,
    neutral: tuple[float, float, float] = (1, 1, 1),
    exposure: tuple[float, int, float] | None = (0.01, 100, 1.0),
    orientation: int = 1,
    device: tuple[str, str] = ("Maker", "Model"),
    exif: dict[int, tuple[int, Any]] | None = None,
    balanced: bool = True,
) -> Path:
    """A photograph of linear light [H, W, 3], sRGB's primaries; H and W are even, and pixels lie as in the file.

    Args:
        neutral: what the sensor says of white, by its colours; its levels end at 1 in each.
        exposure: seconds, ISO and f-number; light of 1 just fills the sensor at (.01, 100, 1). None: it is not said.
        exif: more tags of the EXIF directory, with their types.
        balanced: whether the file says what was white.
    """
    seconds, iso, f_number = exposure or (0.01, 100, 1.0)
    seen = np.clip(light * neutral * (seconds / 0.01 * iso / 100 / f_number**2), 0, 1)
    levels = np.rint(BLACK + seen * (WHITE - BLACK)).astype("<u2")
    mosaic = levels[..., 1].copy()
    mosaic[::2, ::2], mosaic[1::2, 1::2] = levels[::2, ::2, 0], levels[1::2, 1::2, 2]
    height, width = mosaic.shape
    from_xyz = np.diag(neutral) @ np.linalg.inv(xyz_of(SRGB))
    taken = {0x829A: (RATIONAL, seconds), 0x829D: (RATIONAL, f_number), 0x8827: (SHORT, iso)} if exposure else {}
    tags = {
        0x00FE: (LONG, 0), 0x0100: (LONG, width), 0x0101: (LONG, height), 0x0102: (SHORT, 16), 0x0103: (SHORT, 1),
        0x0106: (SHORT, 32803), 0x010F: (ASCII, device[0]), 0x0110: (ASCII, device[1]), 0x0112: (SHORT, orientation),
        0x0115: (SHORT, 1), 0x0116: (LONG, height), 0x0117: (LONG, mosaic.nbytes), 0x828D: (SHORT, [2, 2]),
        0x828E: (BYTE, [0, 1, 1, 2]), 0xC612: (BYTE, [1, 4, 0, 0]), 0xC614: (ASCII, " ".join(device)),
        0xC61A: (SHORT, BLACK), 0xC61D: (SHORT, WHITE), 0xC621: (SIGNED_RATIONAL, from_xyz.ravel()),
        0xC628: (RATIONAL, neutral), 0xC65A: (SHORT, D65_LIGHT),
    }  # fmt: skip
    inner = directory(taken | (exif or {}), 8)
    first = 8 + len(inner)
    if not balanced:
        del tags[0xC628]
    tags |= {0x8769: (LONG, 8), 0x0111: (LONG, 0)}
    tags[0x0111] = (LONG, first + len(directory(tags, first)))
    path.write_bytes(b"II*\0" + struct.pack("<I", first) + inner + directory(tags, first) + mosaic.tobytes())
    return path


def directory(tags: dict[int, tuple[int, Any]], at: int) -> bytes:
    """A directory of TIFF that begins at a byte of the file, with the values that do not fit into it behind it."""
    entries, behind = b"", b""
    after = at + 2 + 12 * len(tags) + 4
    for tag, (kind, value) in sorted(tags.items()):
        data, count = encoded(kind, value)
        held = data.ljust(4, b"\0") if len(data) <= 4 else struct.pack("<I", after + len(behind))
        entries += struct.pack("<HHI", tag, kind, count) + held
        if len(data) > 4:
            behind += data + bytes(len(data) % 2)
    return struct.pack("<H", len(tags)) + entries + bytes(4) + behind


def encoded(kind: int, value: Any) -> tuple[bytes, int]:
    """(bytes, number of values)"""
    if kind in (ASCII, UNDEFINED):
        data = value.encode() + b"\0" if kind == ASCII else value
        return data, len(data)
    values = np.ravel(value)
    if kind in (RATIONAL, SIGNED_RATIONAL):
        letter = "I" if kind == RATIONAL else "i"
        return b"".join(struct.pack(f"<{letter}I", round(v * DENOMINATOR), DENOMINATOR) for v in values), len(values)
    return b"".join(struct.pack({BYTE: "<B", SHORT: "<H", LONG: "<I"}[kind], int(v)) for v in values), len(values)
