"""A film as numbered pictures in a folder, which can be stopped and continued.

``film.json`` beside them holds what decides on the pictures, so that pictures of two films are never mixed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..support.errors import DataError
from ..support.files import remove_parts
from ..support.locks import locked
from ..support.resumable import begun

SUFFIXES = (".png", ".exr")
SETTINGS = "film.json"
DEFAULT_NAME = "%04d.png"
NUMBER = re.compile(r"%(0\d)?d")


class NumberedPictures:
    """The pictures of ``out``: a folder, or a name in one such as ``%04d.exr``. Raises ``DataError``.

    ``in_folder``: it is a folder whatever its name, there already or not. ``linear``: they are OpenEXR, in linear
    light; others are PNG.
    """

    def __init__(self, out: Path, in_folder: bool = False):
        named = out.suffix != "" and not in_folder and not out.is_dir()  # names of folders may have points
        self.folder, self._pattern = (out.parent, out.name) if named else (out, DEFAULT_NAME)
        suffix = Path(self._pattern).suffix.lower()
        if suffix not in SUFFIXES or self._pattern.count("%") != 1 or not NUMBER.search(self._pattern):
            remedy = "name a video .mp4, a folder/, or pictures with a number as frames/%04d.png or frames/%04d.exr"
            raise DataError(out, "is not a video or pictures", remedy)
        if self.folder.exists() and not self.folder.is_dir():
            raise DataError(self.folder, "is a file", "name a folder for the pictures")
        self.linear = suffix == ".exr"

    def file(self, number: int) -> Path:
        """That of a frame, counted from 0."""
        return self.folder / (self._pattern % number)

    @contextmanager
    def claimed(self, settings: Mapping[str, Any]) -> Iterator[None]:
        """Make the folder, or find one of the same ``settings``; it is ours alone then. Where no picture comes of it,
        as with a disk that is full, none is begun.

        Raises ``DataError`` for any other folder, and for one that another process is writing to.
        """
        own = json.loads(json.dumps({**settings, "pictures": self._pattern}))
        beside = "another process is writing frames to it"
        with begun(self.folder / SETTINGS, own, "film"), locked(self.folder, beside):
            remove_parts(self.folder)
            yield

    def has(self, number: int) -> bool:
        """Whether a frame is there; a picture appears whole or not at all."""
        return self.file(number).is_file()
