"""Training on photographs whose sensor was full in places: ``python -m benchmarks exposures -o DIR``.

A scene of high contrast is captured with ``--hdr``. From each place a simulated sensor takes one
photograph, in one of several exposures in turn. A model is trained on

- ``truth``: the radiance itself;
- ``known``: the photographs, which say from which value on their sensor was full (``sensorSaturation``);
- ``masked``: the same, where such pixels do not count;
- ``unknown``: the photographs as they are, as if they were the truth;
- ``one known``, ``one unknown``: photographs of the longest exposure only.

All models are measured on validation views of the truth. Columns are those of ``python -m benchmarks hdr``.

Writes ``exposures.json`` and prints a table.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.exr import read_exr
from mi_dogsplat.poses.raw_files import FULL
from mi_dogsplat.runs.run import train
from mi_dogsplat.support.files import write_json
from mi_dogsplat.support.pictures import write_png, write_radiance
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from numpy.typing import NDArray

from .hdr import captured, measured, parser_of, print_rows
from .kept import same_settings

STOPS = 3  # between exposures
WELL = 20_000  # electrons of a full pixel
READ_NOISE = 4  # electrons, standard deviation
LEVELS = 2**14 - 1


@dataclass(frozen=True)
class Sensor:
    """That of a camera, simulated. Its pixels are full at the radiance ``full``."""

    full: float

    def recorded(self, radiance: NDArray, rng: np.random.Generator) -> NDArray[np.float32]:
        """Of radiance of any shape: with the noise of light and of reading, in levels, between 0 and ``full``."""
        electrons = rng.poisson(np.asarray(radiance, np.float64) / self.full * WELL)
        levels = np.rint((electrons + rng.normal(scale=READ_NOISE, size=electrons.shape)) / WELL * LEVELS)
        return (np.clip(levels, 0, LEVELS) / LEVELS * self.full).astype(np.float32)


@dataclass(frozen=True)
class Run:
    """What is trained on: photographs of so many ``exposures``, or the truth; and what they say of a full sensor."""

    exposures: int = 0
    told: bool = False
    masked: bool = False


RUNS = {
    "truth": Run(),
    "known": Run(3, told=True),
    "masked": Run(3, masked=True),
    "unknown": Run(3),
    "one known": Run(1, told=True),
    "one unknown": Run(1),
}


def main(flags: Sequence[str]) -> None:
    parser = parser_of("exposures", __doc__)
    parser.add_argument("--runs", nargs="+", default=list(RUNS), choices=tuple(RUNS), help="some of them")
    parser.add_argument("--downscale", type=int, default=1, help="of the photographs, in the training")
    args = parser.parse_args(flags)
    set_variant(args.variant)
    same_settings(args.out, args, "scene", ("preset", "steps", "views", "size", "spp", "downscale"))
    source = captured(args, hdr=True)
    truth = load_dataset(source, args.downscale, split="validation")
    rows = {}
    for name in args.runs:
        out = args.out / name.replace(" ", "_")
        if not (out / "metrics.json").exists():
            data, run = source, RUNS[name]
            if run.exposures:
                data = photographed(source, args.out / f"data_{out.name}", run, truth.white or 1.0)
            masks = str(data / "masks") if run.masked else None
            kept = {name: getattr(args, name) for name in ("preset", "steps", "downscale")}
            config = TrainConfig(str(data), target=0.3, split="validation", masks=masks, **kept)
            train(config, out, resume=(out / "config.json").exists())
        rows[name], _ = measured(out / "point_cloud.ply", truth)
        print(name, {key: round(value, 4) for key, value in rows[name].items()}, flush=True)
    write_json(args.out / "exposures.json", {"steps": args.steps, "white": truth.white, "rows": rows})
    print_rows(rows)


def photographed(source: Path, out: Path, run: Run, white: float) -> Path:
    """A data set of photographs of ``source``, whose longest exposure is full at ``white``; made anew."""
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(source, out)
    rng = np.random.default_rng(0)
    for k, image in enumerate(sorted((out / "images").iterdir())):
        full = white * 2.0 ** (STOPS * (k % run.exposures))
        pixels = read_exr(image)
        recorded = np.concatenate([Sensor(full).recorded(pixels[..., :3], rng), pixels[..., 3:]], axis=2)
        write_radiance(image, recorded, FULL * full if run.told else None)
        if run.masked:
            saturated = recorded[..., :3].max(axis=2) >= FULL * full
            (out / "masks").mkdir(exist_ok=True)
            write_png(out / "masks" / f"{image.stem}.png", np.where(saturated, 0.0, 1.0))
    return out
