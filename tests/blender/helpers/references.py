"""What the package has drawn for the checks: models, their cameras, and pictures of both."""

import json
import os
from pathlib import Path

import numpy as np
from mathutils import Matrix

from blender_addon.cameras.camera import Camera
from blender_addon.cameras.objects import build_camera, look_through

REFERENCES = Path(os.environ["DOGSPLAT_REFERENCES"])


def reference(name: str = "dog") -> dict[str, np.ndarray]:
    """The arrays of a reference: a picture, or what else ``tests/project/test_blender.py`` has written."""
    with np.load(REFERENCES / f"{name}.npz") as file:
        return dict(file)


def place_camera(scene, name: str) -> None:
    """Look through the camera of a reference."""
    values = json.loads((REFERENCES / f"{name}.json").read_text())
    camera = Camera(name, np.array(values.pop("w2c")), **values)
    look_through(scene, build_camera(scene.collection, camera, Matrix.Identity(4), "", False))
