"""From a model and a camera path to a film; behind ``dogsplat film``."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.read import require_primitives
from ..render.picture import picture_of
from ..render.picture_memory import require_memory
from ..render.picture_options import PictureOptions
from ..runs.stopping import Stopped, StopRequest
from ..support.errors import DataError, undisguised, writing
from ..support.settings import refuse
from ..support.variants import require_arrays
from ..support.wording import counted
from .camera_path import DEFAULT_SIZE, CameraPath
from .data_path import cameras_path
from .exposure import exposed
from .film_config import FilmConfig
from .key_frames import key_frames_path
from .orbit import around_cameras, around_model, orbit, stand_all_around
from .pictures import NumberedPictures
from .subject import Subject, read_subject
from .video import SUFFIX, require_even, write_video

MOST_FRAMES = 1_000_000
SLASHES = tuple(slash for slash in (os.sep, os.altsep) if slash)


@dataclass(frozen=True)
class Film:
    """What was made: ``n_frames`` of a size, along ``path`` in words."""

    n_frames: int
    size: tuple[int, int]
    path: str


def make_film(
    model: str | Path,
    out: str | Path,
    data: str | Path | None = None,
    config: FilmConfig = FilmConfig(),  # noqa: B008, it is immutable
    options: PictureOptions = PictureOptions(),
    progress: Callable[[int, int, str], None] = lambda done, n, what: None,
) -> Film:
    """Render a film of a model.

    Args:
        model: a model file, or a run folder, which knows its data and how it was trained.
        out: a video ``.mp4``; or pictures: a folder, or a name with a number such as ``frames/%04d.exr``. What ends in
            a slash is a folder, even where its name has a point.
        data: the data set whose cameras the path follows or stands on.
        config: the path, and how its pictures become a film.
        options: how the model is drawn; what they do not say, the run or the file of the model does.
        progress: gets the number of finished frames, that of all, and the path in words.

    Needs a Mitsuba variant. A film that is stopped (Ctrl-C, SIGTERM) leaves no file; of numbered pictures the whole
    ones stay, and the same call goes on after them. Raises ``DataError``; ``Stopped`` when asked to stop.
    """
    require_arrays()
    in_folder = str(out).endswith(SLASHES)  # which a path forgets
    model, out = Path(model), Path(out)
    pictures = None if out.suffix.lower() == SUFFIX and not in_folder else NumberedPictures(out, in_folder)
    if out.is_dir() and pictures is None:
        raise DataError(out, "is a folder", "name a file in it")
    if pictures is not None and config.says("crf"):
        refuse("crf", f"is for videos, and {out} is for pictures", f"leave it out, or name a video {SUFFIX}")
    subject = read_subject(model, data, options)
    require_primitives(model, subject.model, "film")
    options.require_for(subject.drawn.linear)
    path = _path(subject, config)
    size = path.size or DEFAULT_SIZE
    size = config.size or (_even(size) if pictures is None else size)
    n, steps = path.frames(config.seconds, config.fps)
    if n > MOST_FRAMES:
        raise DataError("--seconds", f"{n / config.fps:g} s are {n:,} frames", f"use at most {MOST_FRAMES:,}")
    what = f"{path.what}: {counted(n, 'frame')} of {size[0]} x {size[1]}"
    alpha = pictures is not None and pictures.alpha
    require_memory(out, *size, ".exr" if alpha else SUFFIX, "make them smaller by --size")
    background = 0.0 if alpha else subject.background  # which would clamp what is brighter than it leaves room for
    picture = picture_of(subject.model.splats, background, subject.drawn)
    moments = path.moments(n, steps, config.shutter, config.samples if config.shutter else 1)  # [n, samples]

    def frame(number: int) -> np.ndarray:
        cameras = [path.at(float(share)).camera(*size) for share in moments[number]]
        return exposed(picture, cameras, background, alpha)

    with undisguised(progress) as told, writing(out):
        if pictures is None:
            require_even(out, size)
            _video(out, frame, n, size, config, lambda done: told(done, n, what))
        else:
            with pictures.claimed(_settings(subject, config, n, size) | {"cameras_sha256": path.sha256(moments)}):
                _pictures(pictures, frame, n, lambda done: told(done, n, what))
    return Film(n, size, path.what)


def _video(
    out: Path,
    frame: Callable[[int], np.ndarray],
    n: int,
    size: tuple[int, int],
    config: FilmConfig,
    progress: Callable[[int], None],
) -> None:
    with StopRequest() as stop:

        def frames() -> Iterator[np.ndarray]:
            for number in range(n):
                if stop.signal_number:
                    line = f"stopped after {number} of {counted(n, 'frame')}; there is no {out}"
                    raise Stopped(line, stop.signal_number)
                yield frame(number)
                progress(number + 1)

        write_video(out, frames(), size, config.fps, config.crf)


def _pictures(
    pictures: NumberedPictures, frame: Callable[[int], np.ndarray], n: int, progress: Callable[[int], None]
) -> None:
    with StopRequest() as stop:
        for number in range(n):
            if stop.signal_number:
                line = f"stopped after {number} of {counted(n, 'frame')}; the same command again goes on from there"
                raise Stopped(line, stop.signal_number)
            if not pictures.has(number):
                pictures.write(number, frame(number))
            progress(number + 1)


def _path(subject: Subject, config: FilmConfig) -> CameraPath:
    """Raises ``DataError``."""
    cameras, up = subject.cameras, subject.up
    if config.path.lower().endswith(".json"):
        return key_frames_path(Path(config.path), up, config.fov)
    if config.path == "cameras" and not cameras:
        raise DataError("--path", "no data set tells where the cameras are", "add --data DATA, or use --path orbit")
    if config.path == "cameras" or (config.path == "auto" and cameras and not stand_all_around(cameras, up)):
        config.require_for("cameras")
        return cameras_path(cameras, config)
    config.require_for("orbit")
    if cameras:
        return orbit(around_cameras(cameras, up, config.fov), config)
    path = orbit(around_model(subject.model.splats, up, config.fov), config)
    return dataclasses.replace(path, what=f"{path.what} ({subject.missing})") if subject.missing else path


def _even(size: tuple[int, int]) -> tuple[int, int]:
    return max(2, size[0] // 2 * 2), max(2, size[1] // 2 * 2)


def _settings(subject: Subject, config: FilmConfig, n: int, size: tuple[int, int]) -> dict[str, Any]:
    """What decides on the pictures, but for where the camera is."""
    digest = hashlib.sha256()
    for field in dataclasses.fields(subject.model.splats):
        digest.update(getattr(subject.model.splats, field.name).data)
    drawn = {"background": subject.background, **dataclasses.asdict(subject.drawn)}
    said = dataclasses.asdict(config) | {"path": Path(config.path).name}  # a file, wherever it is named from
    return {"model_sha256": digest.hexdigest(), "frames": n, **said, "size": size, **drawn}
