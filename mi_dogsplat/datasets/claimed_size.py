"""What an image file may claim to hold before its pixels are read: others are a few bytes that become gigabytes."""

from __future__ import annotations

MAX_PIXELS_PER_BYTE = 100  # of a large image; the poorest JPEG has 50, a black PNG 340
ALWAYS_READ = 1 << 24  # pixels


def require_photograph(width: int, height: int, n_bytes: int) -> None:
    """Raise ``ValueError`` for a file of ``n_bytes`` whose size is none, or far too large for them."""
    if width < 1 or height < 1 or width * height > max(ALWAYS_READ, MAX_PIXELS_PER_BYTE * n_bytes):
        raise ValueError(f"{width}x{height} pixels in {n_bytes} bytes are no photograph")
