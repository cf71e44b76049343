"""The three steps of the demo: a training set, a compact model, and both side by side."""

from __future__ import annotations

from pathlib import Path

from ..cli.printing import metrics_line
from ..cli.progress import Bar
from ..cli.training_run import shown_training
from ..datasets.capture import capture
from ..datasets.capture_config import CaptureConfig
from ..report.run_folder import METRICS, MODEL, REPORT
from ..runs.checkpoint import CHECKPOINT
from ..runs.run import train
from ..support.errors import DataError
from ..support.wording import counted
from ..training.config import TrainConfig
from .side_by_side import write_truth_and_model

SCENE = "demo_truth.xml"
PACKAGED, CHECKED_OUT = Path(__file__).parent / "scenes", Path(__file__).parents[2] / "scenes"


def scene_file() -> Path:
    """The scene of the demo: in a wheel it lies in the package, in a checkout in ``scenes/``. Raises ``DataError``."""
    for folder in (PACKAGED, CHECKED_OUT):
        if (folder / SCENE).is_file():
            return folder / SCENE
    raise DataError(CHECKED_OUT / SCENE, "no such file", "install mi_dogsplat again, or check its repository out whole")


def tour(out: Path, steps: int, target: int, views: int, size: int, picture: Path) -> None:
    """Make a data set, a run folder and a picture in ``out``, and say what is being done.

    Args:
        out: folder to write ``data/`` and ``run/`` to; what is complete of the data set is kept.
        steps: of training.
        target: primitives of the compact model.
        views: for training; a sixth as many more are for testing.
        size: their width and height in pixels.
        picture: PNG of the truth beside the model.

    Needs a Mitsuba variant. Raises ``DataError``.
    """
    scene, data, run = scene_file(), out / "data", out / "run"
    orbit = CaptureConfig(
        views=views, size=(size, size), elevations=(12.0, 65.0), zoom=1.35, spp=121, alpha=True, points=8000
    )
    config = TrainConfig(str(data), steps=steps, max_primitives=4 * target, target=target)  # bad numbers show here
    print(f"1/3  {scene.name}: path tracing {counted(views, 'training view')} and {counted(views // 6, 'test view')}")
    with Bar("view") as bar:
        capture(scene, data, orbit, lambda done, n, framing: bar.show(done, n))
    print(f"2/3  training {counted(steps, 'step')}, pruning to {counted(target, 'primitive')}")
    with shown_training(steps) as show:
        metrics = train(config, run, show, resume=(run / CHECKPOINT).is_file() and not (run / METRICS).is_file())
    print(metrics_line(metrics["test"]))
    megabytes = f"{metrics['bytes'] / 1e6:.1f} MB"
    print(f"{counted(metrics['n'], 'primitive')}, {metrics['n_dog']:,} of them DoG, {megabytes}")
    print("3/3  the path-traced truth beside the model")
    write_truth_and_model(scene, run / MODEL, picture, f"{counted(metrics['n'], 'splat')}, {megabytes}")
    print(f"look at {picture}, open {run / REPORT}")
