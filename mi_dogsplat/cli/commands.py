"""The command ``dogsplat`` (= ``python -m mi_dogsplat``): what each subcommand calls and prints."""

from __future__ import annotations

import argparse
import dataclasses
import os
import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack

from ..runs.stopping import Stopped
from ..support.errors import DataError
from ..support.variants import set_variant
from ..training.config import TrainConfig
from .arguments import ABLATION, METHODS, build_parser


def train(args: argparse.Namespace) -> None:
    """Train a model on photographs and measure it on those held out."""
    _run(_config(args), args)


def prune(args: argparse.Namespace) -> None:
    """Prune a model to a target while refining it on its photographs, then add Differences of Gaussians."""
    _run(_config(args, model=args.model), args)


def _run(config: TrainConfig, args: argparse.Namespace) -> None:
    """Fill a run folder while a bar shows how far it is."""
    set_variant(config.variant)
    from tqdm import tqdm

    from ..runs.run import train as run_train

    with ExitStack() as stack:
        bars: list[tqdm] = []  # none until training starts: an error before that is a single line

        def show(row: dict) -> None:
            if not bars:
                options = {"unit": "step", "dynamic_ncols": True, "smoothing": 0.05}
                bars.append(stack.enter_context(tqdm(total=config.steps, **options)))
            bars[0].update(row["step"] - bars[0].n)
            if "l1" in row:
                shown = {"l1": f"{row['l1']:.4f}", "n": row["n"]}
                psnr = {"psnr": f"{row['test_psnr']:.2f}"} if "test_psnr" in row else {}
                bars[0].set_postfix(shown | psnr)

        metrics = run_train(config, args.out, show, args.resume)
    print("test views:" if metrics["test"] else "training views (there is no test split):", end=" ")
    print_metrics(metrics["test"] or metrics["train"])
    size, seconds = metrics["bytes"] / 1e6, metrics["train_seconds"]
    print(f"{metrics['n']:,} primitives, {size:.1f} MB, {seconds:.0f} s; {args.out / 'report.html'}")


def ablate(args: argparse.Namespace) -> int:
    """Train the variants of the method from one densified start per seed, and tabulate what each part contributes."""
    if unknown := [name for name in args.only if name not in ABLATION]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(ABLATION)}")
    args.data, args.cluster, args.workers = [args.data], None, 0
    status = compare(args)
    print((args.out / "comparison.md").read_text(encoding="utf-8"), end="")
    return status


def compare(args: argparse.Namespace) -> int:
    """Train several compact methods from one densified start per data set and seed, to one budget; tabulate them."""
    offered = dict.fromkeys((*METHODS, *ABLATION))
    if unknown := [name for name in args.only if name not in offered]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(offered)}")
    if args.workers < 0:
        raise DataError("--workers", f"{args.workers} is out of range", "use at least 0")
    config = _config(args, preset="3dgs", data="")
    set_variant(config.variant)
    from ..compare.compare import compare as run_comparison

    def say(line: str) -> None:
        print(line, flush=True)

    table = run_comparison(config, args.data, args.out, args.seeds, args.only, args.cluster, args.workers, say)
    print(args.out / "comparison.html")
    for name, error in table["failed"].items():
        print(f"dogsplat: {name} has failed: {error}", file=sys.stderr)
    return 1 if table["failed"] else 0


def render(args: argparse.Namespace) -> None:
    """Render a model from a view of a data set or from a camera file, or a Mitsuba scene as it stands."""
    _config(args)
    set_variant(args.variant)
    from ..render.render_files import render_model, render_scene

    if args.model.suffix.lower() == ".xml":
        if args.aovs is not None:
            raise DataError("--aovs", "a scene names its own", 'set the property "aovs" of its integrator')
        render_scene(args.model, args.out)
    else:
        render_model(args)
    print(args.out)


def evaluate(args: argparse.Namespace) -> None:
    """Metrics of a model on the test views of a data set (all views without a split); LPIPS where it is installed."""
    _config(args)
    set_variant(args.variant)
    from ..datasets import load_dataset
    from ..datasets.masks import Masks
    from ..measure.evaluate import Measure, evaluate_views, mean_metrics
    from ..measure.lpips import Lpips
    from ..render.picture import background_color
    from ..render.render_files import picture_of
    from ..runs.run import prepare_folder
    from ..scene.ply import read_ply
    from ..support.files import write_json

    splats = read_ply(args.model)
    dataset = load_dataset(args.data, args.downscale, on_disk=args.data_on_disk)
    background = background_color(args.background, dataset.has_alpha)
    if args.out:
        if (args.out / "config.json").exists():
            raise DataError(args.out, "is a training run with metrics of its own", "name another folder")
        prepare_folder(args.out)
    aovs = ("depth",) if args.out else ()
    picture = picture_of(splats, background, args.near_clip, antialiased=args.antialiased, aovs=aovs)
    some = dataset.test or dataset.train
    masks = Masks(args.masks, [*dataset.train, *dataset.test]) if args.masks else None
    measure = Measure(masks, args.color_correct, Lpips.installed(view.camera for view in some))
    views = evaluate_views(lambda v: picture(v.camera), some, background, args.out, measure)
    for name, values in views.items():
        print(f"{name:24s}", end="")
        print_metrics(values)
    print(f"{'mean':24s}", end="")
    print_metrics(mean_metrics(views))
    if args.out:
        write_json(args.out / "metrics.json", {"test": mean_metrics(views), "views": views, "n": splats.n_splats})


