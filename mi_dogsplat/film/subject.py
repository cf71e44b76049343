"""What is filmed: a model, and what is known of how it was photographed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..datasets import load_dataset
from ..render.framing import NEAR_SHARE, robust_sphere
from ..render.picture import background_color
from ..render.picture_options import PictureOptions
from ..report.run_folder import read_run
from ..scene.cameras import Camera
from ..scene.ply import read_ply
from ..scene.splats import Splats
from ..support.errors import DataError

MODEL = "point_cloud.ply"  # of a run folder


@dataclass(frozen=True, eq=False)
class Subject:
    """The model, the cameras of its data in the order of their names (maybe none), and how it is drawn."""

    splats: Splats
    cameras: list[Camera]
    background: float
    near_clip: float
    antialiased: bool


def read_subject(model: Path, data: str | Path | None, options: PictureOptions) -> Subject:
    """A model file, or a run folder, which knows its data and how it was trained.

    Args:
        data: the data set; None: that of the run, if it is still there.
        options: how the model is drawn; what a run was trained with comes first.

    Raises ``DataError``.
    """
    trained: dict[str, Any] = {}
    if model.is_dir():
        trained = read_run(model).config
        model = model / MODEL
        if not model.is_file():
            raise DataError(model, "no such file", "give a run folder that is complete, or a model")
        own = trained.get("data")
        data = data or (own if own and Path(own).exists() else None)
    splats = read_ply(model)
    dataset = load_dataset(data, on_disk=True) if data else None
    views = sorted(dataset.views, key=lambda view: view.name) if dataset else []
    chosen = {name: trained.get(name, getattr(options, name)) for name in ("background", "near_clip", "antialiased")}
    near_clip = chosen["near_clip"]
    if not views:
        near_clip = min(near_clip, NEAR_SHARE * robust_sphere(splats)[1])
    background = background_color(chosen["background"], dataset is not None and dataset.has_alpha)
    return Subject(splats, [view.camera for view in views], background, near_clip, chosen["antialiased"])
