"""ICC profiles of RGB and CMYK, by the specification (ICC.1:2010), and what colours of RGB are in sRGB, in float64."""

import struct

import numpy as np

D50, D65 = np.array([0.9642, 1.0, 0.8249]), np.array([0.9504559, 1.0, 1.0890578])
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
SRGB = (0.64, 0.33), (0.30, 0.60), (0.15, 0.06)  # chromaticities of the primaries; white is D65
DISPLAY_P3 = (0.680, 0.320), (0.265, 0.690), (0.150, 0.060)
ADOBE_RGB = (0.64, 0.33), (0.21, 0.71), (0.15, 0.06)
SRGB_CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)  # g, a, b, c, d of a parametric curve
ADOBE_CURVE = (563 / 256, 1.0, 0.0, 0.0, 0.0)


def xyz_of(primaries) -> np.ndarray:
    """Linear RGB to CIE XYZ, [3, 3], under D65."""
    columns = np.array([[x / y, 1, (1 - x - y) / y] for x, y in primaries]).T
    return columns * np.linalg.solve(columns, D65)


def srgb_of(levels: np.ndarray, primaries, curve) -> np.ndarray:
    """sRGB values, clipped to 0..1, of RGB levels [..., 3] in 0..1 with these primaries and this curve."""
    g, a, b, c, d = curve
    linear = np.where(levels >= d, np.maximum(a * levels + b, 0) ** g, c * levels)
    clipped = np.clip(linear @ np.linalg.solve(xyz_of(SRGB), xyz_of(primaries)).T, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def profile(primaries, curve) -> bytes:
    """A display profile, version 4: a matrix and a parametric curve."""
    adapted = np.linalg.solve(BRADFORD, np.diag((BRADFORD @ D50) / (BRADFORD @ D65)) @ BRADFORD) @ xyz_of(primaries)
    tone = b"para" + bytes(4) + struct.pack(">HH5i", 3, 0, *(round(v * 65536) for v in curve))
    points = {tag: adapted[:, k] for k, tag in enumerate((b"rXYZ", b"gXYZ", b"bXYZ"))} | {b"wtpt": D50}
    tags = {tag: b"XYZ " + bytes(4) + struct.pack(">3i", *np.rint(v * 65536).astype(int)) for tag, v in points.items()}
    tags |= dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), tone)
    return _file(b"mntr", b"RGB ", b"XYZ ", 0x04000000, tags)


def grey(gamma: float) -> bytes:
    """A display profile of grey, version 2: a power."""
    tone = b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256))
    white = b"XYZ " + bytes(4) + struct.pack(">3i", *np.rint(D50 * 65536).astype(int))
    return _file(b"mntr", b"GRAY", b"XYZ ", 0x02400000, {b"wtpt": white, b"kTRC": tone})


def black_of_cmyk() -> bytes:
    """A profile of a printer, version 2, whose lightness L* falls evenly with each ink, by a table of its corners."""
    steps = np.arange(256, dtype=np.uint8).tobytes()
    inks = np.stack(np.meshgrid(*[[0, 1]] * 4, indexing="ij"), axis=-1).reshape(-1, 4)  # [16, 4], black changes first
    lightness = (1 - inks[:, 3]) * (1 - inks[:, :3].mean(axis=1))
    table = np.stack([np.rint(255 * lightness), *[np.full(16, 128)] * 2], axis=-1).astype(np.uint8).tobytes()
    identity = struct.pack(">9i", *np.eye(3, dtype=int).ravel() * 65536)
    lut = b"mft1" + bytes(4) + bytes((4, 3, 2, 0)) + identity + 4 * steps + table + 3 * steps
    white = b"XYZ " + bytes(4) + struct.pack(">3i", *np.rint(D50 * 65536).astype(int))
    return _file(b"prtr", b"CMYK", b"Lab ", 0x02400000, {b"wtpt": white, b"A2B0": lut})


def _file(kind: bytes, channels: bytes, connection: bytes, version: int, tags: dict[bytes, bytes]) -> bytes:
    text = "profile".encode("utf-16-be")
    desc = b"mluc" + bytes(4) + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(text), 28) + text
    tags = {b"desc": desc, b"cprt": desc} | tags
    table, data, at = struct.pack(">I", len(tags)), b"", 128 + 4 + 12 * len(tags)
    for tag, content in tags.items():
        table += tag + struct.pack(">II", at + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    header = struct.pack(">I4sI4s4s4s", at + len(data), bytes(4), version, kind, channels, connection)
    header += struct.pack(">6H4s", 2026, 1, 1, 0, 0, 0, b"acsp") + bytes(28)
    header += struct.pack(">3i", *np.rint(D50 * 65536).astype(int))
    return header.ljust(128, b"\0") + table + data
