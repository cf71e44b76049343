"""A film as an H.264 video that browsers, phones and editors play: 4:2:0, 8 bits, BT.709, limited range.

ffmpeg comes inside of the package av (PyAV), of the extra ``film``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..support.errors import DataError
from ..support.files import replacing

SUFFIX = ".mp4"
BT709 = 1  # primaries, transfer and matrix of ITU-T H.273


def require_even(out: Path, size: tuple[int, int]) -> None:
    """Raise ``DataError`` for a picture whose colours cannot be halved."""
    if size[0] % 2 or size[1] % 2:
        even = f"{size[0] + size[0] % 2} {size[1] + size[1] % 2}"
        problem = f"{size[0]} x {size[1]} has an odd side, and H.264 stores one colour for 2 x 2 pixels"
        raise DataError(out, problem, f"use --size {even}, or write pictures")


def write_video(out: Path, frames: Iterable[np.ndarray], size: tuple[int, int], fps: int, crf: int) -> None:
    """Encode frames, float [H, W, 3] in 0..1, as they come; ``out`` appears with the last one.

    ffmpeg gets its whole path: what is before a colon in a relative one would be a protocol.

    Raises ``OSError`` where it cannot be written, ``ModuleNotFoundError`` without PyAV.
    """
    import av
    from av.video.reformatter import ColorRange, Colorspace

    options = {"movflags": "faststart"}
    with replacing(out.absolute()) as part, _plain_errors():
        part.touch()  # PyAV opens it after some dozen frames: what cannot be written shows before one is rendered
        with av.open(str(part), "w", format="mp4", options=options) as file:
            stream = file.add_stream("libx264", rate=fps, options={"crf": str(crf)})
            stream.width, stream.height = size
            stream.pix_fmt = "yuv420p"
            context = stream.codec_context
            context.color_range = ColorRange.MPEG
            context.color_primaries = context.color_trc = context.colorspace = BT709
            for image in frames:
                pixels = np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
                limited = frame.reformat(
                    format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
                )
                file.mux(stream.encode(limited))
            file.mux(stream.encode(None))


@contextmanager
def _plain_errors() -> Iterator[None]:
    """What ffmpeg cannot write raises an ``OSError`` that can be told the name of its file, which PyAV's cannot."""
    from av.error import FFmpegError

    try:
        yield
    except FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error
