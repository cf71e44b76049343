"""Appearance of single photographs: nothing learned, affine maps, and ``--appearance``, on captures of phones.

A data set is trained on as a phone would have taken it (``phone_photographs.py``), in each way, and held-out views of
the same phone are measured: PSNR as they are, after each view's best affine map (``cc_psnr``), and of the right half
after the exposure was fitted on the left one (``half_psnr``, the same fit for all). Each training is a row of
OUT/results.jsonl; what is there is not trained again, so that a stopped benchmark goes on. Then come the tables, of
means over seeds.

    python -m benchmarks appearance fox fern -o OUT [--phones steady varied] [--seeds 0 1 2]
"""

from __future__ import annotations

import argparse
import itertools
import json
from pathlib import Path
from typing import Any

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import SPLITS
from mi_dogsplat.measure.evaluate import Measure, evaluate_views, mean_metrics
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.appearance import Appearance
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

from .affine_maps import AffineMaps
from .phone_photographs import PHONES, taken

WAYS = ("off", "affine", "appearance")
FIGURES = {"psnr": 2, "cc_psnr": 2, "half_psnr": 2, "ssim": 3, "flip": 3, "seconds": 0}


def main(argv: list[str]) -> None:
    """Train what is not there yet, and print the tables."""
    shown = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks appearance", description=__doc__, formatter_class=shown
    )
    parser.add_argument("data", nargs="+", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--phones", nargs="+", choices=[*PHONES], default=[*PHONES])
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--downscale", type=int, default=2)
    parser.add_argument("--max-primitives", type=int, default=30_000)
    parser.add_argument("--split", choices=SPLITS, default="test")
    args = parser.parse_args(argv)
    set_variant("llvm_ad_rgb")
    args.out.mkdir(parents=True, exist_ok=True)
    results, settings = args.out / "results.jsonl", []
    for seed, data, phone, way in itertools.product(args.seeds, args.data, args.phones, args.ways):
        config = TrainConfig(
            str(data), preset="3dgs", steps=args.steps, downscale=args.downscale, seed=seed, split=args.split,
            max_primitives=args.max_primitives, appearance=way != "off", test_every=args.steps + 1,
        )  # fmt: skip
        setting = {"data": data.resolve().name, "phone": phone, "way": way, "seed": seed, "steps": args.steps}
        settings.append(setting | {"split": args.split, "downscale": args.downscale, "cap": args.max_primitives})
        if not any(settings[-1].items() <= row.items() for row in _rows(results)):
            row = settings[-1] | trained(config, phone, way)
            with open(results, "a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    rows = [row for row in _rows(results) if any(setting.items() <= row.items() for setting in settings)]
    print("\n".join(table(rows)))


def trained(config: TrainConfig, phone: str, way: str) -> dict[str, Any]:
    """Figures of a training on what the phone took, and what was learned."""
    dataset = load_dataset(config.data, config.downscale, split=config.split)
    trainer = Trainer(config, taken(dataset, PHONES[phone]))
    learned = trainer.photographs.appearance if way == "appearance" else None
    if way == "affine":
        trainer.photographs.appearance = AffineMaps(len(dataset.train), config.steps)  # type: ignore[assignment]
    for _ in run_to_end(trainer):
        pass
    names = [view.name for view in dataset.train]
    appearance = learned.stored(names) if learned else Appearance([], [], np.zeros((0, 3)), np.zeros((0, 2)))
    measure = Measure(appearance=appearance)
    found = mean_metrics(evaluate_views(trainer.picture, trainer.dataset.test, trainer.background, measure=measure))
    gains, vignetting = appearance.of_images.round(4).tolist(), appearance.of_devices.round(4).tolist()
    return found | {"seconds": trainer.seconds, "gains": gains, "vignetting": vignetting}


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of Markdown: a row for each data set, phone and way, means over seeds."""
    lines = ["| data | phone | way | seeds | " + " | ".join(FIGURES) + " |", "|---" * (4 + len(FIGURES)) + "|"]
    for key in dict.fromkeys((row["data"], row["phone"], row["way"]) for row in rows):
        same = [row for row in rows if (row["data"], row["phone"], row["way"]) == key]
        means = (f"{np.mean([row[name] for row in same]):.{digits}f}" for name, digits in FIGURES.items())
        lines.append(f"| {' | '.join(key)} | {len(same)} | {' | '.join(means)} |")
    return lines


def _rows(results: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
