"""The command ``dogsplat train``."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ...poses.config import PosesConfig
from ...runs.stopping import stop_when_input_ends
from ...support.settings import settings_of
from ...support.variants import set_variant
from ...training.config import TrainConfig
from ..flags import DATA_HELP, add_data, add_settings, training_config
from ..mask_search import search_masks
from ..pose_search import search_poses
from ..printing import say
from ..training_run import run_training

SUMMARY = "train a model on photographs or a video"
PLAIN = "plain images or a video, whose poses are found first, or a scan by Polycam, Record3D or Stray Scanner"
EXAMPLES = """
Examples:
  dogsplat train photos/ -o run                        the full schedule, a tenth of the primitives
  dogsplat train photos/ -o run --steps 7000 --downscale 2 --max-primitives 60000
                                                       minutes instead of hours, and fewer primitives
  dogsplat train photos/ -o run --target 20000         20,000 primitives, less those that fade later
  dogsplat train photos/ -o run --target 2MB --format spz
                                                       a file of at most 2 MB
  dogsplat train photos/ -o run --preset 3dgs          without pruning and DoG: the published baseline
  dogsplat train lego/ -o run --background white       images with alpha over white (as auto does)
  dogsplat train lego/ -o run --background random      a new colour at each step, so that no splat hides
  dogsplat train photos/ -o run --masks masks/ --appearance
                                                       people are masked, automatic exposure is undone
  dogsplat train photos/ -o run --mask-moved           people who walked by are found and masked first
  dogsplat train photos/ -o run --depths depth/        depth maps of a phone with LiDAR, or of a network
  dogsplat train photos/ -o run --data-on-disk         more photographs than fit into memory
  dogsplat train photos/ -o run --scale 0001 0004 0.75
                                                       two images taken 75 cm apart: the unit in metres
  dogsplat train pictures/ -o run --downscale 4        images without cameras: poses first, in run/posed
  dogsplat train walk.mp4 -o run --downscale 4         a video: frames and poses first
  dogsplat train scan/ -o run                          a scan by Polycam, with its poses and depth maps

Afterwards RUN holds point_cloud.ply (the model), report.html (open it in a browser), metrics.json,
history.jsonl, config.json, and test/ with a render, the photograph and an error map of each test view.
Ctrl-C saves a checkpoint and stops. The same command with --resume continues from there, also after a crash.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    add_data(parser, f"{DATA_HELP}; or {PLAIN}")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="RUN", help="run folder to write")
    add_settings(parser, TrainConfig, [name for name in settings_of(TrainConfig) if name not in ("data", "model")])
    parser.add_argument(
        "--mask-moved",
        action="store_true",
        help="find and mask what moved, or stood in the way, in single photographs; a small model is trained first for "
        "this (RUN/first, RUN/masks)",
    )
    parser.add_argument("--resume", action="store_true", help="continue from the last checkpoint of RUN")
    parser.add_argument(
        "--until-input-ends",
        action="store_true",
        help="stop, as by Ctrl-C, when standard input ends; for programs that start this one",
    )


def run(args: argparse.Namespace) -> None:
    """Train a model on photographs, and measure it on those held out. If they have no poses, these are found first."""
    from ...report.run_folder import CONFIG

    if args.until_input_ends:
        stop_when_input_ends()
    config = training_config(args)
    if config.target != TrainConfig.target:
        config.require_pruning()
    posed, resume = _posed(config, args.out, args.resume), args.resume
    masked = search_masks(posed, args.out, resume) if args.mask_moved else posed
    if masked is not config:  # what was stopped before it had poses and masks has nothing else to go on with
        resume = resume and (args.out / CONFIG).exists()
    run_training(masked, args.out, resume)


def _posed(config: TrainConfig, run: Path, resume: bool) -> TrainConfig:
    """The settings for data with poses: those given, or what is made in the run's folder of plain images, a video or a
    scan."""
    from ...datasets.scans.apps import is_scan
    from ...poses.input import needs_poses, require_input
    from ...report.run_folder import POSED
    from ...runs.run import prepared
    from ...runs.unposed import check_unposed

    if not needs_poses(config.data):
        return config
    require_input(Path(config.data))
    set_variant(config.variant)
    check_unposed(config, run, resume)
    out = run / POSED
    with prepared(run):
        scanned = is_scan(Path(config.data))
        say(f"{config.data} {'is a scan: reading it' if scanned else 'has no cameras: finding poses'} first, in {out}")
        search_poses(Path(config.data), out, PosesConfig(masks=config.masks, seed=config.seed))
    masks, depth = (str(out / name) if (out / name).is_dir() else None for name in ("masks", "depth"))
    return replace(config, data=str(out), masks=masks, depths=config.depths or depth)
