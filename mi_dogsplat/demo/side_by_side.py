"""A scene, path-traced, beside a model of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..render.panels import labelled
from ..support.pictures import write_png
from ..support.srgb import linear_to_srgb

PICTURE_SIZE = (640, 480)  # of each half, in pixels
PICTURE_SPP = 256
LETTERS = 24  # their size


def write_truth_and_model(scene_file: Path, model: Path, out: Path, text: str) -> None:
    """A PNG with two pictures from the first sensor of a scene: path-traced, and a model of it, both over white.

    Neither was a training view, and both are larger. ``text`` says what the model is.
    """
    truth = mi.load_file(str(scene_file))
    seen: Any = mi.traverse(truth.sensors()[0])
    width, height = PICTURE_SIZE
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    pose: Any = np.array(seen["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    sensor = {"type": "perspective", "fov": float(np.array(seen["x_fov"]).item()), "fov_axis": "x", "film": film}
    view = mi.load_dict({**sensor, "to_world": mi.ScalarTransform4f(pose)})
    splats = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "dogsplat"},
            "model": {"type": "dog", "filename": str(model)},
            "sky": {"type": "constant", "radiance": 1.0},
        }
    )
    traced = np.array(mi.render(truth, sensor=view, spp=PICTURE_SPP))  # [H, W, 4] premultiplied
    splatted = np.array(mi.render(splats, sensor=view))[..., :3]  # [H, W, 3]
    over_white = traced[..., :3] + 1 - traced[..., 3:]
    halves = {"path-traced truth": linear_to_srgb(over_white), text: linear_to_srgb(splatted)}
    write_png(out, np.concatenate([labelled(half, name, LETTERS) for name, half in halves.items()], axis=1))
