"""A capture whose photographs disagree, as those of a walk outdoors do, made of one whose photographs do not.

Writes a COLMAP folder like the given one: with fewer photographs, each taken with an exposure of its own, of things
that moved in between, or with something in the way. ``dogsplat compare`` on such folders tells what the presets make of
them (docs/experiments/photographs.md). What stands in the way is left out of every eighth photograph, which is a test
view. Where it is, ``truth`` has masks of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets.colmap import find_model, image_folder
from mi_dogsplat.datasets.dataset import TEST_EVERY
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.files import is_empty
from mi_dogsplat.support.srgb import linear_to_srgb, srgb_to_linear
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

from .cutouts import pictures_of, with_a_thing

REACH = 25  # px, over which neighbours move alike: the standard deviation of a Gaussian
QUALITY = 97  # of JPEG, so that its own errors are small beside those that are made here


def main(argv: list[str]) -> None:
    """A folder of such photographs; what it has is printed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks disagreement", description=__doc__)
    parser.add_argument("data", type=Path, help="COLMAP folder")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--every", type=int, default=1, help="keep one photograph of so many, by name")
    parser.add_argument("--moved", type=float, default=0.0, help="what moves, along x and y: root mean square, px")
    parser.add_argument("--exposure", type=float, default=0.0, help="exposures are within this of the right one, EV")
    parser.add_argument("--in-the-way", type=float, default=0.0, help="share of photographs with a thing in the way")
    parser.add_argument("--things", type=Path, help="folder of .png with alpha, of which one is in the way")
    args = parser.parse_args(argv)
    if args.in_the_way and not args.things:
        parser.error("argument --in-the-way: needs --things")
    if args.every < 1:
        parser.error(f"argument --every: {args.every} is not at least 1")
    if args.out.exists() and not is_empty(args.out):
        raise DataError(args.out, "is not empty", "name a new folder: photographs are written there")
    model = find_model(args.data)
    if not model:
        raise DataError(args.data, "holds no COLMAP model", "give a folder with sparse/0")
    images = image_folder(args.data, model)
    things = pictures_of(args.things) if args.things else []
    kept = write_model(model, args.out / "sparse" / "0", args.every)
    rng = np.random.default_rng(7)
    for k, name in enumerate(kept):
        pixels = read_image(images / name)[..., :3].astype(np.float64)
        pixels = exposed(moved(pixels, args.moved, rng), args.exposure, rng)
        if k % TEST_EVERY and rng.random() < args.in_the_way:
            pixels, hidden = with_a_thing(pixels, things, rng)
            mask = (args.out / "truth" / name).with_suffix(".png")
            mask.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.where(hidden, 0, 255).astype(np.uint8)).save(mask)
        path = args.out / "images" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.rint(255 * pixels).astype(np.uint8)).save(path, quality=QUALITY)
    print(f"{args.out}: {len(kept)} photographs")


def write_model(model: Path, out: Path, every: int) -> list[str]:
    """The model with one photograph of ``every``; their names, in order."""
    try:
        import pycolmap
    except ImportError:
        raise DataError("python -m benchmarks disagreement", "pycolmap is missing", "run make setup") from None
    found = pycolmap.Reconstruction(str(model))
    kept = sorted(image.name for image in found.images.values())[::every]
    for image in list(found.images.values()):
        if image.name not in kept:
            found.deregister_frame(image.frame_id)
    out.mkdir(parents=True, exist_ok=True)
    found.write_binary(str(out))
    return kept


def moved(pixels: np.ndarray, distance: float, rng: np.random.Generator) -> np.ndarray:
    """[H, W, 3] whose parts have moved, smoothly, by ``distance`` pixels along x and along y (root mean square)."""
    if not distance:
        return pixels
    height, width, _ = pixels.shape
    by = [gaussian_filter(rng.normal(size=(height, width)), REACH) for _ in range(2)]
    at = [there + distance * d / d.std() for there, d in zip(np.mgrid[:height, :width], by, strict=True)]
    return np.stack([map_coordinates(pixels[..., c], at, order=1, mode="nearest") for c in range(3)], axis=-1)


def exposed(pixels: np.ndarray, reach: float, rng: np.random.Generator) -> np.ndarray:
    """[H, W, 3] in 0..1 with up to ``reach`` EV more or less light, as far as a photograph can show it."""
    if not reach:
        return pixels
    light = 2 ** rng.uniform(-reach, reach) * srgb_to_linear(pixels)
    return np.clip(linear_to_srgb(light).astype(np.float64), 0, 1)
