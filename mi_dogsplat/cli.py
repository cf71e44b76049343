"""The command ``dogsplat`` (= ``python -m mi_dogsplat``): parses, calls, prints."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

from .cli_help import EPILOG, EVAL_EXAMPLES, INFO_EXAMPLES, RENDER_EXAMPLES, TRAIN_EXAMPLES
from .config import TrainConfig
from .errors import DataError


class Parser(argparse.ArgumentParser):
    """Wrong use is one line on stderr, as every other error; the help is shown as it is written."""

    def __init__(self, **options):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"dogsplat: {message}; see {self.prog} --help\n")


def _field_help() -> dict[str, str]:
    """Comments of the fields of ``TrainConfig``: config lives, and is explained, in one place."""
    source = Path(sys.modules[TrainConfig.__module__].__file__ or "").read_text(encoding="utf-8")
    names = {field.name for field in dataclasses.fields(TrainConfig)}
    lines = (line.strip() for line in source.splitlines() if "#" in line and ":" in line)
    pairs = ((line.split(":", 1)[0], line.split("#", 1)[1].strip()) for line in lines)
    return {name: text for name, text in pairs if name in names}


def _add_config_flags(parser: argparse.ArgumentParser, names: list[str]) -> None:
    texts = _field_help()
    for field in dataclasses.fields(TrainConfig):
        if field.name not in names:
            continue
        flag = "--" + field.name.replace("_", "-")
        shown = texts[field.name] + ("" if field.default is None else f" (default: {field.default})")
        if isinstance(field.default, bool):
            parser.add_argument(flag, action="store_true", help=texts[field.name])
        else:
            kind = int if field.default is None else type(field.default)
            metavar = {int: "N", float: "X"}.get(kind, "NAME")
            parser.add_argument(flag, type=kind, default=field.default, metavar=metavar, help=shown)


def build_parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="dogsplat",
        description="Small, sharp, differentiable radiance fields in Mitsuba 3.",
        epilog=EPILOG,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    p = commands.add_parser("train", help="photographs to a model", description=train.__doc__, epilog=TRAIN_EXAMPLES)
    p.add_argument("data", metavar="DATA", help=_field_help()["data"])
    p.add_argument("-o", "--out", type=Path, required=True, metavar="RUN", help="run folder to write")
    flags = [field.name for field in dataclasses.fields(TrainConfig) if field.name != "data"]
    _add_config_flags(p, flags)
    p.add_argument("--resume", action="store_true", help="go on from the last checkpoint of RUN")
    p.set_defaults(run=train)

    p = commands.add_parser(
        "render",
        help="a model or Mitsuba scene to a picture",
        description=render.__doc__,
        epilog=RENDER_EXAMPLES,
    )
    p.add_argument("model", type=Path, metavar="MODEL_or_SCENE", help="model .ply or Mitsuba scene .xml")
    p.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=".png, or .exr with alpha and depth")
    p.add_argument("--data", metavar="DATA", help="data set whose views --camera names")
    p.add_argument("--camera", metavar="NAME_or_JSON", help="a view of DATA by name, or a camera JSON file")
    _add_config_flags(p, ["downscale", "background", "antialiased", "near_clip", "variant"])
    p.set_defaults(run=render)

    p = commands.add_parser(
        "eval",
        help="metrics of a model on the test split",
        description=evaluate.__doc__,
        epilog=EVAL_EXAMPLES,
    )
    p.add_argument("model", type=Path, metavar="MODEL", help="model .ply")
    p.add_argument("data", metavar="DATA", help=_field_help()["data"])
    p.add_argument("-o", "--out", type=Path, metavar="DIR", help="also write renders, error maps and metrics.json")
    _add_config_flags(p, ["downscale", "background", "antialiased", "near_clip", "variant"])
    p.set_defaults(run=evaluate)

    p = commands.add_parser(
        "info",
        help="what a file is and what is wrong with it",
        description=info.__doc__,
        epilog=INFO_EXAMPLES,
    )
    p.add_argument("file", type=Path, metavar="FILE", help="model .ply, run folder, or data set")
    p.set_defaults(run=info)
    return parser


def train(args: argparse.Namespace) -> None:
    """Train a model on photographs and measure it on those held out."""
    config = _config(args)
    _set_variant(config.variant)
    from tqdm import tqdm

    from .run import train as run_train

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


def render(args: argparse.Namespace) -> None:
    """Render a model from a view of a data set or from a camera file, or a Mitsuba scene as it stands."""
    _config(args)
    _set_variant(args.variant)
    from .render_files import render_model, render_scene

    if args.model.suffix.lower() == ".xml":
        render_scene(args.model, args.out)
    else:
        render_model(args)
    print(args.out)


def evaluate(args: argparse.Namespace) -> None:
    """PSNR, SSIM, FLIP and L1 of a model on the test views of a data set (all views without a split)."""
    _config(args)
    _set_variant(args.variant)
    from .datasets import load_dataset
    from .evaluate import evaluate_views, mean_metrics
    from .ply import read_ply
    from .render_files import picture_of
    from .run import prepare_folder, write_json
    from .train import background_color

    splats = read_ply(args.model)
    dataset = load_dataset(args.data, args.downscale)
    background = background_color(args.background, dataset.has_alpha)
    if args.out:
        if (args.out / "config.json").exists():
            raise DataError(args.out, "is a training run with metrics of its own", "name another folder")
        prepare_folder(args.out)
    picture = picture_of(splats, args, background)
    views = evaluate_views(lambda v: picture(v.camera), dataset.test or dataset.train, background, args.out)
    for name, values in views.items():
        print(f"{name:24s}", end="")
        print_metrics(values)
    print(f"{'mean':24s}", end="")
    print_metrics(mean_metrics(views))
    if args.out:
        write_json(args.out / "metrics.json", {"test": mean_metrics(views), "views": views, "n": splats.n_splats})


def info(args: argparse.Namespace) -> None:
    """Say what a file is: counts, ranges, and problems found."""
    if args.file.suffix == ".xml":
        _set_variant("auto")  # to render the sensors of a scene
    from .info import describe

    print("\n".join(describe(args.file)))


def _config(args: argparse.Namespace) -> TrainConfig:
    """The settings among the arguments, checked; raises ``DataError`` that names the flag."""
    names = {field.name for field in dataclasses.fields(TrainConfig)}
    given = {name: value for name, value in vars(args).items() if name in names}
    return TrainConfig(**{"data": "", **given})


def print_metrics(values: dict[str, float]) -> None:
    likeness = f"PSNR {values['psnr']:.2f} dB  SSIM {values['ssim']:.4f}"
    print(f"{likeness}  FLIP {values['flip']:.4f}  L1 {values['l1']:.5f}")


def _set_variant(name: str) -> None:
    """Choose the Mitsuba variant; raises ``DataError`` if it cannot be had."""
    import drjit as dr
    import mitsuba as mi

    from .llvm import explain, find_llvm

    available = mi.variants()
    if name == "auto":
        name = "cuda_ad_rgb" if "cuda_ad_rgb" in available and dr.has_backend(dr.JitBackend.CUDA) else "llvm_ad_rgb"
    if name not in available or not name.endswith("ad_rgb"):
        raise DataError("--variant", f'"{name}" cannot be used', "use auto, llvm_ad_rgb or cuda_ad_rgb")
    if name.startswith("cuda") and not dr.has_backend(dr.JitBackend.CUDA):
        raise DataError("--variant", "there is no usable CUDA GPU", "use --variant llvm_ad_rgb")
    if name.startswith("llvm") and find_llvm() is None:
        raise DataError("--variant", "no usable LLVM", explain())
    mi.set_variant(name)


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    args = build_parser().parse_args(argv)
    try:
        args.run(args)
    except DataError as error:
        print(f"dogsplat: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("mi_dogsplat"):
            raise
        print(f"dogsplat: this needs the package {error.name}: pip install 'mi_dogsplat[train]'", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("dogsplat: stopped before the end; nothing is half-written", file=sys.stderr)
        return 130
    return 0
