"""What each subcommand of ``dogsplat`` calls, and what it prints of what comes back.

Modules that are heavy, or belong to an extra, are imported when their command runs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from ..compare.names import ABLATION, ALL, SETS, chosen
from ..datasets.capture_config import CaptureConfig
from ..editing.clean_config import CleanConfig
from ..editing.simplify_config import SimplifyConfig
from ..film.film_config import FilmConfig
from ..poses.config import PosesConfig
from ..render.picture_options import PictureOptions
from ..scene.drawing import Drawing
from ..support.errors import DataError
from ..support.settings import settings_of
from ..support.variants import set_variant
from ..training.config import TrainConfig
from ..training.target import target_bytes
from .printing import cleaned_lines, loss_table, metrics_line, simplified_lines

T = TypeVar("T")


def train(args: argparse.Namespace) -> None:
    """Train a model on photographs and measure it on those held out; poses are found first where there are none."""
    config = _config(args)
    posed = _posed(config, args.out)
    if posed is not config:  # what was stopped before it had poses has nothing else to go on with
        args.resume = args.resume and (args.out / "config.json").exists()
    _run(posed, args)


def prune(args: argparse.Namespace) -> None:
    """Prune a model to a target while refining it on its photographs, then add Differences of Gaussians."""
    from ..formats.read import read_model

    said = Drawing(args.antialiased, args.near_clip).over(read_model(args.model).drawing)
    how = {"antialiased": bool(said.antialiased), "near_clip": said.near_clip}
    _run(_config(args, model=args.model, **how), args)


def _run(config: TrainConfig, args: argparse.Namespace) -> None:
    """Fill a run folder while a bar shows how far it is."""
    set_variant(config.variant)
    from ..runs.run import train as run_train
    from .progress import Bar

    with Bar("step") as bar:

        def show(row: dict) -> None:
            figures = {}
            if "l1" in row:
                figures = {"l1": f"{row['l1']:.4f}", "n": row["n"]}
                figures |= {"psnr": f"{row['test_psnr']:.2f}"} if "test_psnr" in row else {}
            bar.show(row["step"], config.steps, **figures)

        metrics = run_train(config, args.out, show, args.resume)
    split = "test views:" if metrics["test"] else "training views (there is no test split):"
    print(split, metrics_line(metrics["test"] or metrics["train"]))
    size, seconds = metrics["bytes"] / 1e6, metrics["train_seconds"]
    print(f"{metrics['n']:,} primitives, {size:.1f} MB, {seconds:.0f} s; {args.out / 'report.html'}")


def ablate(args: argparse.Namespace) -> int:
    """Train the variants of the method from one densified start per seed, and tabulate what each part contributes."""
    if unknown := [name for name in args.only if name not in ABLATION]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(ABLATION)}")
    args.data, args.cluster, args.workers, args.more_targets = [args.data], None, 0, []
    status = compare(args)
    print((args.out / "comparison.md").read_text(encoding="utf-8"), end="")
    return status


def compare(args: argparse.Namespace) -> int:
    """Train several compact methods from one densified start per data set and seed, to one budget; tabulate them."""
    try:
        methods = chosen(args.only)
    except ValueError as error:
        raise DataError("--only", f'"{error}" is unknown', f"use {', '.join((*SETS, *ALL))}") from None
    if args.workers < 0:
        raise DataError("--workers", f"{args.workers} is out of range", "use at least 0")
    if target_bytes(args.target) is not None:
        remedy = "compare and ablate take a ratio or a number of primitives"
        raise DataError("--target", f"{args.target} is the size of a file", remedy)
    config = _config(args, preset="3dgs", data="")
    set_variant(config.variant)
    from ..compare.compare import compare as run_comparison

    def say(line: str) -> None:
        print(line, flush=True)

    if wrong := [x for x in args.more_targets if not (0 < x < 1 or (x >= 1 and x.is_integer()))]:
        raise DataError("--more-targets", f"{wrong[0]:g} is no target", "use ratios below 1 or whole numbers")
    where, means = (args.data, args.out, args.seeds, methods), (args.cluster, args.workers, args.more_targets)
    table = run_comparison(config, *where, *means, say)
    print(args.out / "comparison.html")
    for name, error in table["failed"].items():
        print(f"dogsplat: {name} has failed: {error}", file=sys.stderr)
    return 1 if table["failed"] else 0


def render(args: argparse.Namespace) -> None:
    """Render a model from a view of a data set or from a camera file, or a Mitsuba scene as it stands."""
    options = _given(PictureOptions, args)
    set_variant(args.variant)
    from ..render.render_files import render_model, render_scene

    if args.model.suffix.lower() == ".xml":
        if args.aovs is not None:
            raise DataError("--aovs", "a scene names its own", 'set the property "aovs" of its integrator')
        render_scene(args.model, args.out)
    else:
        render_model(args.model, args.out, args.data, args.camera, args.aovs, options)
    print(args.out)


def evaluate(args: argparse.Namespace) -> None:
    """Metrics of a model on the test views of a data set (all views without a split); LPIPS where it is installed."""
    options = _given(PictureOptions, args)
    set_variant(args.variant)
    from ..measure.evaluate import mean_metrics
    from ..runs.evaluation import evaluate_model

    more = args.masks, args.color_correct, args.data_on_disk
    views = evaluate_model(args.model, args.data, args.out, *more, options)
    for name, values in {**views, "mean": mean_metrics(views)}.items():
        print(f"{name:24s}{metrics_line(values)}")


def capture(args: argparse.Namespace) -> int | None:
    """Render a Mitsuba scene from all around into photographs with exact cameras, and points to start from."""
    config = _given(CaptureConfig, args)
    set_variant(args.variant)
    from ..datasets.capture import capture as run_capture
    from .progress import Bar

    try:
        with Bar("view") as bar:
            run_capture(args.scene, args.out, config, bar.show)
    except KeyboardInterrupt:
        print("dogsplat: stopped; the same command again goes on from here", file=sys.stderr)
        return 130
    print(args.out)
    return None


def poses(args: argparse.Namespace) -> int | None:
    """Find the poses of photographs or of a video by structure from motion, and write a COLMAP folder."""
    config = _given(PosesConfig, args)
    try:
        _find_poses(args.source, args.out, config)
    except KeyboardInterrupt:
        print("dogsplat: stopped; the same command again goes on from here", file=sys.stderr)
        return 130
    print(args.out)
    return None


def _find_poses(source: Path, out: Path, config: PosesConfig) -> None:
    """Bars while it goes on, then what was found."""
    from ..poses.run import find_poses
    from .progress import StageBars

    with StageBars() as bars:
        summary = find_poses(source, out, config, bars.show)
    print("\n".join(summary.lines()), flush=True)


def _posed(config: TrainConfig, run: Path) -> TrainConfig:
    """The settings for data with poses: those given, or what is made of plain images or a video in the run's folder."""
    from ..poses.input import needs_poses
    from ..runs.run import POSED, prepare_folder

    if not needs_poses(config.data):
        return config
    prepare_folder(run)
    out = run / POSED
    _say(f"{config.data} has no cameras: finding its poses, into {out}")
    _find_poses(Path(config.data), out, PosesConfig(masks=config.masks, seed=config.seed))
    return replace(config, data=str(out), masks=str(out / "masks") if (out / "masks").is_dir() else None)


