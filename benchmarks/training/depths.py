"""What depth maps are worth: ``python -m benchmarks depths -o DIR``.

A walk through a furnished room (``closed_room.py``) is rendered, with its depths. From these come the maps of a sensor
as phones have them: a sixteenth of the pixels, each with a noise of 1 %, each map off by 1 % as a whole, and a tenth of
their values missing. Models are trained

- ``without`` depth maps,
- ``sensor``: with those of the sensor, for each of the ``--weights``,
- ``true``: with the true ones.

All are measured on validation views: PSNR, and the relative error of the expected depth, its mean over all pixels and
the median. Writes ``depths.json`` and prints a table. Writes ``depths.png``, too: a view and its depths, of the room,
of the last preset without maps, and of it with those of the sensor.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.camera_paths import Shot, look_at
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.frame_cameras import intrinsics_of
from mi_dogsplat.datasets.point_ply import write_point_ply
from mi_dogsplat.datasets.traced_view import as_srgb, depth_of, first_surfaces, render_shot
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.cameras import OPENCV_FROM_OPENGL, Camera
from mi_dogsplat.support.files import write_json
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.images import known_depth

from ..poses.closed_room import closed_room

VIEWS, SIZE, FOCAL, SPP = 40, (320, 240), 230.0, 64
POINTS = 100  # of each view, off by a centimetre, as those of structure from motion
COARSER, NOISE, MISSING = 4, 0.01, 0.1  # of the sensor


def main(flags: Sequence[str]) -> None:
    parser = argparse.ArgumentParser("python -m benchmarks depths", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the room and the runs")
    parser.add_argument("--presets", nargs="+", default=["3dgs", "ours"], help="recipes")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0], help="of the trainings")
    parser.add_argument("--weights", nargs="+", type=float, default=[known_depth.WEIGHT], help="of the sensor's depths")
    parser.add_argument("--steps", type=int, default=1500, help="of a training")
    parser.add_argument("--views", type=int, default=VIEWS, help="of the walk")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba variant")
    args = parser.parse_args(flags)
    set_variant(args.variant)
    data = args.out / "room"
    if not (data / "transforms.json").exists():
        walk_through(data, args.views)
    sensor = f"{data}/sensor"
    contestants = [("without", None, known_depth.WEIGHT), *(("sensor", sensor, w) for w in args.weights)]
    contestants += [("true", f"{data}/depth", known_depth.WEIGHT)]
    views = load_dataset(data, split="validation").test
    rows = []
    for preset, seed in ((preset, seed) for preset in args.presets for seed in args.seeds):
        for name, depths, weight in contestants:
            out = args.out / f"{preset}_{seed}_{name}_{weight:g}"
            if not (out / "metrics.json").exists():
                kept = {"preset": preset, "seed": seed, "steps": args.steps, "max_primitives": 20_000, "depths": depths}
                config = TrainConfig(str(data), split="validation", **kept)
                with patch.object(known_depth, "WEIGHT", weight):
                    train(config, out, resume=(out / "config.json").exists())
            psnr = json.loads((out / "metrics.json").read_text())["test"]["psnr"]
            mean, median = depth_errors(read_model(out / "point_cloud.ply"), views, data)
            used = weight if name == "sensor" else None
            row = {"preset": preset, "seed": seed, "depths": name, "weight": used, "psnr": psnr}
            rows.append({**row, "mean": mean, "median": median})
            print(rows[-1], flush=True)
    write_json(args.out / "depths.json", rows)
    shown = {"without": known_depth.WEIGHT, "sensor": args.weights[0]}
    folders = [args.out / f"{args.presets[-1]}_{args.seeds[0]}_{name}_{weight:g}" for name, weight in shown.items()]
    write_png(args.out / "depths.png", side_by_side(data, views[1], folders))
    print("| preset | seed | depth maps | weight | PSNR, dB | depth error: mean | median |\n|" + "---|" * 7)
    for row in rows:
        weight = "" if row["weight"] is None else f"{row['weight']:g}"
        errors = f"{row['psnr']:.2f} | {row['mean']:.2%} | {row['median']:.2%}"
        print(f"| {row['preset']} | {row['seed']} | {row['depths']} | {weight} | {errors} |")


def depth_errors(model: Model, views: Sequence[View], data: Path) -> tuple[float, float]:
    """Mean and median of the relative errors of the expected depth, over all pixels of the views."""
    params, errors = upload(model.splats), []
    options = RasterOptions(sh_degree=model.splats.sh_degree, depth=True)
    for view in views:
        truth = np.load(data / "depth" / f"{view.name}.npy")
        errors.append(np.abs(render_picture(params, view.camera, options, 0.0).depth / truth - 1).ravel())
    return float(np.mean(errors)), float(np.median(errors))


def side_by_side(data: Path, view: View, runs: Sequence[Path]) -> np.ndarray:
    """[2 H, n W, 3] a view above its depths, white as far as the room goes: the truth, then the models of the runs."""
    truth = np.load(data / "depth" / f"{view.name}.npy")
    columns = [(view.image[..., :3], truth)]
    for run in runs:
        splats = read_model(run / "point_cloud.ply").splats
        drawn = render_picture(upload(splats), view.camera, RasterOptions(splats.sh_degree, depth=True), 0.0)
        columns.append((drawn.color, drawn.depth))
    grey = [np.repeat(np.clip(depth / truth.max(), 0, 1)[..., None], 3, axis=2) for _, depth in columns]
    return np.concatenate([np.concatenate(row, 1) for row in ([color for color, _ in columns], grey)])


def walk_through(out: Path, n: int) -> None:
    """Write a data set of ``n`` views of the room, with ``depth/`` and the ``sensor/``'s."""
    scene, rng, frames = closed_room(), np.random.default_rng(0), []
    for folder in ("images", "depth", "sensor"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    points, colors = [], []
    for k, camera in enumerate(cameras(n, rng)):
        name, shot = f"{k:03d}", Shot(f"{k:03d}", camera, 0.01, 100.0)
        image = as_srgb(render_shot(mi, scene, shot, SPP, k, alpha=False))
        places, found = first_surfaces(mi, scene, shot, False)
        depth = depth_of(shot, places, found)
        write_png(out / "images" / f"{name}.png", image)
        np.save(out / "depth" / f"{name}.npy", depth)
        np.save(out / "sensor" / f"{name}.npy", sensed(depth, rng))
        pose = (camera.c2w @ OPENCV_FROM_OPENGL).tolist()
        frames.append({"file_path": f"images/{name}.png", "transform_matrix": pose, **intrinsics_of(camera)})
        some = rng.choice(np.flatnonzero(found), POINTS)
        points.append(places.reshape(-1, 3)[some] + rng.normal(0, 0.01, (POINTS, 3)))
        colors.append(np.clip(image, 0, 1).reshape(-1, 3)[some])
    write_point_ply(out / "points.ply", np.concatenate(points).astype(np.float32), np.concatenate(colors))
    write_json(out / "transforms.json", {"ply_file_path": "points.ply", "frames": frames})


def cameras(n: int, rng: np.random.Generator) -> list[Camera]:
    """Once around in the middle of the room, with a look at what is ahead to the left, up and down."""
    width, height = SIZE
    found = []
    for turn in 2 * np.pi * np.arange(n) / n:
        place = np.array([1.2 * np.cos(turn), 0.9 * np.sin(turn), 1.4 + 0.3 * np.sin(3 * turn)])
        place += rng.normal(0, 0.05, 3)
        seen = np.array([3 * np.cos(turn + 0.9), 2.5 * np.sin(turn + 0.9), 1.1 + 0.6 * np.sin(5 * turn)])
        found.append(Camera(look_at(place, seen, "z"), FOCAL, FOCAL, width / 2, height / 2, width, height))
    return found


def sensed(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What the sensor says of depths [H, W]: float32 of fewer pixels, 0 where it says nothing."""
    coarse = depth[COARSER // 2 :: COARSER, COARSER // 2 :: COARSER]
    noisy = coarse * (1 + rng.normal(0, NOISE, coarse.shape) + rng.normal(0, NOISE))
    return np.where(rng.random(coarse.shape) < MISSING, 0, noisy).astype(np.float32)
