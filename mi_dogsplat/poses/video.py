"""Video files, by PyAV, whose wheel holds ffmpeg: frames one after the other, upright, with square pixels.

A damaged packet is left out, as players do. Files only: no playlist, no address is followed. PyAV is silent by itself;
a level of its log would have ffmpeg's threads wait for Python, and Python for them where reading ends early.
"""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..support.errors import DataError
from ..support.wording import counted
from .video_colors import require_colors, srgb_of

FORMATS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,asf,flv,ogg"
OPTIONS = {"protocol_whitelist": "file", "format_whitelist": FORMATS}
REMEDY = "export it again, as .mp4 with H.264, or give the frames as a folder of images"
EQUIRECTANGULAR = 0  # of ffmpeg's AVSphericalProjection
MAX_DAMAGED = 0.1  # of the packets of a video that can be used


def says_panorama(path: Path) -> bool:
    """Whether a video says that it shows all directions, and is twice as wide as high.

    Raises ``DataError`` for a video without a frame that can be read, ``ModuleNotFoundError`` where PyAV is not
    installed.
    """
    frames = read_frames(path)
    try:
        _, frame, aspect = next(frames)
        said = frame.side_data.get("SPHERICAL")
    finally:
        frames.close()
    whole = round(frame.width * aspect) == 2 * frame.height  # pictures for two eyes may lie one above the other
    return whole and said is not None and int.from_bytes(bytes(said)[:4], sys.byteorder) == EQUIRECTANGULAR


def read_frames(path: Path) -> Generator[tuple[int, Any, float], None, None]:
    """(index, ``av.VideoFrame``, its pixels' width over their height) of each frame that can be decoded.

    They come in the order in which they are shown. Raises ``DataError`` for what is no video or has colours that cannot
    be read, and at the end if more than a tenth of it was damaged.
    """
    import av
    from av.error import FFmpegError

    index = damaged = 0
    try:
        with av.open(str(path.absolute()), options=OPTIONS) as container:  # "12:30.mp4" alone would be a protocol
            if not container.streams.video:
                raise DataError(path, "holds no pictures, only sound", "give a video")
            stream = container.streams.video[0]
            stream.thread_type, aspect = "AUTO", pixel_aspect(stream)
            for frames in _decoded_packets(container.demux(stream)):
                damaged += frames is None
                if damaged > max(10, index):
                    break
                for frame in frames or ():
                    require_colors(path, frame, REMEDY)
                    yield index, frame, aspect
                    index += 1
    except FFmpegError as error:
        raise DataError(path, f"cannot be read as a video ({error.strerror})", REMEDY) from error
    if index == 0 or damaged > MAX_DAMAGED * index:
        problem = f"is damaged: {counted(index, 'frame')} could be decoded, {counted(damaged, 'packet')} could not"
        raise DataError(path, problem, REMEDY)


def _decoded_packets(packets: Iterator[Any]) -> Iterator[list[Any] | None]:
    """The frames of each packet, None of a damaged one, which reading it may show as well as decoding it."""
    from av.error import EOFError as EndOfFile
    from av.error import InvalidDataError

    while True:
        try:
            frames = next(packets).decode()
        except (StopIteration, EndOfFile):
            return
        except InvalidDataError:
            frames = None
        yield frames


def pixel_aspect(stream: Any) -> float:
    """Width of a pixel over its height; 1 where the file does not say, or says what no camera has."""
    aspect = float(stream.sample_aspect_ratio or 1)
    return aspect if 1 / 4 <= aspect <= 4 else 1.0


def grey_of(frame: Any, longest: int) -> np.ndarray:
    """Luma [H, W] in 0..1, float32, shrunk to this longest side; as it lies in the file, which may be turned."""
    scale = min(1.0, longest / max(frame.width, frame.height))
    size = {"width": max(16, round(frame.width * scale)), "height": max(16, round(frame.height * scale))}
    return frame.reformat(**size, format="gray", interpolation="AREA").to_ndarray().astype(np.float32) / 255


def rgb_of(frame: Any, aspect: float, turned: bool = True) -> np.ndarray:
    """sRGB, uint8 [H, W, 3], with square pixels, ``turned`` as it was held; ``aspect`` as in ``read_frames``.

    A camera of structure from motion has one focal length for both axes.
    """
    wide = srgb_of(frame, round(frame.width * aspect))
    quarters = round(frame.rotation / 90) if turned else 0  # counterclockwise
    return np.ascontiguousarray(np.rot90(wide, quarters))