def check(args: argparse.Namespace) -> int:
    """How far the numbers can be trusted, and what each digit costs: numerics as one report."""
    options = _given(PictureOptions, args)
    set_variant(args.variant)
    from ..check.run import check as run_check

    how = args.only, args.runs, args.data, args.camera, args.width, args.rounds
    report = run_check(args.out, args.model, *how, options, _say)
    page = args.out / "check.html"
    print(page if page.exists() else page.with_suffix(".json"))
    if wrong := [row["name"] for row in report.get("stability", []) if row["verdict"] == "wrong"]:
        print(f"dogsplat: stability: {len(wrong)} wrong: {', '.join(wrong)}", file=sys.stderr)
    return 1 if wrong else 0


def export(args: argparse.Namespace) -> None:
    """Write a model in the format of another program, without DoG, and measure what that loses."""
    options = _given(PictureOptions, args)
    set_variant(args.variant)
    from ..export.write import export_model
    from .progress import Bar

    with Bar("step", "refining") as bar:
        which = args.dog, args.data, args.views, options, args.spz_version, args.refine
        exported = export_model(args.model, args.out, *which, bar.show, args.small)
    for line in (*exported.left_out, *loss_table(exported)):
        print(line)
    print(_size_line(args.out, exported.n_splats, args.model))


