"""Errors against a path-traced truth, region by region, as rows of a Markdown table."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from mi_dogsplat.support.srgb import linear_to_srgb


def display(linear: np.ndarray) -> np.ndarray:
    """What a screen shows: sRGB, 0 to 1."""
    return np.clip(linear_to_srgb(linear), 0, 1)


class ErrorTable:
    """Prints its head, and a row for each way to render. ``shown``: the truth; ``masks``: [H, W] of its regions."""

    def __init__(self, shown: np.ndarray, masks: dict[str, np.ndarray]):
        self.truth, self.masks = display(shown), masks
        print("| rendered by | primitives | samples | processor seconds | " + " | ".join(masks) + " |")
        print("|---" * (4 + len(masks)) + "|")
        print("| pixels | | | | " + " | ".join(str(mask.sum()) for mask in masks.values()) + " |")

    def row(self, name: str, spp: int, n: int, make: Callable[[int], np.ndarray]) -> None:
        """Take the processor time of a rendering, which takes a seed, and print its mean absolute errors."""
        make(1)  # compiles
        start = time.process_time()
        image = make(2)
        seconds = time.process_time() - start
        error = np.abs(display(image) - self.truth).mean(-1)
        columns = " | ".join(f"{error[mask].mean():.4f}" for mask in self.masks.values())
        print(f"| {name} | {n} | {spp} | {seconds:.2f} | {columns} |", flush=True)
