"""From a camera path and what is seen along it to the file of a video, or numbered pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..render.picture_memory import require_memory
from ..runs.stopping import Stopped, StopRequest
from ..scene.cameras import Camera
from ..support.errors import DataError, undisguised, writing
from ..support.pictures import write_png
from ..support.wording import counted
from .camera_path import DEFAULT_FPS, DEFAULT_SIZE, CameraPath
from .film_config import FilmConfig
from .output import Output
from .pictures import NumberedPictures
from .video import require_even, write_video

MOST_FRAMES = 1_000_000
Progress = Callable[[int, int, str], None]
"""Gets the number of finished frames, that of all, and the path in words."""


@dataclass(frozen=True)
class Film:
    """What was made: ``n_frames`` of a size, ``fps`` of them in a second, along ``path`` in words."""

    n_frames: int
    size: tuple[int, int]
    path: str
    fps: int


class Frames(Protocol):
    """What cameras see, as frames of a film.

    A frame has a ``number``, from 0, and ``cameras``: those of the moments of one exposure. ``goes_on`` is called now
    and then, and raises ``KeyboardInterrupt`` where the frame is not wanted any more.
    """

    def image(self, number: int, cameras: Sequence[Camera], goes_on: Callable[[], None]) -> np.ndarray:
        """Display values, float [H, W, 3] in 0..1."""
        ...

    def write_exr(self, file: Path, number: int, cameras: Sequence[Camera], goes_on: Callable[[], None]) -> None:
        """One OpenEXR file, in linear light. Raises ``OSError``."""
        ...

    def settings(self) -> dict[str, Any]:
        """What decides on the pictures, but for the cameras."""
        ...


def record(
    output: Output, path: CameraPath, frames_of: Callable[[], Frames], config: FilmConfig, progress: Progress
) -> Film:
    """Make a film. ``frames_of`` is called when all that was asked for is known to be possible.

    One that is stopped (Ctrl-C, SIGTERM) leaves no file; of numbered pictures the whole ones stay, and the same call
    goes on after them. Raises ``DataError``; ``Stopped`` when asked to stop.
    """
    size = path.size or DEFAULT_SIZE
    size = config.size or (_even(size) if output.pictures is None else size)
    fps = config.fps or path.fps or DEFAULT_FPS
    n, steps = path.frames(config.seconds, fps)
    if n > MOST_FRAMES:
        raise DataError("--seconds", f"{n / fps:g} s are {n:,} frames", f"use at most {MOST_FRAMES:,}")
    require_memory(output.out, *size, output.suffix, "make them smaller by --size")
    what = f"{path.what}: {counted(n, 'frame')} of {size[0]} x {size[1]}"
    if output.pictures is None:
        require_even(output.out, size)
    moments = path.moments(n, steps, config.shutter, config.samples if config.shutter else 1)  # [n, samples]
    path = path.read_at(moments)
    frames = frames_of()

    def cameras(number: int) -> list[Camera]:
        return [path.at(float(share)).camera(*size) for share in moments[number]]

    settings = {}
    if output.pictures:  # read before anything is written, as it may fail
        said = asdict(replace(config, fps=fps)) | {"path": Path(config.path).name}  # a file, wherever it is named from
        settings = {**frames.settings(), "frames": n, **said, "size": size, "cameras_sha256": path.sha256(moments)}
    with undisguised(progress) as told, writing(output.out):
        if output.pictures is None:
            _video(output.out, frames, cameras, n, size, fps, config.crf, lambda done: told(done, n, what))
        else:
            _pictures(output.pictures, frames, cameras, n, settings, lambda done: told(done, n, what))
    return Film(n, size, path.what, fps)


def _video(
    out: Path,
    frames: Frames,
    cameras: Callable[[int], list[Camera]],
    n: int,
    size: tuple[int, int],
    fps: int,
    crf: int,
    progress: Callable[[int], None],
) -> None:
    def images() -> Iterator[np.ndarray]:
        for number in range(n):
            line = f"stopped after {number} of {counted(n, 'frame')}; there is no {out}"
            with _stoppable(stop, line) as goes_on:
                image = frames.image(number, cameras(number), goes_on)
            yield image
            progress(number + 1)

    with StopRequest() as stop:
        write_video(out, images(), size, fps, crf)


def _pictures(
    pictures: NumberedPictures,
    frames: Frames,
    cameras: Callable[[int], list[Camera]],
    n: int,
    settings: Mapping[str, Any],
    progress: Callable[[int], None],
) -> None:
    with pictures.claimed(settings), StopRequest() as stop:
        for number in range(n):
            line = f"stopped after {number} of {counted(n, 'frame')}; the same command again goes on from there"
            with _stoppable(stop, line) as goes_on:
                if not pictures.has(number):
                    file, seen_by = pictures.file(number), cameras(number)
                    if pictures.linear:
                        frames.write_exr(file, number, seen_by, goes_on)
                    else:
                        write_png(file, frames.image(number, seen_by, goes_on))
            progress(number + 1)


@contextmanager
def _stoppable(stop: StopRequest, line: str) -> Iterator[Callable[[], None]]:
    """Makes a frame, and gives what is to be called meanwhile. Raises ``Stopped`` with this line when asked to stop."""

    def goes_on() -> None:
        if stop.signal_number:
            raise KeyboardInterrupt

    try:
        goes_on()
        yield goes_on
    except KeyboardInterrupt:
        if stop.signal_number:
            raise Stopped(line, stop.signal_number) from None
        raise


def _even(size: tuple[int, int]) -> tuple[int, int]:
    return max(2, size[0] // 2 * 2), max(2, size[1] // 2 * 2)
