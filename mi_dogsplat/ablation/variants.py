"""The variants of an ablation, and their runs: all of a seed go on from one densified start.

A comparison with other methods (``compare/``) trains the same way.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from ..datasets import Dataset
from ..datasets.dataset import View
from ..engine.parameters import upload
from ..engine.rasterize import RasterOptions
from ..measure.evaluate import render_milliseconds_in_turn
from ..render.picture import Picture, background_color, render_picture
from ..report.run_folder import RECIPE, RENDER_MS
from ..report.write import write_report
from ..runs.checkpoint import load_checkpoint, save_checkpoint
from ..runs.history import run_to_end
from ..runs.run import train
from ..runs.stopping import Stopped
from ..scene.ply import read_ply
from ..scores.score import ScoreRule
from ..support.files import write_json
from ..training.config import TrainConfig
from ..training.presets import RECIPES, Recipe
from ..training.strategy.scheduler import PruningRule
from ..training.train import Trainer

OPACITY = ScoreRule("opacity")
EQUAL = PruningRule(division="equal", rounds=5)


@dataclass(frozen=True)
class Variant:
    """A row of the table."""

    label: str
    recipe: Recipe
    trainer: type[Trainer] = Trainer  # of a method that does more than a recipe says
    source: str = ""  # paper
    grows: bool = False  # to the target from the first step on, instead of going on from the densified start


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


def densified_start(config: TrainConfig, dataset: Dataset, path: Path, progress: Callable[[str], None]) -> dict:
    """The state at the end of densification, trained once and kept."""
    if not path.exists():
        progress(f"seed {config.seed}: densifying")
        trainer = Trainer(config, dataset)
        for _ in run_to_end(trainer, until=min(trainer.densification.stop, config.steps)):
            pass
        save_checkpoint(path, trainer.state())
    return load_checkpoint(path)


def recipe_of(variant: Variant) -> dict:
    """What the run folder of a variant keeps, as JSON gives it back: its label and the numbers of its recipe."""
    return {"label": variant.label, "recipe": json.loads(json.dumps(dataclasses.asdict(variant.recipe)))}


def is_complete(folder: Path, variant: Variant) -> bool:
    """Whether a folder holds a finished run of this variant."""
    known = folder / RECIPE
    finished = (folder / "metrics.json").exists() and known.exists()
    return finished and json.loads(known.read_text(encoding="utf-8")) == recipe_of(variant)


def train_variant(
    config: TrainConfig, variant: Variant, folder: Path, start: dict, progress: Callable[[str], None]
) -> None:
    """Fill a run folder, unless it is complete.

    Args:
        config: its preset is not used.
        folder: named like the variant.
        start: state at the end of densification.
    """
    if is_complete(folder, variant):
        return
    progress(f"seed {config.seed}: {variant.label}")
    preset = folder.name if folder.name in RECIPES else "paper"
    config = replace(config, preset=preset)  # the nearest; recipe.json has the numbers
    known = None if variant.grows else start
    try:
        metrics = train(config, folder, recipe=variant.recipe, start=known, kind=variant.trainer)
    except Stopped as stop:
        message = f"stopped in {folder}; what is complete is kept, and the same command goes on with this variant"
        raise Stopped(message, stop.signal_number) from None
    write_json(folder / RECIPE, recipe_of(variant))
    write_report(folder)  # again, under the variant's name
    test = metrics["test"]
    progress(f"    {test['psnr']:.2f} dB, {metrics['n']:,} primitives, {metrics['train_seconds']:.0f} s")


def drawing(folder: Path, config: TrainConfig, background: float) -> Callable[[View], Picture]:
    """Renders views of the model in a run folder."""
    splats = read_ply(folder / "point_cloud.ply")
    options, params = RasterOptions(splats.sh_degree, config.antialiased), upload(splats)
    return lambda view: render_picture(params, view.camera, options, background, config.near_clip)


def draw_in_turn(dataset: Dataset, config: TrainConfig, folders: dict[str, Path]) -> dict:
    """Time the renders of all models of a seed in turns; returns what renders each."""
    background = background_color(config.background, dataset.has_alpha)
    drawings = {name: drawing(folder, config, background) for name, folder in folders.items()}
    times = render_milliseconds_in_turn(drawings, dataset.test)
    for name, folder in folders.items():
        write_json(folder / RENDER_MS, {"render_ms": times[name], "in_turn_with": sorted(folders)})
    return drawings
