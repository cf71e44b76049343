"""What depth maps are worth: ``python -m benchmarks depths -o DIR``.

A walk through a furnished room (``depth_room.py``) is rendered, with its depths. From these come the maps of a sensor
as phones have them: a sixteenth of the pixels, each with a noise of 1 %, each map off by 1 % as a whole, and a tenth of
their values missing. Models are trained

- ``without`` depth maps,
- ``sensor``: with those of the sensor, for each of the ``--weights``,
- ``true``: with the true ones,
- ``inverse``: with the true ones as networks would tell them, relative inverse depth of 16 bits on another line in each
  view, which is fitted to the sparse points.

With ``--no-points`` the data have no sparse points: ``without_no_points`` starts at random places, and
``sensor_no_points`` at those of the maps.

All are measured on validation views: PSNR, and the relative error of the expected depth, its mean over all pixels and
the median. Their meshes, too, as ``dogsplat mesh --data`` makes them, with each ``--depth``: how far from the walls,
pictures and furniture their vertices are, in centimetres, the median and 95 %.

Writes ``depths.json`` and prints a table. Writes ``depths.png``, too: a view and its depths, of the room, of the last
preset without maps, and of it with those of the sensor.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.meshing.mesh_config import DEPTHS, MeshConfig
from mi_dogsplat.meshing.surface import surface_of
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.drawing import drawn_as
from mi_dogsplat.support.files import write_json
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.images import known_depth

from ..poses.closed_room import closed_room, distances, surfaces
from .depth_room import walk_through

VIEWS = 40


def main(flags: Sequence[str]) -> None:
    parser = argparse.ArgumentParser("python -m benchmarks depths", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the room and the runs")
    parser.add_argument("--presets", nargs="+", default=["3dgs", "ours"], help="recipes")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0], help="of the trainings")
    parser.add_argument("--weights", nargs="+", type=float, default=[known_depth.WEIGHT], help="of the sensor's depths")
    parser.add_argument("--steps", type=int, default=1500, help="of a training")
    parser.add_argument("--views", type=int, default=VIEWS, help="of the walk")
    parser.add_argument("--no-points", action="store_true", help="without and sensor alone, of data without points")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="Mitsuba variant")
    args = parser.parse_args(flags)
    set_variant(args.variant)
    data, observed = args.out / "room", args.out / "observed"
    if not ((data / "transforms.json").exists() and observed.exists()):  # a room of before has no second one
        walk_through(data, observed, args.views)
    usual = known_depth.WEIGHT
    contestants = [("without", data, None, usual), *(("sensor", data, f"{data}/sensor", w) for w in args.weights)]
    contestants += [("true", data, f"{data}/depth", usual), ("inverse", observed, f"{observed}/inverse", usual)]
    if args.no_points:  # the first is a start at random places, the second one at those of the maps
        pointless = data / "pointless.json"
        told = json.loads((data / "transforms.json").read_text())
        write_json(pointless, {"frames": told["frames"]})
        contestants = [(f"{name}_no_points", pointless, *rest) for name, _, *rest in contestants[:2]]
    views = load_dataset(data, split="validation").test
    fused = [view.camera for view in load_dataset(data, on_disk=True).train]
    room, rows = surfaces(closed_room()), []
    for preset, seed in ((preset, seed) for preset in args.presets for seed in args.seeds):
        for name, photographs, depths, weight in contestants:
            out = args.out / f"{preset}_{seed}_{name}_{weight:g}"
            if not (out / "metrics.json").exists():
                kept = {"preset": preset, "seed": seed, "steps": args.steps, "max_primitives": 20_000, "depths": depths}
                config = TrainConfig(str(photographs), split="validation", **kept)
                with patch.object(known_depth, "WEIGHT", weight):
                    train(config, out, resume=(out / "config.json").exists())
            psnr = json.loads((out / "metrics.json").read_text())["test"]["psnr"]
            model = read_model(out / "point_cloud.ply")
            mean, median = depth_errors(model, views, data)
            of_mesh = {}
            for depth in DEPTHS:
                mesh, _ = surface_of(model.splats, fused, drawn_as(model.drawing), MeshConfig(depth=depth))
                off = 100 * distances(mesh.vertices, room)
                of_mesh[f"mesh_{depth}"] = [float(value) for value in np.quantile(off, (0.5, 0.95))]
            used = weight if name == "sensor" else None
            row = {"preset": preset, "seed": seed, "depths": name, "weight": used, "psnr": psnr}
            rows.append({**row, "mean": mean, "median": median, **of_mesh})
            print(rows[-1], flush=True)
    write_json(args.out / "depths.json", rows)
    run = f"{args.presets[-1]}_{args.seeds[0]}"
    folders = [args.out / f"{run}_{name}_{weight:g}" for name, _, _, weight in contestants[:2]]
    write_png(args.out / "depths.png", side_by_side(data, views[1], folders))
    columns = [f"mesh, {depth} depth: median, cm | 95 %" for depth in DEPTHS]
    print(f"| preset | seed | depth maps | weight | PSNR, dB | depth error: mean | median | {' | '.join(columns)} |")
    print("|" + "---|" * (7 + 2 * len(DEPTHS)))
    for row in rows:
        weight = "" if row["weight"] is None else f"{row['weight']:g}"
        errors = f"{row['psnr']:.2f} | {row['mean']:.2%} | {row['median']:.2%}"
        errors += "".join(f" | {value:.2f}" for depth in DEPTHS for value in row[f"mesh_{depth}"])
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
