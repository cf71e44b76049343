"""What is filmed: a model, and what is known of how it was photographed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.model import Model
from ..formats.read import read_model
from ..render.framing import drawn_without_data, likely_up
from ..render.picture import background_color
from ..render.picture_options import PictureOptions
from ..report.run_folder import MODEL, read_run
from ..scene.drawing import Drawing, DrawnAs, drawn_as
from ..scene.orientation import up_vector
from ..support.errors import DataError
from .data_cameras import DataCameras, data_cameras


@dataclass(frozen=True, eq=False)
class Subject:
    """The model, the cameras of its ``data``, and how it is drawn. ``missing`` says of a run that its data are not
    there."""

    model: Model
    data: DataCameras
    background: float
    drawn: DrawnAs
    missing: str = ""

    @property
    def up(self) -> np.ndarray:
        """The vertical [3]: as the model's file or its data say, as its photographs were held, or a guess."""
        if self.model.drawing.up:
            return up_vector(self.model.drawing.up)
        by_data = self.data.up
        return likely_up(self.model.splats) if by_data is None else by_data


def read_subject(model: Path, data: str | Path | None, options: PictureOptions, chosen: bool = False) -> Subject:
    """A model file, or a run folder, which knows its data and how it was trained.

    Args:
        data: the data set; None: that of the run, if it is still there.
        options: how the model is drawn; what they do not say, the run or the file of the model does.
        chosen: whether somebody says from where it is seen. Then a near clip that is said holds; else it is smaller
            where a model without data is small.

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
    cameras = data_cameras(data)
    said_by_run = Drawing(trained.get("antialiased"), trained.get("near_clip"))
    said = options.drawing, said_by_run.over(read.drawing)
    drawn = drawn_as(*said) if cameras.cameras else drawn_without_data(read.splats, *said, chosen=chosen)
    background = background_color(options.or_trained(trained).background, cameras.has_alpha)
    return Subject(read, cameras, background, drawn, missing)
