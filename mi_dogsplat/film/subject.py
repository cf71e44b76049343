"""What is filmed: a model, and what is known of how it was photographed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets import load_largest
from ..datasets.dataset import counted_order
from ..datasets.world import read_world
from ..formats.model import Model
from ..formats.read import read_model
from ..render.framing import likely_up, near_clip_for
from ..render.picture import background_color
from ..render.picture_options import PictureOptions
from ..report.run_folder import MODEL, read_run
from ..scene.cameras import Camera
from ..scene.drawing import Drawing, DrawnAs, drawn_as
from ..scene.orientation import up_of_cameras, up_vector
from ..support.errors import DataError


@dataclass(frozen=True, eq=False)
class Subject:
    """The model, the cameras of its data in the order of their names (maybe none), and how it is drawn.

    ``missing`` says of a run that its data are not there, ``said_up`` what is up by the data themselves.
    """

    model: Model
    cameras: list[Camera]
    background: float
    drawn: DrawnAs
    missing: str = ""
    said_up: str | None = None

    @property
    def up(self) -> np.ndarray:
        """The vertical [3]: as the model's file or its data say, as its photographs were held, or a guess."""
        if said := self.model.drawing.up or self.said_up:
            return up_vector(said)
        if self.cameras:
            return up_of_cameras(np.stack([camera.c2w for camera in self.cameras]))
        return likely_up(self.model.splats)


def read_subject(model: Path, data: str | Path | None, options: PictureOptions) -> Subject:
    """A model file, or a run folder, which knows its data and how it was trained.

    Args:
        data: the data set; None: that of the run, if it is still there.
        options: how the model is drawn; what they do not say, the run or the file of the model does.

    Raises ``DataError``.
    """
    trained: dict[str, Any] = {}
    missing = ""
    if model.is_dir():
        run = read_run(model)
        missing = "" if data else run.data_missing
        trained, data = run.config, data or run.data
        model = model / MODEL
        if not model.is_file():
            raise DataError(model, "no such file", "give a run folder that is complete, or a model")
    read = read_model(model)
    dataset = load_largest(data)[0] if data else None
    views = sorted(dataset.views, key=lambda view: counted_order(view.name)) if dataset else []
    said_by_run = Drawing(trained.get("antialiased"), trained.get("near_clip"))
    drawn = drawn_as(options.drawing, said_by_run, read.drawing)
    if not views:
        drawn = replace(drawn, near_clip=near_clip_for(read.splats, drawn.near_clip, options.near_clip))
    background = background_color(options.or_trained(trained).background, dataset is not None and dataset.has_alpha)
    said_up = read_world(dataset.path).up if dataset else None
    return Subject(read, [view.camera for view in views], background, drawn, missing, said_up)
