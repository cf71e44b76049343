"""How far the cameras of a capture agree on what is up: by halves of them, chosen at random, and by their roll."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.scene.orientation import roll, up_name, up_of_cameras

HALVES = 40


def main(argv: list[str]) -> None:
    """A line for each data set."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks up", description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="data sets")
    for data in parser.parse_args(argv).data:
        c2w = np.stack([view.camera.c2w for view in load_dataset(data, on_disk=True).views])
        up, rng = up_of_cameras(c2w), np.random.default_rng(0)
        between = []
        for _ in range(HALVES):
            order = rng.permutation(len(c2w))
            between.append(_degrees(up_of_cameras(c2w[order[::2]]), up_of_cameras(c2w[order[1::2]])))
        mean = -c2w[:, :3, 1].mean(axis=0)
        print(
            f"{data.resolve().name}: up {up_name(up)}; halves differ by {np.median(between):.2f} degrees, roll "
            f"{np.degrees(np.arcsin(roll(c2w, up))):.1f}, the mean up of the images is {_degrees(mean, up):.1f} off"
        )


def _degrees(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))))
