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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..datasets import Dataset, load_dataset
from ..datasets.dataset import View
from ..engine.parameters import upload
from ..engine.rasterize import RasterOptions
from ..errors import DataError
from ..evaluate import render_milliseconds_in_turn
from ..files import replacing, write_json
from ..mixture import write_comparison
from ..pruning.scheduler import PruningRule
from ..pruning.score import ScoreRule
from ..render import Picture, render_picture
from ..report.write import write_report
from ..run import train
from ..run_folder import DOG_PROFILE, RECIPE, RENDER_MS
from ..scene.ply import read_ply
from ..stopping import Stopped
from ..training.checkpoint import load_checkpoint, save_checkpoint
from ..training.config import FREE, TrainConfig, background_color
from ..training.history import run_to_end
from ..training.presets import RECIPES, Recipe
from ..training.train import Trainer
from .page import ablation_page
from .table import write_table

OPACITY = ScoreRule("opacity")
EQUAL = PruningRule(division="equal", rounds=5)


@dataclass(frozen=True)
class Variant:
    """A row of the table."""

    label: str
    recipe: Recipe


# Paper, Table 3: each adds one part to the variant before it.
VARIANTS = {
    "3dgs": Variant("3DGS, 100 %", RECIPES["3dgs"]),
    "v1": Variant("V1: RIR, equal steps, opacity", Recipe(pruning=EQUAL, score=OPACITY)),
    "v2": Variant("V2: + DPRA", Recipe(pruning=PruningRule(), score=OPACITY)),
    "v3": Variant("V3: + SPS", replace(RECIPES["paper"], dog=None)),
    "full": Variant("full: + 3D-DoG (paper)", RECIPES["paper"]),
    # its own schedule is longer; here everybody has the same number of steps
    "released": Variant("released code", replace(RECIPES["released"], reference_steps=30_000)),
    "ours_gaussian": Variant("ours, without DoG", replace(RECIPES["ours"], dog=None)),
    "ours": Variant("ours", RECIPES["ours"]),
}
WITHOUT_DOG = {"full": "v3", "ours": "ours_gaussian"}


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
    _claim(out, config)
    for seed in seeds:
        folder = out / f"seed_{seed}"
        folder.mkdir(exist_ok=True)
        baseline = replace(config, preset="3dgs", seed=seed)
        start = _densified_start(baseline, dataset, folder / "start.npz", progress)
        for name in variants:
            nearest = replace(baseline, preset=name if name in RECIPES else "paper")  # recipe.json has the numbers
            _train_variant(nearest, VARIANTS[name], folder / name, start, progress)
        _look(dataset, config, {name: folder / name for name in variants})
    table = write_table(out, {name: VARIANTS[name].label for name in VARIANTS})
    with replacing(out / "ablation.html") as part:
        part.write_text(ablation_page(out, table), encoding="utf-8")
    return table


def _claim(out: Path, config: TrainConfig) -> None:
    """Make the folder an ablation with these settings. Raises ``DataError`` if it is something else."""
    settings = {k: v for k, v in dataclasses.asdict(config).items() if k not in ("preset", "seed", *FREE)}
    path = out / "config.json"
    if path.exists() and json.loads(path.read_text(encoding="utf-8")) != settings:
        raise DataError(out, "holds an ablation with other settings", "name another folder")
    if not path.exists() and out.is_dir() and any(out.iterdir()):
        raise DataError(out, "is a folder with other contents", "name a new folder, or an earlier ablation")
    out.mkdir(parents=True, exist_ok=True)
    write_json(path, settings)


def _densified_start(config: TrainConfig, dataset: Dataset, path: Path, progress: Callable[[str], None]) -> dict:
    """The state at the end of densification, trained once and kept."""
    if not path.exists():
        progress(f"seed {config.seed}: densifying")
        trainer = Trainer(config, dataset)
        for row in run_to_end(trainer):
            if row["step"] >= trainer.densification.stop:
                break
        save_checkpoint(path, trainer.state())
    return load_checkpoint(path)


def _train_variant(
    config: TrainConfig, variant: Variant, folder: Path, start: dict, progress: Callable[[str], None]
) -> None:
    recipe = {"label": variant.label, "recipe": json.loads(json.dumps(dataclasses.asdict(variant.recipe)))}
    known = folder / RECIPE
    complete = (folder / "metrics.json").exists() and known.exists()
    if complete and json.loads(known.read_text(encoding="utf-8")) == recipe:
        return
    progress(f"seed {config.seed}: {variant.label}")
    try:
        metrics = train(config, folder, recipe=variant.recipe, start=start)
    except Stopped as stop:
        message = f"stopped in {folder}; what is complete is kept, and the same command goes on with this variant"
        raise Stopped(message, stop.signal_number) from None
    write_json(known, recipe)
    write_report(folder)  # again, under the variant's name
    test = metrics["test"]
    progress(f"    {test['psnr']:.2f} dB, {metrics['n']:,} primitives, {metrics['train_seconds']:.0f} s")


def _look(dataset: Dataset, config: TrainConfig, folders: dict[str, Path]) -> None:
    """Time the renders of all models of a seed in turns, and compare pictures with and without DoG."""
    background = background_color(config.background, dataset.has_alpha)

    def drawing(folder: Path) -> Callable[[View], Picture]:
        splats = read_ply(folder / "point_cloud.ply")
        options, params = RasterOptions(splats.sh_degree, config.antialiased), upload(splats)
        return lambda view: render_picture(params, view.camera, options, background, config.near_clip)

    drawings = {name: drawing(folder) for name, folder in folders.items()}
    times = render_milliseconds_in_turn(drawings, dataset.test)
    for name, folder in folders.items():
        write_json(folder / RENDER_MS, {"render_ms": times[name], "in_turn_with": sorted(folders)})
    for name, without in WITHOUT_DOG.items():
        profile = folders[name] / "test" / DOG_PROFILE if {name, without} <= folders.keys() else None
        if profile and profile.exists():  # else no primitive is DoG any more
            shown = json.loads(profile.read_text(encoding="utf-8"))["view"]
            view = next(view for view in dataset.test if view.name == shown)
            words = f'the model trained without it, "{VARIANTS[without].label}"'
            write_comparison(drawings[name], drawings[without], view, background, profile.parent, words)
            write_report(folders[name])
