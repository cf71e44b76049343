"""Where no features are sought: under masks that were given, and where an image is transparent.

A transparent pixel keeps a colour, which nobody sees: often that of the background that somebody has cut away. Masks
that were given are copied to the data set and masked in training, too. Those of transparent images serve here alone,
because training takes transparency as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ..datasets.images import header, is_opaque, read_image
from ..support.files import replacing
from .photographs import Photograph

HALF = 0.5  # of the opacity of a pixel that is seen


def feature_masks(photographs: Sequence[Photograph], images: Path, given: Path | None, made: Path) -> dict[str, Path]:
    """Folders with a mask ``<image>.png``, by the names of the images that have one.

    Args:
        given: the folder of masks in the sizes of the images, for some or all; None without any.
        made: a folder for those of transparent images, in which what is black in ``given`` is black, too.

    Raises ``DataError`` for what cannot be read.
    """
    folders: dict[str, Path] = {}
    for photograph in photographs:
        name = f"{photograph.name}.png"
        if given is not None and (given / name).is_file():
            folders[photograph.name] = given
        image = images / photograph.name
        if not header(image)[1] or is_opaque(image):
            continue
        seen = read_image(image)[..., 3] >= HALF
        if photograph.name in folders:
            with Image.open(folders[photograph.name] / name) as mask:
                seen &= np.asarray(mask.convert("L")) > 0
        with replacing(made / name) as part:
            Image.fromarray(np.where(seen, 255, 0).astype(np.uint8)).save(part, "PNG")
        folders[photograph.name] = made
    return folders
