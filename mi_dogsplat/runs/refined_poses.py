"""The poses that a run with ``--refine-poses`` ends with: a data set in its folder, and how far the cameras moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..datasets.refined import write_refined
from ..datasets.world import World, write_world
from ..report.run_folder import REFINED
from ..scene.cameras import Camera
from ..training.train import Trainer


def moved_views(trainer: Trainer) -> dict[str, dict[str, float]]:
    """``poses`` of ``metrics.json``: ``motion`` of the training views, by their names."""
    views = zip(trainer.dataset.train, trainer.photographs.originals, strict=True)
    return {view.name: motion(given.camera, view.camera, trainer.extent) for given, view in views}


def write_poses(trainer: Trainer, out: Path) -> None:
    """Write ``refined/``, with what is up in it and how long its unit is. Raises ``DataError``."""
    config, w2cs = trainer.config, {view.name: view.camera.w2c for view in trainer.photographs.originals}
    write_refined(out / REFINED, trainer.dataset, Path(config.data), w2cs)
    write_world(out / REFINED, World(config.up, config.unit))  # no motion of all views is learned


def motion(given: Camera, camera: Camera, extent: float) -> dict[str, float]:
    """From one pose to another: ``shift`` in units of ``extent``, that of the cameras, ``turn`` in degrees."""
    sine = np.linalg.norm(given.w2c[:3, :3] - camera.w2c[:3, :3]) / np.sqrt(8)  # of half the angle
    shift = float(np.linalg.norm(camera.position - given.position)) / extent
    return {"shift": shift, "turn": float(np.degrees(2 * np.arcsin(min(1.0, sine))))}
