"""A training run as a folder: config, history, model, test renders, metrics, report."""

from __future__ import annotations

import dataclasses
import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from .datasets import Dataset, load_dataset
from .engine.geometry import Cutoffs
from .errors import DataError
from .evaluate import evaluate_views, mean_metrics, render_milliseconds
from .files import replacing, write_json
from .mixture import write_mixture
from .report.write import write_report
from .run_folder import RECIPE, RENDER_MS
from .scene.ply import write_ply
from .training.checkpoint import load_checkpoint, save_checkpoint
from .training.config import TrainConfig
from .training.history import run_to_end
from .training.presets import Recipe
from .training.train import Trainer
from .versions import versions

CHECKPOINT = Path("checkpoint") / "state.npz"
CHECKPOINT_SECONDS = 60.0
ALPHA_MIN = Cutoffs().alpha  # a primitive whose peak is below this is never drawn


def prepare_folder(out: Path) -> None:
    """Make the run folder. Raises ``DataError`` if something else is in its place or it cannot be written."""
    if out.exists() and not out.is_dir():
        raise DataError(out, "is a file", "name a folder for the run")
    ours = any((out / name).exists() for name in ("config.json", "metrics.json"))
    if out.is_dir() and any(out.iterdir()) and not ours:
        raise DataError(out, "is a folder with other contents", "name a new folder, or an earlier run")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(out, error.strerror or str(error), "name a folder that can be written") from None


def train(
    config: TrainConfig,
    out: Path,
    progress: Callable[[dict], None] = lambda row: None,
    resume: bool = False,
    recipe: Recipe | None = None,
    start: dict[str, np.ndarray] | None = None,
    kind: type[Trainer] = Trainer,
) -> dict[str, Any]:
    """Train, or prune a model (``config.model``), evaluate and write the run folder; returns ``metrics.json``.

    ``progress`` is called as training starts and with every row of the history. With ``resume`` the run goes on
    from its last checkpoint (one a minute), with the same settings. The model leaves out primitives that can
    never be seen. A ``recipe`` takes the place of the preset's, a ``kind`` of trainer that of the ordinary one;
    ``start`` is a ``Trainer.state()`` to go on from.
    An earlier run in the same folder is replaced: its measurements go first, as they would be a lie beside
    the new settings; its model stays until the new one is complete. Raises ``DataError``.
    """
    out = Path(out)
    dataset = load_dataset(config.data, config.downscale)
    trainer = kind(config, dataset, recipe)
    if start:
        trainer.restore(start)
    prepare_folder(out)
    if resume:
        _resume(trainer, out)
    else:
        (out / CHECKPOINT).unlink(missing_ok=True)
        (out / "history.jsonl").unlink(missing_ok=True)
    _forget_results(out)
    write_json(out / "config.json", dataclasses.asdict(config))
    progress({"step": trainer.step_count, "n": trainer.optimizer.n})
    saved = time.monotonic()
    with open(out / "history.jsonl", "a", encoding="utf-8") as history:
        try:
            for row in run_to_end(trainer):
                history.write(json.dumps(row) + "\n")
                history.flush()
                progress(row)
                due = time.monotonic() - saved > CHECKPOINT_SECONDS or row["step"] == config.steps
                if due and "l1" in row:
                    save_checkpoint(out / CHECKPOINT, trainer.state())
                    saved = time.monotonic()
        except FloatingPointError as error:
            raise DataError(config.data, str(error), "check its cameras and images for outliers") from error
    splats = trainer.optimizer.to_splats()
    splats = splats.select(splats.opacities >= ALPHA_MIN)
    write_ply(out / "point_cloud.ply", splats)
    metrics = _measure(trainer, dataset, out) | {
        "n": splats.n_splats,
        "n_dog": splats.n_dog,
        "bytes": (out / "point_cloud.ply").stat().st_size,
        "train_seconds": trainer.seconds,
        "peak_memory_mb": peak_memory_mb(),
        "steps": config.steps,
        "seed": config.seed,
        "variant": mi.variant(),
        "versions": versions(),
    }
    write_json(out / "metrics.json", metrics)
    write_report(out)
    return metrics


def _resume(trainer: Trainer, out: Path) -> None:
    """Put the trainer where the checkpoint of ``out`` is, and cut the history there."""
    before = json.loads((out / "config.json").read_text(encoding="utf-8")) if (out / "config.json").exists() else {}
    now = dataclasses.asdict(trainer.config)
    changed = [name for name in now if name in before and before[name] != now[name]]
    if changed:
        name = changed[0]
        problem = f"{name} was {before[name]} and is {now[name]} now"
        raise DataError(out, problem, "resume with the settings of the run, or train without --resume")
    path = out / CHECKPOINT
    try:
        trainer.restore(load_checkpoint(path))
    except (ValueError, KeyError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(path, f"does not fit this run ({error})", "train without --resume") from None
    rows = (out / "history.jsonl").read_text(encoding="utf-8").splitlines() if (out / "history.jsonl").exists() else []
    kept = [line for line in rows if line.endswith("}") and json.loads(line)["step"] <= trainer.step_count]
    with replacing(out / "history.jsonl") as part:
        part.write_text("".join(line + "\n" for line in kept), encoding="utf-8")


def _forget_results(out: Path) -> None:
    """Remove what an earlier run in this folder measured and drew, and the name that it had in an ablation."""
    pictures = [path for suffix in (".png", ".exr", ".json") for path in (out / "test").glob(f"*{suffix}")]
    for path in (*(out / name for name in ("metrics.json", "report.html", RECIPE, RENDER_MS)), *pictures):
        path.unlink(missing_ok=True)


def _measure(trainer: Trainer, dataset: Dataset, out: Path) -> dict[str, Any]:
    views = evaluate_views(
        lambda view: trainer.picture(view, depth=True), dataset.test, trainer.background, out / "test"
    )
    if trainer.optimizer.n_dog and views:
        how = trainer.options, trainer.background, trainer.config.near_clip
        write_mixture(trainer.optimizer.to_splats(), dataset.test, views, out / "test", *how)
    some = dataset.train[:: max(1, len(dataset.train) // 8)]
    return {
        "test": mean_metrics(views),
        "train": mean_metrics(evaluate_views(trainer.picture, some, trainer.background)),
        "views": views,
        "render_ms": render_milliseconds(trainer.picture, dataset.test or dataset.train),
    }


def peak_memory_mb() -> float:
    """Largest resident size of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
