"""A video becomes photographs: it is read once to choose frames, and once more to write those chosen."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path

import numpy as np
from PIL import Image

from ..support.errors import DataError
from ..support.files import read_json, replacing, write_json
from .frame_choice import SMALL, FrameMark, Odometer, choose
from .input import FEWEST
from .photographs import QUALITY, Photograph
from .video import grey_of, read_frames, rgb_of

CHOICE = "frames.json"


def choose_frames(
    pictures: Iterable[tuple[int, np.ndarray]], n: int | None, progress: Callable[[int, int], None]
) -> list[int]:
    """The numbers of the frames to take, of small pictures [H, W] in 0..1 with theirs; ``n``: see ``choose``."""
    marks: list[FrameMark] = []
    odometer = Odometer()
    for index, grey in pictures:
        marks.append(odometer.mark(index, grey))
        progress(len(marks), 0)
    return choose(marks, n)


def take_frames(
    video: Path,
    choice: Path,
    folder: Path,
    n: int | None,
    progress: Callable[[int, int], None],
    end: int | None = None,
    turned: bool = True,
) -> list[Photograph]:
    """Write the chosen frames into ``folder`` unless they are there.

    The file ``choice`` keeps which they are, so that a second start need not read the video to choose again. ``n``: see
    ``choose``; ``end``: how many of its frames may be chosen, all if it is None; ``turned``: as the file says that they
    were held, else as the sensor has them. Raises ``DataError`` for
    what cannot be read, and for a video in which nothing moves.
    """
    if not choice.is_file():
        greys = ((index, grey_of(frame, SMALL)) for index, frame, _ in islice(read_frames(video), end))
        write_json(choice, choose_frames(greys, n, progress))
    chosen: list[int] = read_json(choice, "remove the file")
    if len(chosen) < FEWEST:
        raise DataError(video, "nothing moves in it", "walk around what you film: depth needs different places")
    names = {index: f"frame_{index:06d}.jpg" for index in chosen}
    missing = {index for index, name in names.items() if not (folder / name).is_file()}
    for index, frame, aspect in read_frames(video) if missing else ():
        if index in missing:
            with replacing(folder / names[index]) as part:
                Image.fromarray(rgb_of(frame, aspect, turned)).save(part, "JPEG", **QUALITY)
            progress(chosen.index(index) + 1, len(chosen))
        if index == chosen[-1]:
            break
    return [_photograph(folder / name) for name in names.values()]


def _photograph(file: Path) -> Photograph:
    """A frame that was written. A call or a stream may go on in another size, which then is a camera of its own."""
    with Image.open(file) as image:
        width, height = image.size
    return Photograph(file.name, width, height, f"video {width}x{height}", None)
