"""Which lens images have: the one that is given, or that of panoramas where all of them say that they are some."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from ..datasets.images import UNREADABLE, open_image, stored_size
from ..support.errors import DataError
from .config import DEFAULT_LENS, EQUIRECTANGULAR
from .panoramas import cut_of

XMP = re.compile(rb"GPano:ProjectionType[=>]\s*[\"']?\s*equirectangular", re.IGNORECASE)


def lens_of_photographs(photographs: Iterable[Path], lens: str | None) -> str:
    """As ``lens_of``. Raises ``DataError`` also for panoramas that cannot be cut as one.

    A photograph that cannot be read is told later, with all others.
    """
    sizes, said = {}, {}
    for path in photographs:
        try:
            with open_image(path) as image:
                width, height = sizes[path] = stored_size(image)
                xmp = image.info.get("xmp")
        except UNREADABLE:
            continue
        said[path] = width == 2 * height and isinstance(xmp, bytes) and bool(XMP.search(xmp))
    found = lens_of(said, lens)
    if found == EQUIRECTANGULAR and sizes:
        cut_of(sizes)
    return found


def lens_of(said: Mapping[Path, bool], lens: str | None) -> str:
    """The lens of files: the given one; without one that of panoramas, if all of them say that they are some.

    said: whether a file says so. Raises ``DataError`` for one that does, where the lens is another.
    """
    if lens is None and said and all(said.values()):
        return EQUIRECTANGULAR
    panorama = next((path for path, says in said.items() if says), None)
    if panorama and lens != EQUIRECTANGULAR:
        remedy = f"leave out --lens {lens}" if lens else "remove it, or give only such files"
        raise DataError(panorama, "says that it is a panorama of all directions", remedy)
    return lens or DEFAULT_LENS
