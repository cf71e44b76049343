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


@dataclass(frozen=True, eq=False)
class DataCameras:
    """The cameras of a data set in the order of their names, maybe none; what it says is up, and whether its images
    have alpha."""

    cameras: list[Camera] = field(default_factory=list)
    said_up: str | None = None
    has_alpha: bool = False

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
    dataset = load_largest(data)[0]
    views = sorted(dataset.views, key=lambda view: counted_order(view.name))
    return DataCameras([view.camera for view in views], read_world(dataset.path).up, dataset.has_alpha)
