"""Step sizes of the preset "ours" under stress: other units of the scene, other captures, and larger and smaller steps.

Steps of positions are in units of the camera extent, 16 times as long after pruning as in the published recipe. In
other units of length (cameras, points and near plane times a factor) a training must be the same but for rounding,
which densification amplifies like another seed does. And ``gain`` varies the 16, to see what margin there is.

    python -m benchmarks scene_scale DATA... [--downscale K] [--steps N] [--max-primitives N]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.train import Trainer

SCALES = (0.01, 1.0, 100.0)
GAINS = (1.0, 4.0, 16.0, 64.0)
USUAL = 16.0


def in_units(dataset: Dataset, scale: float) -> Dataset:
    """The data set with every length times ``scale``."""

    def larger(view: View) -> View:
        w2c = view.camera.w2c.copy()
        w2c[:3, 3] *= scale
        return replace(view, camera=replace(view.camera, w2c=w2c))

    return replace(
        dataset,
        train=[larger(view) for view in dataset.train],
        test=[larger(view) for view in dataset.test],
        points=dataset.points * scale,
    )


def trained(config: TrainConfig, dataset: Dataset, scale: float = 1.0, gain: float = USUAL) -> dict[str, Any]:
    """The last row of the history of a training with "ours"."""
    recipe = RECIPES["ours"]
    assert recipe.refinement
    recipe = replace(recipe, refinement=replace(recipe.refinement, means_gain=gain))
    trainer = Trainer(replace(config, near_clip=scale * DrawnAs().near_clip), in_units(dataset, scale), recipe)
    return list(run_to_end(trainer))[-1]


def main(flags: list[str]) -> None:
    shown = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks scene_scale", description=__doc__, formatter_class=shown
    )
    parser.add_argument("data", nargs="+", help="data sets")
    parser.add_argument("--downscale", type=int, default=4, help="of the photographs (default: 4)")
    parser.add_argument("--steps", type=int, default=1500, help="of each training (default: 1500)")
    parser.add_argument("--max-primitives", type=int, default=5000, help="before pruning (default: 5000)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(flags)
    set_variant("llvm_ad_rgb")
    for path in args.data:
        dataset = load_dataset(path, args.downscale)
        config = TrainConfig(
            path, steps=args.steps, downscale=args.downscale, max_primitives=args.max_primitives, seed=args.seed
        )
        for scale, gain in [*((scale, USUAL) for scale in SCALES), *((1.0, gain) for gain in GAINS if gain != USUAL)]:
            row = trained(config, dataset, scale, gain)
            result = f"{row['test_psnr']:6.2f} dB, l1 {row['l1']:.4f}, {row['n']} primitives"
            print(f"{Path(path).name:10s} scale {scale:6g}, position steps x {gain:3g}: {result}", flush=True)
