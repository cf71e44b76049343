"""Refine a camera: find from where a picture was taken, by gradient descent through ``mi.render``.

    python scenes/refine_pose.py

The picture is the still life from its own camera. The search starts from a camera that is turned by some degrees and
stands beside it, and follows the derivative of the image with respect to the sensor's ``to_world``. It compares small
pictures first: coarse ones tell the way from farther off. The camera turns about a point in the middle of the model:
turned about itself it would move the picture as a shift does, and descent is slow where two variables do the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mi_dogsplat  # noqa: F401  first, so that it can choose the LLVM

# isort: split
import drjit as dr
import mitsuba as mi
import numpy as np

SCENE = Path(__file__).with_name("still_life.xml")
WIDTHS = (20, 40, 80, 160)  # of the pictures, in pixels
STEPS = 60  # on each
PIVOT = 5.7  # units in front of the camera
START = (-0.3, 0.25, 0.4, 3.0, -4.0, 5.0)  # units left, up and forward; degrees about these axes
DEGREE = 0.02  # a rotation by a degree is as long a step of the search as a shift by this many units


def motion(p: Any) -> Any:
    """Transform by shifts along and rotations about three axes."""
    move: Any = mi.Transform4f()
    turned = move.translate(mi.Point3f(p[0], p[1], p[2] + PIVOT)).rotate([1, 0, 0], p[3] / DEGREE)
    return turned.rotate([0, 1, 0], p[4] / DEGREE).rotate([0, 0, 1], p[5] / DEGREE).translate([0, 0, -PIVOT])


def distances(a: Any, b: Any) -> tuple[float, float]:
    """Between two poses: in world units, and in degrees."""
    a, b = (np.array(pose.matrix, dtype=np.float64).reshape(4, 4) for pose in (a, b))
    turn = a[:3, :3].T @ b[:3, :3]
    sine = 0.5 * np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])), float(np.degrees(np.arctan2(sine, 0.5 * (np.trace(turn) - 1))))


def refine(scene: mi.Scene, start: Any = START, widths=WIDTHS, steps: int = STEPS) -> list[tuple[float, float]]:
    """Distances of the pose from the true one, which is that of the scene: at the start, and after each picture."""
    params: Any = mi.traverse(scene)
    key = next(name for name in params.keys() if name.endswith("to_world") and name.startswith(scene.sensors()[0].id()))
    size_key = key.replace("to_world", "film.size")
    true = mi.Transform4f(params[key].matrix)
    optimizer: Any = mi.ad.Adam(lr=0.02)
    optimizer["p"] = mi.Float([*start[:3], *(DEGREE * np.array(start[3:]))])

    def pose() -> Any:
        return true @ motion([dr.gather(mi.Float, optimizer["p"], k) for k in range(6)])

    history = [distances(pose(), true)]
    width, height = params[size_key]
    for pixels in widths:
        params[size_key] = pixels, round(pixels * height / width)
        params[key] = true
        params.update()
        target = mi.render(scene)
        optimizer.reset("p")
        for step in range(steps):
            optimizer.set_learning_rate(0.5 / pixels * (1 - step / steps))
            params[key] = pose()
            params.update()
            dr.backward(dr.mean(dr.square(mi.render(scene, params) - target), axis=None))
            optimizer.step()
        history.append(distances(pose(), true))
    params[key] = dr.detach(pose())
    params.update()
    return history


if __name__ == "__main__":
    mi.set_variant("llvm_ad_rgb")
    still_life: Any = mi.load_file(str(SCENE))
    names = ["start", *(f"{width} px" for width in WIDTHS)]
    for name, (units, degrees) in zip(names, refine(still_life), strict=True):
        print(f"{name:>8}: {units:9.6f} units, {degrees:8.5f} degrees off")
