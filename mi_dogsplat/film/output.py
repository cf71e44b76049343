"""Where a film goes: to a video, or to numbered pictures."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ..support.errors import DataError
from ..support.settings import is_said, refuse
from .film_config import FilmConfig
from .pictures import NumberedPictures
from .video import SUFFIX

SLASHES = tuple(slash for slash in (os.sep, os.altsep) if slash)


@dataclass(frozen=True, eq=False)
class Output:
    """The file ``out`` of a video, or the place of ``pictures``."""

    out: Path
    pictures: NumberedPictures | None

    @property
    def in_linear_light(self) -> bool:
        """Whether the pictures are OpenEXR, with alpha and channels; others are display values."""
        return self.pictures is not None and self.pictures.linear

    @property
    def suffix(self) -> str:
        """That of a file which takes as much memory while it is made."""
        return ".exr" if self.in_linear_light else SUFFIX


def output_of(out: str | Path, config: FilmConfig) -> Output:
    """Where ``out`` says: a video ``.mp4``; a folder, or a name with a number such as ``frames/%04d.exr``.

    What ends in a slash is a folder, even where its name has a point. Raises ``DataError``, also for settings of the
    other kind.
    """
    in_folder = str(out).endswith(SLASHES)  # which a path forgets
    out = Path(out)
    if out.suffix.lower() == SUFFIX and not in_folder:
        if out.is_dir():
            raise DataError(out, "is a folder", "name a file in it")
        return Output(out, None)
    if is_said(config, "crf"):
        refuse("crf", f"is for videos, and {out} is for pictures", f"leave it out, or name a video {SUFFIX}")
    return Output(out, NumberedPictures(out, in_folder))
