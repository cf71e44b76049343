"""Whether a report names the images that are spoilt, and no others: captures as they are, and with one of each cause.

Four training images are spoilt before the training: one is blurred as by a shaken hand, one is darker by a third, of
one the image is moved against its pose, and in one somebody stands. Prints what ``train/misfits.json`` holds.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.colmap import find_model, read_sources
from mi_dogsplat.report.run_folder import MISFITS
from mi_dogsplat.runs.run import train
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from PIL import Image

CAUSES: tuple[str, ...] = ("blur", "exposure", "pose", "region")
DARKER = 0.67
MOVED = 0.01  # of the width: against its pose
SMEAR = 0.03  # of the width, across which a shaken image is smeared


def main(argv: list[str]) -> None:
    """A line for each image that does not fit, of each capture as it is and spoilt."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks misfits", description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="COLMAP folders")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for what is spoilt and trained")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--downscale", type=int, default=4)
    parser.add_argument("--max-primitives", type=int, default=15_000)
    args = parser.parse_args(argv)
    set_variant("llvm_ad_rgb")
    for data in args.data:
        top = args.out / data.resolve().name
        planted = spoil(data, top / "spoilt")
        for which, path in {"as it is": data, "spoilt": top / "spoilt"}.items():
            size = {"downscale": args.downscale, "max_primitives": args.max_primitives}
            config = TrainConfig(data=str(path), steps=args.steps, **size)
            metrics = train(config, top / f"run {which}".replace(" ", "_"))
            found = json.loads((top / f"run {which}".replace(" ", "_") / MISFITS).read_text())
            share = found["seconds"] / metrics["train_seconds"]
            print(f"{data.resolve().name} {which}: test PSNR {metrics['test']['psnr']:.2f} dB; looked at "
                  f"{len(found['psnr'])} of {found['n_views']} views in {share:.1%} of the training", flush=True)
            for name, entry in found["misfits"].items():
                truth = f", planted {planted[name]}" if which == "spoilt" and name in planted else ""
                print(f"  {name}: {entry['below']:+.2f} dB below, {entry['cause'] or 'not clear'} "
                      f"({entry['explained']:.0%}){truth}", flush=True)


def spoil(data: Path, out: Path) -> dict[str, str]:
    """A copy of a COLMAP folder, one image of each cause spoilt; the causes by the names of the views."""
    model = find_model(data)
    assert model
    shutil.copytree(data / "images", out / "images", dirs_exist_ok=True)
    shutil.copytree(model, out / "sparse" / "0", dirs_exist_ok=True)
    paths = {source.name: source.image_path for source in read_sources(model, data / "images")[0]}
    names = [view.name for view in load_dataset(data, on_disk=True).train]
    chosen = dict(zip(names[2 :: max(1, len(names) // len(CAUSES))], CAUSES, strict=False))
    for name, cause in chosen.items():
        pixels = np.asarray(Image.open(paths[name]).convert("RGB"), np.float64)
        Image.fromarray(np.rint(spoilt(pixels, cause)).astype(np.uint8)).save(out / "images" / paths[name].name)
    return chosen


def spoilt(pixels: np.ndarray, cause: str) -> np.ndarray:
    """[H, W, 3] with what is wrong in it."""
    height, width, _ = pixels.shape
    if cause == "blur":
        reach = round(SMEAR * width / 2)
        padded = np.pad(pixels, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
        steps = range(2 * reach + 1)
        return np.mean([padded[k : k + height, k : k + width] for k in steps], axis=0)
    if cause == "exposure":
        return DARKER * pixels
    if cause == "pose":
        return np.roll(pixels, round(MOVED * width), axis=1)
    found = pixels.copy()
    found[height // 3 :, width // 2 : width // 2 + width // 6] = (40, 50, 90)
    return found
