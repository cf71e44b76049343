"""The end of a run: its model, what it measures on the photographs, and the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi

from ..datasets import Dataset
from ..measure.evaluate import Measure, evaluate_views, mean_metrics, render_milliseconds
from ..render.picture import seen_as
from ..report.run_folder import METRICS
from ..report.write import write_report
from ..scene.appearance import APPEARANCE
from ..scene.drawing import drawn_as
from ..support.files import write_json
from ..support.memory import peak_memory_mb
from ..support.versions import versions
from ..training.optimizer.faded import not_faded
from ..training.train import Trainer
from .history import counted_rows
from .masked import write_masked
from .misfits import write_misfits
from .mixture import write_mixture
from .model_files import write_model_files
from .refined_poses import moved_views, write_poses

TRAINING_VIEWS = 8  # that are measured, or a few more


def finish(trainer: Trainer, dataset: Dataset, out: Path) -> dict[str, Any]:
    """Write the model, measure it, and write the report; returns what ``metrics.json`` holds.

    That is the last file: a run that has it is complete, however it was ended. Raises ``DataError`` if every primitive
    has faded.
    """
    config = trainer.config
    splats = trainer.model()
    splats = splats.select(not_faded(splats.opacities))
    sizes = write_model_files(out, splats, config, trainer.drawing)
    photographs, of_views = trainer.photographs, {}
    if config.refine_poses:
        of_views["poses"] = moved_views(trainer)
    if masks := photographs.mask_folder:
        of_views["masked"] = write_masked(out, photographs.originals, masks, trainer.background)
    if trainer.depths:
        of_views["depths"] = trainer.depths.maps.summary()
    metrics = measured(trainer, dataset, out) | {
        **of_views,
        "n": splats.n_splats,
        "n_dog": splats.n_dog,
        **{name: getattr(splats, name) for name in counted_rows(trainer)},
        **sizes,
        "train_seconds": trainer.seconds,
        "peak_memory_mb": peak_memory_mb(),
        "steps": config.steps,
        "seed": config.seed,
        "variant": mi.variant(),
        "versions": versions(),
    }
    if config.refine_poses:
        write_poses(trainer, out)
    write_misfits(
        out, lambda view: seen_as(trainer.picture(view), view), photographs.originals, config.steps,
        trainer.background, masks, config.appearance,
    )  # fmt: skip
    write_report(out, metrics)
    write_json(out / METRICS, metrics)
    return metrics


def measured(trainer: Trainer, dataset: Dataset, out: Path) -> dict[str, Any]:
    """What pictures of the run tell, by the names of ``metrics.json``; those of the test views are written."""
    appearance, extent = trainer.appearance(), trainer.extent if trainer.config.refine_poses else None
    if appearance:
        appearance.write(out / APPEARANCE)
    measure = Measure(trainer.photographs.mask_folder, align_extent=extent, appearance=appearance)
    views = evaluate_views(
        lambda view: trainer.picture(view, depth=True), dataset.test, trainer.background, out / "test", measure
    )
    if trainer.optimizer.n_dog and views:
        write_mixture(
            trainer.model(), dataset.test, views, out / "test", trainer.options, trainer.background,
            drawn=drawn_as(trainer.drawing), masks=measure.masks,
        )  # fmt: skip
    trained = trainer.photographs.originals
    some = trained[:: max(1, len(trained) // TRAINING_VIEWS)]
    as_they_are = replace(measure, align_extent=None)
    return {
        "test": mean_metrics(views),
        "train": mean_metrics(evaluate_views(trainer.picture, some, trainer.background, measure=as_they_are)),
        "views": views,
        "render_ms": render_milliseconds(trainer.picture, dataset.test or trained),
    }
