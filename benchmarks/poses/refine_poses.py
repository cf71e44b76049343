"""What ``--refine-poses`` gains, and costs: trainings with and without it, from poses that differ in quality.

Poses as given, and with noise on every view, test views too; and those of other folders with the same photographs, as
``dogsplat poses`` has made them. Test PSNR is from the poses that the data have, and after each test pose is aligned to
the model, which nothing is learned from. Where poses were perturbed, their error against the given ones is told, too.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import numpy as np
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.datasets.dataset import View, camera_extent
from mi_dogsplat.measure.align import aligned
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.picture import photograph, seen_as
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scene.camera_motions import moved_w2c
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

from .pose_error import pose_error

HEADER = """
| capture | poses | seed | refined | PSNR | aligned PSNR | training L1 | position, % of extent | angle | seconds |
|---|---|---|---|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Poses:
    """A data set with poses of some quality: ``name``, and the views with the poses that the data came with."""

    name: str
    dataset: Dataset
    exact: list[View]


def main(argv: list[str]) -> None:
    """A row of the table for each training."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks refine_poses", description=__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="data sets whose poses are good")
    parser.add_argument("--found", type=Path, nargs="*", default=[], help="folders of dogsplat poses, for the same")
    parser.add_argument("--noise", type=float, nargs="*", default=[0.0025, 0.005, 0.01], help="radians, and extents")
    parser.add_argument("--focal", type=float, default=1.0, help="factor on all focal lengths, which are then wrong")
    parser.add_argument("--seeds", type=int, nargs="*", default=[0])
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--downscale", type=int, default=4)
    parser.add_argument("--max-primitives", type=int, default=10_000)
    parser.add_argument("--preset", default="3dgs")
    parser.add_argument("--split", default="test")
    parser.add_argument("--only", choices=("off", "on"), help="only without, or with refinement")
    args = parser.parse_args(argv)
    set_variant("llvm_ad_rgb")
    print(HEADER, flush=True)
    for data in args.data:
        for seed in args.seeds:
            for poses in _qualities(data, args, seed):
                for refine in [on for on in (False, True) if args.only in (None, "on" if on else "off")]:
                    print(_row(data.resolve().name, poses, seed, refine, args), flush=True)


def _qualities(data: Path, args: argparse.Namespace, seed: int) -> Iterator[Poses]:
    given = _with_focal(load_dataset(data, args.downscale, split=args.split), args.focal)
    yield Poses("given", given, given.views)
    for noise in args.noise:
        yield Poses(f"noise of {noise:.2%}", perturbed(given, noise, seed), given.views)
    for folder in args.found:
        found = _with_focal(load_dataset(folder, args.downscale, split=args.split), args.focal)
        if {view.name for view in found.views} == {view.name for view in given.views}:
            yield Poses("found", found, given.views)


def _with_focal(dataset: Dataset, factor: float) -> Dataset:
    """All views with focal lengths ``factor`` times as long."""

    def changed(view: View) -> View:
        camera = view.camera
        return replace(view, camera=replace(camera, fx=factor * camera.fx, fy=factor * camera.fy))

    train, test = ([changed(view) for view in views] for views in (dataset.train, dataset.test))
    return replace(dataset, train=train, test=test)


def perturbed(dataset: Dataset, noise: float, seed: int) -> Dataset:
    """All views at other poses: motions whose ω and τ have a root mean square length of ``noise``."""
    rng, extent = np.random.default_rng(seed), camera_extent(dataset.train)

    def moved(view: View) -> View:
        motion = rng.normal(scale=noise / np.sqrt(3), size=(1, 6))
        w2c = moved_w2c(view.camera.w2c[None], motion, extent)[0]
        return replace(view, camera=replace(view.camera, w2c=w2c))

    train, test = ([moved(view) for view in views] for views in (dataset.train, dataset.test))
    return replace(dataset, train=train, test=test, observations={})


def _row(capture: str, poses: Poses, seed: int, refine: bool, args: argparse.Namespace) -> str:
    config = TrainConfig(
        data=capture, preset=args.preset, steps=args.steps, downscale=args.downscale, seed=seed,
        max_primitives=args.max_primitives, refine_poses=refine, test_every=10 * args.steps,
    )  # fmt: skip
    dataset = poses.dataset
    trainer, start = Trainer(config, dataset), time.process_time()
    for _ in run_to_end(trainer):
        pass
    seconds = time.process_time() - start
    own, best = [], []
    for view in dataset.test:
        truth = photograph(view, trainer.background)
        own.append(psnr(seen_as(trainer.picture(view), view), truth))
        fitted = aligned(trainer.picture, view, trainer.background, trainer.extent)
        best.append(psnr(seen_as(trainer.picture(fitted), view), truth))
    names = {view.name for view in dataset.train}
    exact = {view.name: view.camera for view in poses.exact if view.name in names}
    error = pose_error(exact, {view.name: view.camera for view in trainer.photographs.originals})
    cells = (
        *(capture, poses.name, seed, "yes" if refine else "no", f"{np.mean(own):.2f}", f"{np.mean(best):.2f}"),
        *(f"{trainer.training_l1():.5f}", f"{error.position:.3%}", f"{error.angle:.3f}°", f"{seconds:.0f}"),
    )
    return "| " + " | ".join(str(cell) for cell in cells) + " |"
