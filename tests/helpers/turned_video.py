"""Videos that ask for being turned when they are shown, as phones that are held upright write them."""

import struct
from pathlib import Path

# the matrix of a track in the header "tkhd": a b u, c d v, x y w
IDENTITY = struct.pack(">9i", 1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
CLOCKWISE = struct.pack(">9i", 0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30)


def turned_clockwise(video: Path, out: Path) -> None:
    """Write a copy of an MP4 file that is shown turned."""
    data = video.read_bytes()
    at = data.index(IDENTITY, data.index(b"tkhd"))
    out.write_bytes(data[:at] + CLOCKWISE + data[at + len(CLOCKWISE) :])
