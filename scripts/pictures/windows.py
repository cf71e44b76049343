"""Pictures of Blender's window as the documentation has them: parts of what ``scripts/blender/window.sh`` took.

    python -m scripts.pictures.windows WORK [NAME ...]

WORK is its folder, a NAME one of ``PARTS`` (default: all). A picture without photographs gets 256 colours: those that
are most frequent, so that even greys stay even, and others that do justice to rare ones, such as the colours of icons.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

from .panels import PICTURES

EXACT, OTHERS = 96, 160  # colours: the most frequent, and others
BIN = 4  # values of a channel that count as one, where the others are chosen
GAP = 6  # white rows between parts
PHOTOGRAPHIC = ("camera", "frame")  # these keep all colours
WHOLE = (0, 20, 1600, 920)  # without the title and the status bar
# by the name of the picture: names of window.py with the part of the display (left, upper, right, lower), stacked; size
PARTS = {
    "menu": ({"menu": (0, 22, 855, 582), "dialog": (354, 34, 1209, 412)}, None),
    "imported": ({"imported": WHOLE}, (1200, 675)),
    "editing": ({"editing": (432, 85, 1312, 900)}, None),
    "training": ({"training": (331, 100, 1291, 850)}, None),
    "camera": ({"camera": WHOLE}, (1200, 675)),
    "frame": ({"frame": (320, 20, 1600, 900)}, (1024, 704)),
    "german": ({"german": (432, 85, 1312, 900)}, None),
}


def main(work: Path, names: list[str]) -> None:
    """Write them."""
    for name in names or PARTS:
        parts, size = PARTS[name]
        pictures = [Image.open(work / f"window_{k}.png").convert("RGB").crop(box) for k, box in parts.items()]
        sheet = Image.new("RGB", (pictures[0].width, sum(p.height + GAP for p in pictures) - GAP), "white")
        top = 0
        for picture in pictures:
            sheet.paste(picture, (0, top))
            top += picture.height + GAP
        if size:
            sheet = sheet.resize(size, Image.Resampling.LANCZOS)
        sheet = sheet if name in PHOTOGRAPHIC else reduced(sheet)
        sheet.save(PICTURES / f"window_{name}.png", optimize=True)


def reduced(picture: Image.Image) -> Image.Image:
    """The picture in 256 colours, without dithering."""
    pixels = np.asarray(picture).reshape(-1, 3)
    colors, counts = np.unique(pixels, axis=0, return_counts=True)
    exact = colors[np.argsort(-counts)[:EXACT]]
    bins, where = np.unique(colors // BIN, axis=0, return_inverse=True)
    often = np.ceil(np.sqrt(np.bincount(where.ravel(), counts))).astype(int)  # so rare colours count more
    chosen = np.repeat((BIN * bins + BIN // 2).astype(np.uint8), often, axis=0)
    others = Image.fromarray(chosen[None]).quantize(OTHERS, Image.Quantize.MEDIANCUT, kmeans=3).getpalette() or []
    palette = np.concatenate([exact, np.reshape(others[: 3 * OTHERS], (-1, 3))]).astype(np.uint8)
    nearest = KDTree(palette.astype(float)).query(pixels.astype(float))[1].astype(np.uint8)
    made = Image.fromarray(nearest.reshape(picture.height, picture.width))
    made.putpalette(palette.ravel().tolist())
    return made


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
