"""Requests for pictures as another program writes them, and their answers."""

from typing import Any

import numpy as np
from mi_dogsplat.requests.answer import Answerer
from mi_dogsplat.requests.request import read_request
from mi_dogsplat.scene.cameras import Camera


def matrix(values: Any) -> dict[str, Any]:
    """A transform, as a description of a scene has it."""
    return {"matrix": np.asarray(values).tolist()}


def camera_json(camera: Camera) -> dict[str, Any]:
    numbers = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    return {"w2c": camera.w2c.tolist(), **numbers}


def answered(request: dict) -> dict:
    """The picture, by the names of its passes."""
    (*_, (share, picture)) = Answerer().answer(read_request(request))
    assert share == 1 and picture is not None
    return picture
