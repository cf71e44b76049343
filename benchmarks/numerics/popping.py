"""How much of a change of view is popping: primitives that swap places in the order of depth, all pixels at once.

Primitives are blended in the order of their centres' depth along the optical axis. When the camera moves by a little,
two overlapping primitives may swap: the picture jumps, however small the move. So a change of view is taken apart,

    I(moved) - I = [I(moved, order of before) - I] + [I(moved) - I(moved, order of before)]
                    smooth part                       popping

with all else equal: same projection, same cutoffs, only the key that primitives are sorted by is that of before.
Beside it the same for a sort by the distance from the camera. A camera that turns about its own centre leaves
distances as they are, and along each ray the order of whatever is sorted per pixel: there both pop by exactly nothing.

Moves: ``turn`` about the camera's own vertical, ``orbit`` about a point in front of it, at the median depth.

    python -m benchmarks popping [MODEL [DATA]] [--downscale K] [--views N]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks, Grid
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import device_array, upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.view import arrange
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

STILL_LIFE = Path(__file__).parents[2] / "scenes" / "still_life.ply"
ANGLES = (0.01, 0.1, 1.0)  # degrees
VISIBLE = 1 / 255  # a step of an 8-bit picture
KEYS = ("depth", "distance")


@dataclass(frozen=True)
class Sorted:
    """A picture [H, W, 3] over black, and what its primitives can be sorted by: [N] by the names of ``KEYS``."""

    image: np.ndarray
    keys: dict[str, np.ndarray]


def picture(params: dict[str, Any], camera: Camera, degree: int, key: str = "depth", order: Any = None) -> Sorted:
    """A view whose primitives are drawn in the order of a key, or of ``order`` [N], its values elsewhere."""
    options, at = RasterOptions(sh_degree=degree), DeviceCamera.upload(camera)
    projection = project(params, at, sh_degree=degree)
    offset = params["means"].numpy().reshape(-1, 3).astype(np.float64) - camera.position
    keys = {"depth": projection.depth.numpy().copy(), "distance": np.linalg.norm(offset, axis=1).astype(np.float32)}
    if order is not None or key != "depth":
        projection = replace(projection, depth=device_array(keys[key] if order is None else order))
    grid = Grid.of(camera.width, camera.height, Blocks.of_backend())
    blended = composite(arrange(projection, projection.colors, grid, options))
    image = np.stack([plane.numpy().reshape(camera.height, camera.width) for plane in blended.features], -1)
    return Sorted(image.astype(np.float64), keys)


def moved(camera: Camera, kind: str, degrees: float, depth: float) -> Camera:
    """The camera after a ``turn`` about its own vertical, or an ``orbit`` about what is ``depth`` before it."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    motion, back = np.eye(4), np.eye(4)
    motion[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    if kind == "orbit":
        back[2, 3] = depth
        motion = back @ motion @ np.linalg.inv(back)
    return replace(camera, w2c=motion @ camera.w2c)


def measure(splats: Splats, cameras: list[Camera], kind: str, degrees: float, key: str) -> dict[str, float]:
    """Means over the views, and the largest of all: changes of a pixel's channel, of 1.

    ``smooth``, ``smooth_largest``, ``popping``, ``popping_largest``; ``visible``: share of the pixels in which a
    channel pops by a step of 8 bits or more.
    """
    params, rows = upload(splats), []
    for camera in cameras:
        before = picture(params, camera, splats.sh_degree, key)
        depths = before.keys["depth"]
        to = moved(camera, kind, degrees, float(np.median(depths[depths > 0])))
        held = picture(params, to, splats.sh_degree, order=before.keys[key])
        after = picture(params, to, splats.sh_degree, key)
        smooth, popping = np.abs(held.image - before.image), np.abs(after.image - held.image)
        visible = np.mean(popping.max(-1) >= VISIBLE)
        rows.append((smooth.mean(), smooth.max(), popping.mean(), popping.max(), visible))
    mean, largest = np.mean(rows, 0), np.max(rows, 0)
    return {
        "smooth": mean[0], "smooth_largest": largest[1], "popping": mean[2], "popping_largest": largest[3],
        "visible": mean[4],
    }  # fmt: skip


def main(flags: list[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks popping", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", nargs="?", type=Path, default=STILL_LIFE, help="(default: scenes/still_life.ply)")
    parser.add_argument("data", nargs="?", help="whose views it is seen from (default: from around the model)")
    parser.add_argument("--downscale", type=int, default=1, help="of the views (default: 1)")
    parser.add_argument("--views", type=int, default=8, help="how many of them (default: 8)")
    args = parser.parse_args(flags)
    set_variant("llvm_ad_rgb")
    splats = read_ply(args.model)
    if args.data:
        dataset = load_dataset(args.data, args.downscale)
        cameras = [view.camera for view in dataset.views][:: max(1, len(dataset.views) // args.views)][: args.views]
    else:
        first = automatic_camera(splats).resized(400, 300)
        depth = float(np.median((splats.means @ first.w2c[2, :3]) + first.w2c[2, 3]))
        cameras = [moved(first, "orbit", 360 * k / args.views, depth) for k in range(args.views)]
    print(f"{splats.n_splats} primitives, {len(cameras)} views of {cameras[0].width} x {cameras[0].height}")
    print("move   degrees  sorted by   smooth: mean  largest    popping: mean  largest   pixels that pop visibly")
    for kind in ("turn", "orbit"):
        for degrees in ANGLES:
            for key in KEYS:
                m = measure(splats, cameras, kind, degrees, key)
                smooth = f"{m['smooth']:13.1e} {m['smooth_largest']:8.3f}"
                popping = f"{m['popping']:14.1e} {m['popping_largest']:8.3f}"
                print(f"{kind:6s} {degrees:7g}  {key:9s} {smooth} {popping} {m['visible']:14.3%}")
