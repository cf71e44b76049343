"""The same detail of a test view by every method, side by side, where they differ most."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..measure.metrics import psnr
from ..report.pictures import embedded_jpeg, embedded_png, figure, placed, read_pictures, worst_box

READ = """The window in which the methods differ most, of the test view whose PSNR is in the middle for {label}. PSNR is
that of the window. Seed """


def crops(folder: Path, table: dict[str, Any], data: str) -> str:
    """HTML; nothing where fewer than two methods have pictures of one seed.

    Args:
        folder: of the data set within the comparison.
    """
    runs = {name: row["data"][data]["runs"] for name, row in table["methods"].items() if data in row["data"]}
    seed = min((seed for of_method in runs.values() for seed in of_method), default="")
    names = [name for name, of_method in runs.items() if seed in of_method]
    if len(names) < 2:
        return ""
    view = _middle_view(folder / f"seed_{seed}" / names[0])
    files = {name: folder / f"seed_{seed}" / name / "test" / f"{view}.png" for name in names}
    pictures, words = read_pictures(files | {"": files[names[0]].with_name(f"{view}_gt.png")})
    truth = pictures.pop("", None)
    pictures = {name: picture for name, picture in pictures.items() if truth and picture.size == truth.size}
    if truth is None or len(pictures) < 2:
        return words
    arrays = {name: np.asarray(picture, np.float64) / 255 for name, picture in pictures.items()}
    spread = np.std([np.abs(array - np.asarray(truth) / 255).mean(-1) for array in arrays.values()], axis=0)  # [H, W]
    left, top, width, height = worst_box(spread)
    box = left, top, left + width, top + height
    figures = [
        figure(
            "Ground truth, whole view",
            embedded_jpeg(truth),
            truth.size,
            placed("b", (*box[:2], width, height), truth.size),
        )
    ]
    figures.append(figure("Ground truth", embedded_png(truth.crop(box)), truth.size))
    part = np.asarray(truth.crop(box)) / 255
    for name, picture in pictures.items():
        error = psnr(np.asarray(picture.crop(box)) / 255, part)
        words = f"{escape(table['methods'][name]['label'])}, {error:.2f} dB"
        figures.append(figure(words, embedded_png(picture.crop(box)), truth.size))
    label = escape(table["methods"][names[0]]["label"])
    head = (
        f"<h3 class=scene>The same detail</h3><p class=read>{READ.format(label=label)}{seed}, view {escape(view)}.</p>"
    )
    return f"{head}<div class=crops>{''.join(figures)}</div>"


def _middle_view(run: Path) -> str:
    """Name of the test view with the median PSNR."""
    views = json.loads((run / "metrics.json").read_text(encoding="utf-8"))["views"]
    ranked = sorted(views, key=lambda name: views[name]["psnr"])
    return ranked[len(ranked) // 2]
