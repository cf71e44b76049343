"""What a data set knows of how something was photographed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..datasets import load_largest
from ..datasets.dataset import counted_order
from ..datasets.world import read_world
from ..scene.cameras import Camera
from ..scene.orientation import up_of_cameras, up_vector
from .rigs import one_of_each_moment


@dataclass(frozen=True, eq=False)
class DataCameras:
    """The cameras of a data set in the order of their names, maybe none; what it says is up, and whether its images
    have alpha; the moment of a rig of each camera, which is in ``moments`` unless it has none."""

    cameras: list[Camera] = field(default_factory=list)
    said_up: str | None = None
    has_alpha: bool = False
    moments: list[int | None] | None = None

    @property
    def followed(self) -> list[Camera]:
        """Those that a path leads along: one of each moment."""
        return self.cameras if self.moments is None else one_of_each_moment(self.cameras, self.moments)

    @property
    def up(self) -> np.ndarray | None:
        """The vertical [3]: as the data say, or as photographs were held; None: there are none."""
        if self.said_up:
            return up_vector(self.said_up)
        return up_of_cameras(np.stack([camera.c2w for camera in self.cameras])) if self.cameras else None


def data_cameras(data: str | Path | None) -> DataCameras:
    """Those of a data set; of None there are none. Raises ``DataError``."""
    if not data:
        return DataCameras()
    dataset = load_largest(data, spp=1)[0]  # no picture of a scene is looked at
    views = sorted(dataset.views, key=lambda view: counted_order(view.name))
    moments = [dataset.rig_frames.get(view.name) for view in views]
    return DataCameras([view.camera for view in views], read_world(dataset.path).up, dataset.has_alpha, moments)
