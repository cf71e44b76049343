"""``make demo``: the main job on a scene that ships. Path-traces a small training set, trains a compact model on it,
and writes a report and a picture of the truth beside the model.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from tqdm import tqdm

from ..cli.commands import print_metrics
from ..datasets.capture import capture
from ..datasets.capture_config import CaptureConfig
from ..runs.run import train
from ..support.errors import DataError
from ..support.pictures import write_png
from ..support.srgb import linear_to_srgb
from ..support.variants import set_variant
from ..training.config import TrainConfig

SCENE = Path(__file__).parents[2] / "scenes" / "demo_truth.xml"
PICTURE_SIZE = (640, 480)  # of each half, in pixels
PICTURE_SPP = 256


def main(argv: list[str] | None = None) -> int:
    """Entry point of ``make demo``; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m mi_dogsplat.demo", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("demo"), help="folder to write")
    parser.add_argument("--steps", type=int, default=3000, help="training steps")
    parser.add_argument("--target", type=int, default=10_000, help="primitives of the compact model")
    parser.add_argument("--views", type=int, default=48, help="training views to render")
    parser.add_argument("--size", type=int, default=256, help="their width and height in pixels")
    parser.add_argument("--picture", type=Path, help="where truth and model are shown (default: OUT/demo.png)")
    args = parser.parse_args(argv)
    try:
        set_variant("llvm_ad_rgb")
        _demo(args)
    except DataError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 2
    return 0


def _demo(args: argparse.Namespace) -> None:
    data, run, picture = args.out / "data", args.out / "run", args.picture or args.out / "demo.png"
    size = (args.size, args.size)
    orbit = CaptureConfig(
        views=args.views, size=size, elevations=(12.0, 65.0), zoom=1.35, spp=121, alpha=True, points=8000
    )
    print(f"1/3  {SCENE.name}: path tracing {args.views} training and {args.views // 6} test views")
    with tqdm(unit="view") as bar:

        def show_views(done: int, n: int, framing: str) -> None:
            bar.total = n
            bar.update(done - bar.n)

        capture(SCENE, data, orbit, show_views)
    print(f"2/3  training {args.steps} steps, pruning to {args.target:,} primitives")
    config = TrainConfig(str(data), steps=args.steps, max_primitives=4 * args.target, target=args.target)
    with tqdm(total=args.steps, unit="step") as bar:

        def show_steps(row: dict) -> None:
            bar.update(row["step"] - bar.n)
            bar.set_postfix(n=row["n"])

        metrics = train(config, run, show_steps)
    print_metrics(metrics["test"])
    print(f"{metrics['n']:,} primitives, {metrics['n_dog']:,} of them DoG, {metrics['bytes'] / 1e6:.1f} MB")
    print("3/3  the path-traced truth beside the model")
    write_truth_and_model(SCENE, run / "point_cloud.ply", picture)
    print(f"look at {picture}, open {run / 'report.html'}")


def write_truth_and_model(scene_file: Path, model: Path, out: Path) -> None:
    """A PNG with two pictures from the first sensor of a scene: path-traced, and a model of it, both over white.

    Neither was a training view, and both are larger.
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
    halves = [linear_to_srgb(traced[..., :3] + 1 - traced[..., 3:]), linear_to_srgb(splatted)]
    write_png(out, np.concatenate(halves, axis=1))


if __name__ == "__main__":
    sys.exit(main())
