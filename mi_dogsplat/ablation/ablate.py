"""The ablation of the method on one data set: every variant goes on from the same densified start, for several seeds.

    DIR/seed_K/start.npz        the shared start: the 3DGS recipe up to the end of its densification
    DIR/seed_K/VARIANT/         a run folder like any other, and the numbers of its recipe
    DIR/ablation.json, .md      the table: mean and spread over the seeds
    DIR/ablation.html           the same, and error against run time

A variant that is complete is not repeated, so an ablation that was cut off goes on where it was, and another seed or
variant can be added.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..datasets import Dataset, load_dataset
from ..render.picture import background_color
from ..report.run_folder import DOG_PROFILE
from ..report.write import write_report
from ..runs.mixture import write_comparison
from ..support.errors import DataError
from ..support.files import replacing, write_json
from ..training.config import FREE, TrainConfig
from .page import ablation_page
from .table import write_table
from .variants import VARIANTS, WITHOUT_DOG, densified_start, draw_in_turn, train_variant


def ablate(
    config: TrainConfig,
    out: Path,
    seeds: Sequence[int],
    variants: Sequence[str] = tuple(VARIANTS),
    progress: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Train every variant with every seed and write the table; returns what ``ablation.json`` holds.

    Args:
        config: data, steps, target, cap and so on; its preset and seed are not used.
        out: folder of the ablation, made if need be.
        variants: names in ``VARIANTS``.
        progress: called with a line as something starts or is done.

    Raises ``DataError`` for bad data, or a folder that holds an ablation with other settings.
    """
    out = Path(out)
    dataset = load_dataset(config.data, config.downscale)
    if not dataset.test:
        raise DataError(config.data, "has no test views to compare variants on", "give it a test split")
    claim(out, config)
    for seed in seeds:
        folder = out / f"seed_{seed}"
        folder.mkdir(exist_ok=True)
        baseline = replace(config, preset="3dgs", seed=seed)
        start = densified_start(baseline, dataset, folder / "start.npz", progress)
        for name in variants:
            train_variant(baseline, VARIANTS[name], folder / name, start, progress)
        _look(dataset, config, {name: folder / name for name in variants})
    table = write_table(out, {name: VARIANTS[name].label for name in VARIANTS})
    with replacing(out / "ablation.html") as part:
        part.write_text(ablation_page(out, table), encoding="utf-8")
    return table


def claim(out: Path, config: TrainConfig) -> None:
    """Make the folder one of runs with these settings. Raises ``DataError`` if it is something else."""
    settings = {k: v for k, v in dataclasses.asdict(config).items() if k not in ("preset", "seed", *FREE)}
    path = out / "config.json"
    if path.exists() and json.loads(path.read_text(encoding="utf-8")) != settings:
        raise DataError(out, "holds runs with other settings", "name another folder")
    if not path.exists() and out.is_dir() and any(out.iterdir()):
        raise DataError(out, "is a folder with other contents", "name a new folder, or that of an earlier call")
    out.mkdir(parents=True, exist_ok=True)
    write_json(path, settings)


def _look(dataset: Dataset, config: TrainConfig, folders: dict[str, Path]) -> None:
    """Time the renders of all models of a seed in turns, and compare pictures with and without DoG."""
    background = background_color(config.background, dataset.has_alpha)
    drawings = draw_in_turn(dataset, config, folders)
    for name, without in WITHOUT_DOG.items():
        profile = folders[name] / "test" / DOG_PROFILE if {name, without} <= folders.keys() else None
        if profile and profile.exists():  # else no primitive is DoG any more
            shown = json.loads(profile.read_text(encoding="utf-8"))["view"]
            view = next(view for view in dataset.test if view.name == shown)
            words = f'the model trained without it, "{VARIANTS[without].label}"'
            write_comparison(drawings[name], drawings[without], view, background, profile.parent, words)
            write_report(folders[name])