def capture(args: argparse.Namespace) -> int | None:
    """Render a Mitsuba scene from all around into photographs with exact cameras, and points to start from."""
    set_variant(args.variant)
    from .capture import run_capture

    try:
        run_capture(args)
    except KeyboardInterrupt:
        print("dogsplat: stopped; the same command again goes on from here", file=sys.stderr)
        return 130
    print(args.out)
    return None


def check(args: argparse.Namespace) -> int:
    """How far the numbers can be trusted, and what each digit costs: numerics as one report."""
    _config(args)
    from .check import run_check

    return run_check(args)


def export(args: argparse.Namespace) -> None:
    """Write a model in the format of another program, without DoG, and measure what that loses."""
    _config(args)
    if args.views < 0:
        raise DataError("--views", f"{args.views} is too small", "use at least 0")
    set_variant(args.variant)
    from ..export.write import export as run_export

    run_export(args)


def view(args: argparse.Namespace) -> None:
    """Show a model, or a run while it trains, in the browser."""
    _config(args)
    set_variant(args.variant)
    from ..viewer.server import view as run_view

    if not 0 < args.port < 65536:
        raise DataError("--port", f"{args.port} is no port", "use 1 to 65535")
    run_view(args, lambda line: print(line, flush=True))


def info(args: argparse.Namespace) -> None:
    """Say what a file is: counts, ranges, and problems found; or what its kernels need and what they leave out."""
    if args.features or args.file.suffix == ".xml":
        set_variant("auto")  # to count operations, to render the sensors of a scene
    if args.features:
        from ..inspection.describe_features import describe_features as describe
    else:
        from ..inspection.info import describe

    print("\n".join(describe(args.file)))


def _config(args: argparse.Namespace, **others) -> TrainConfig:
    """The settings among the arguments, checked; raises ``DataError`` that names the flag.

    ``model`` is the model of ``prune`` only: other commands have arguments of that name.
    """
    names = {field.name for field in dataclasses.fields(TrainConfig)} - {"model"}
    given = {name: value for name, value in vars(args).items() if name in names}
    return TrainConfig(**{"data": "", **given, **others})


METRICS = {
    "psnr": "PSNR {:.2f} dB", "cc_psnr": "colour-corrected {:.2f} dB", "ssim": "SSIM {:.4f}", "flip": "FLIP {:.4f}",
    "l1": "L1 {:.5f}", "lpips": "LPIPS {:.4f}"
}  # fmt: skip


def print_metrics(values: dict[str, float]) -> None:
    """One line with the metrics that are there."""
    print("  ".join(text.format(values[name]) for name, text in METRICS.items() if name in values))


EXTRAS = ("export", "view")  # of pyproject.toml, named as the commands that need them; the others need "train"
COMMANDS: dict[str, Callable[[argparse.Namespace], int | None]] = {
    "train": train, "prune": prune, "ablate": ablate, "compare": compare, "render": render, "eval": evaluate,
    "capture": capture, "check": check, "export": export, "view": view, "info": info
}  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    try:
        try:
            return _run_command(argv)
        finally:
            sys.stdout.flush()  # here, where it can be caught that nobody reads any more
    except BrokenPipeError:  # as in ``dogsplat info FILE | head -1``
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # takes what is flushed at the very end
        return 128 + signal.SIGPIPE


def _run_command(argv: list[str] | None) -> int:
    """Run the command that is asked for; returns the exit status."""
    args = build_parser({name: run.__doc__ or "" for name, run in COMMANDS.items()}).parse_args(argv)
    try:
        return COMMANDS[args.command](args) or 0
    except DataError as error:
        print(f"dogsplat: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("mi_dogsplat"):
            raise
        extra = args.command if args.command in EXTRAS else "train"
        print(f"dogsplat: this needs the package {error.name}: pip install 'mi_dogsplat[{extra}]'", file=sys.stderr)
        return 2
    except Stopped as stop:
        print(f"dogsplat: {stop}", file=sys.stderr)
        return 128 + stop.signal_number
    except KeyboardInterrupt:
        print("dogsplat: stopped before the end; nothing is half-written", file=sys.stderr)
        return 128 + signal.SIGINT
    except OSError as error:  # of writing: what is read is looked at where it is read
        if isinstance(error, BrokenPipeError) or not error.strerror:
            raise
        place = f"{error.filename}: " if error.filename else ""
        print(f"dogsplat: {place}{error.strerror}; check the place, its permissions and its space", file=sys.stderr)
        return 2
