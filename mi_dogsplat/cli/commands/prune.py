"""The command ``dogsplat prune``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...render.picture_options import PictureOptions
from ...training.config import TrainConfig
from ..flags import MODEL_HELP, add_data, add_settings, training_config
from ..training_run import run_training

SUMMARY = "make an existing model smaller, using its photographs"
EXAMPLES = """
Examples:
  dogsplat prune model.ply photos/ -o run                      keeps a tenth of its primitives
  dogsplat prune model.ply photos/ -o run --target 20000 --steps 3500 --downscale 2
  dogsplat prune model.ply photos/ -o run --target 2MB --format spz
                                                               a file of at most 2 MB
  dogsplat prune model.ply photos/ -o run --preset released    as in the authors' code

The model may come from any trainer of 3D Gaussians. There is no densification: the schedule begins with its
first prune, and --steps counts from there (default: what is left of the preset's schedule). RUN is filled as
by dogsplat train. Its history has every decision to prune or to refine, with the reason.
"""

TRAINING_FLAGS = [
    *("preset", "steps", "target", "format", "batch_views", "downscale", "split", "background", "white"),
    *("near_zone", "masks", "depths", "appearance", "refine_poses", "preconditioned", "data_on_disk", "seed"),
    *("variant", "log_every", "test_every", "memory", "checkpoint_seconds", "up", "scale", "unit"),
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", metavar="MODEL", help=MODEL_HELP)
    add_data(parser)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="RUN", help="run folder to write")
    add_settings(parser, TrainConfig, TRAINING_FLAGS)
    add_settings(parser, PictureOptions, ["antialiased", "near_clip"])
    parser.add_argument("--resume", action="store_true", help="continue from the last checkpoint of RUN")


def run(args: argparse.Namespace) -> None:
    """Prune a model to a target while refining it on its photographs, then add Differences of Gaussians."""
    from ...formats.read import read_model

    of_file = read_model(args.model).drawing
    flags = {"antialiased": args.antialiased, "near_clip": args.near_clip, "up": args.up}
    how = {name: getattr(of_file, name) if value is None else value for name, value in flags.items()}
    how["antialiased"] = bool(how["antialiased"])
    measured = args.scale or args.unit is not None  # which comes before what the file says
    how["unit"] = args.unit if measured else of_file.scale
    run_training(training_config(args, model=args.model, **how), args.out, args.resume)
