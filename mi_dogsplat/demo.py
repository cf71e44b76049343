"""``make demo``: the main job on a scene that ships. Renders a small training set with Mitsuba's path tracer, trains
a model on it, and writes pictures and a report.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mitsuba as mi
from tqdm import tqdm

from .cli import print_metrics
from .config import TrainConfig
from .datasets.capture import capture
from .run import train

SCENE = Path(__file__).parents[1] / "scenes" / "demo_truth.xml"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m mi_dogsplat.demo", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("demo"), help="folder to write")
    parser.add_argument("--steps", type=int, default=3000, help="training steps")
    parser.add_argument("--views", type=int, default=48, help="training views to render")
    parser.add_argument("--size", type=int, default=256, help="their width and height in pixels")
    args = parser.parse_args()

    mi.set_variant("llvm_ad_rgb")
    data = args.out / "data"
    if not (data / "transforms_train.json").exists():
        print(f"1/2  {SCENE.name}: path tracing {args.views} training and {args.views // 6} test views")
        n_test = args.views // 6
        size = {"width": args.size, "height": args.size}
        capture(SCENE, data, n_views=args.views, n_test=n_test, **size, zoom=1.35, alpha=True)
    print(f"2/2  training {args.steps} steps")
    config = TrainConfig(str(data), "3dgs", steps=args.steps, max_primitives=40_000)
    with tqdm(total=args.steps, unit="step") as bar:

        def show(row: dict) -> None:
            bar.update(row["step"] - bar.n)
            bar.set_postfix(n=row["n"])

        metrics = train(config, args.out / "run", show)
    print_metrics(metrics["test"])
    print(f"open {args.out / 'run' / 'report.html'}")


if __name__ == "__main__":
    main()