def simplify(args: argparse.Namespace) -> None:
    """Merge primitives that are near and alike until few are left, and fit those to renders of the model."""
    config, options = _given(SimplifyConfig, args), _given(PictureOptions, args)
    set_variant(args.variant)
    from ..editing.simplify import simplify_model
    from .progress import Bar

    with Bar("step") as bar:
        simplified = simplify_model(args.model, args.out, config, options, bar.show)
    print("\n".join(simplified_lines(simplified)))
    print(_size_line(args.out, simplified.n_after, args.model))


def clean(args: argparse.Namespace) -> None:
    """Take out of a model what no picture of it shows, which changes none, and what you do not want."""
    config, options = _given(CleanConfig, args), _given(PictureOptions, args)
    if args.data or args.preview:
        set_variant(args.variant)
    from ..editing.clean import clean_model

    cleaned = clean_model(args.model, args.out, config, args.data, args.preview, options)
    print("\n".join(cleaned_lines(cleaned)))
    print(_size_line(args.out, cleaned.n_after, args.model))


def film(args: argparse.Namespace) -> None:
    """Render a film of a model along a camera path, to a video or to numbered pictures."""
    config, options = _given(FilmConfig, args), _given(PictureOptions, args)
    set_variant(args.variant)
    from ..film.make import make_film
    from .progress import Bar

    with Bar("frame") as bar:
        made = make_film(args.model, args.out, args.data, config, options, bar.show)
    width, height = made.size
    print(f"{args.out}: {made.n_frames} frames of {width} x {height}, {made.n_frames / config.fps:.4g} s; {made.path}")


def view(args: argparse.Namespace) -> None:
    """Show a model, or a run while it trains, in the browser."""
    options = _given(PictureOptions, args)
    set_variant(args.variant)
    from ..viewer.server import serve

    serve(args.model, args.data, args.host, args.port, options, _say)


def info(args: argparse.Namespace) -> None:
    """Say what a file is: counts, ranges, and problems found; or what its kernels need and what they leave out."""
    if args.features or args.file.suffix == ".xml":
        set_variant("auto")  # to count operations, to render the sensors of a scene
    if args.features:
        from ..inspection.describe_features import describe_features as describe
    else:
        from ..inspection.info import describe

    print("\n".join(describe(args.file)))


def _config(args: argparse.Namespace, **others: Any) -> TrainConfig:
    """The settings of a training among the arguments, checked; raises ``DataError`` that names the flag.

    ``model`` is the model of ``prune`` only: other commands have arguments of that name.
    """
    return _given(TrainConfig, args, **{"model": None, **others})


def _given(kind: type[T], args: argparse.Namespace, **others: Any) -> T:
    """Settings from the arguments that are called as they are, and from ``others``."""
    given = {name: value for name, value in vars(args).items() if name in settings_of(kind)}
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    return kind(**values | others)


def _size_line(out: Path, n_splats: int, model: Path) -> str:
    """What was written, beside what it was made of."""
    megabytes, before = (path.stat().st_size / 1e6 for path in (out, model))
    return f"{out}: {n_splats:,} primitives, {megabytes:.2f} MB; {model.name} has {before:.2f} MB"


def _say(line: str) -> None:
    print(line, flush=True)


COMMANDS: dict[str, Callable[[argparse.Namespace], int | None]] = {
    "train": train, "prune": prune, "ablate": ablate, "compare": compare, "render": render, "eval": evaluate,
    "capture": capture, "poses": poses, "check": check, "export": export, "simplify": simplify, "clean": clean,
    "film": film, "view": view, "info": info
}  # fmt: skip
