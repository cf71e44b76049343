"""The command ``dogsplat compare``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ...compare.names import ALL, PUBLISHED, SETS, chosen
from ...compare.targets import COUNTS, counted_target
from ...support.errors import DataError
from ...support.variants import set_variant
from ...training.config import TrainConfig
from ...training.presets import RECIPES
from ...training.target import require_below_cap
from ..data_notes import say_what_is_not_read
from ..errors import resumable
from ..flags import add_data, add_settings, training_config
from ..printing import say

SUMMARY = "train several methods to one budget, and compare them in a table"
EXAMPLES = """
Examples:
  dogsplat compare photos/ -o compared --steps 7000 --downscale 2 --max-primitives 40000
  dogsplat compare fox/ fern/ lego/ -o compared --seeds 0 1 2 --only 3dgs speedy_splat ours
                                                       three data sets, three seeds, three methods
  dogsplat compare photos/ -o compared --only published equal
                                                       all, and all with our window and step sizes
  dogsplat compare photos/ -o compared --only paper ours --more-targets 0.05 0.2
                                                       tables of equal bytes and equal time, too
  dogsplat compare fox/ fern/ -o compared --workers 2  two runs at a time, on this machine
  dogsplat compare fox/ fern/ -o compared --cluster tcp://10.0.0.7:8786
                                                       on the workers of a Dask cluster (docs/compare.md)

All methods of a seed have the same renderer, the same number of steps (except released_40k) and of
primitives. Most of them continue from one densified start; the others begin at the first step. 3dgs is the
baseline at 100 %. DIR/comparison.html has the tables, plots and pictures; comparison.csv and comparison.tex
have the numbers. All three are written again whenever a run finishes. Each run is a run folder under
DIR/DATA/seed_N/. Runs that are complete are not repeated. A run that fails is named, and the others go on.
--workers and --cluster need the extra mi_dogsplat[cluster].
"""

PRESET = "3dgs"  # of the densified start, whose bounds are those of all methods
WORLD_SCALE = (
    "remove primitives larger than this many camera extents, in all methods, also those that grow by themselves "
    f"(default: {RECIPES[PRESET].densification.max_world_scale:g}, that of {PRESET}; inf: none)"
)
TRAINING_FLAGS = [
    *("steps", "downscale", "max_primitives", "max_world_scale", "split", "sh_degree"),
    *("background", "antialiased", "near_clip", "initial_primitives", "variant", "log_every", "test_every", "memory"),
    *("masks", "depths", "preconditioned", "checkpoint_seconds"),
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    add_data(parser, nargs="+")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder to write, or to continue")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], metavar="N", help="random seeds (default: 0)")
    methods = f"methods ({' '.join(ALL)}), or sets of them ({' '.join(SETS)}) (default: published)"
    parser.add_argument("--only", nargs="+", default=list(PUBLISHED), metavar="NAME", help=methods)
    more = "further targets, for the tables of equal bytes and equal time"
    parser.add_argument("--more-targets", nargs="+", default=[], metavar="X", help=more)
    parser.add_argument("--cluster", metavar="ADDRESS", help="address of a Dask scheduler, such as tcp://10.0.0.7:8786")
    parser.add_argument(
        "--workers", type=int, default=0, metavar="N", help="runs at once, on this machine (default: 0: no Dask)"
    )
    add_training_flags(parser)


def add_training_flags(parser: argparse.ArgumentParser) -> None:
    """What all trainings of a comparison have in common; their target is no size of a file, as that of a training may
    be."""
    add_settings(parser, TrainConfig, TRAINING_FLAGS, said={"max_world_scale": WORLD_SCALE})
    target = f"size after pruning: {COUNTS} (default: {TrainConfig.target})".replace("%", "%%")
    parser.add_argument("--target", default=TrainConfig.target, metavar="X", help=target)


def run(args: argparse.Namespace) -> int:
    """Train several compact methods to one budget, from one densified start per data set and seed, and compare them."""
    try:
        methods = chosen(args.only)
    except ValueError as error:
        raise DataError("--only", f'"{error}" is unknown', f"use {', '.join((*SETS, *ALL))}") from None
    counted_target("--target", args.target)
    config = training_config(args, preset=PRESET, data="")
    more_targets = _more_targets(args.more_targets, config)
    set_variant(config.variant)
    from ...compare.compare import compare as run_comparison

    for data in args.data:
        say_what_is_not_read(data, config.masks, config.depths)
    with resumable():
        table = run_comparison(
            config, args.data, args.out, args.seeds, methods, cluster=args.cluster, workers=args.workers,
            targets=more_targets, progress=say,
        )  # fmt: skip
    print(args.out / "comparison.html")
    for name, error in table["failed"].items():
        print(f"dogsplat: {name} has failed: {error}", file=sys.stderr)
    return 1 if table["failed"] else 0


def _more_targets(given: Sequence[str], config: TrainConfig) -> list[float]:
    """Targets beside that of ``config``, in their order. Raises ``DataError`` for those above its cap."""
    targets = [counted_target("--more-targets", target) for target in given]
    for target in targets:
        require_below_cap("more_targets", target, config.max_primitives)
    return [target for target in targets if target != config.target]
