"""Arguments of the command ``dogsplat``: flags, their help, and how wrong use is reported."""

from __future__ import annotations

import argparse
import types
from pathlib import Path
from typing import Any, NoReturn, Union, get_args, get_origin

from ..check import PARTS
from ..compare.names import ABLATION, ALL, PUBLISHED, SETS
from ..datasets.capture_config import CaptureConfig
from ..editing.clean_config import CleanConfig
from ..editing.simplify_config import SimplifyConfig
from ..film.film_config import FilmConfig
from ..formats.table import FORMATS
from ..poses.config import PosesConfig
from ..render.picture_options import PictureOptions
from ..support.settings import settings_of
from ..training.config import TrainConfig
from .help import (
    ABLATE_EXAMPLES,
    CAPTURE_EXAMPLES,
    CHECK_EXAMPLES,
    CLEAN_EXAMPLES,
    COMPARE_EXAMPLES,
    EPILOG,
    EVAL_EXAMPLES,
    EXPORT_EXAMPLES,
    FILM_EXAMPLES,
    INFO_EXAMPLES,
    POSES_EXAMPLES,
    PRUNE_EXAMPLES,
    RENDER_EXAMPLES,
    SIMPLIFY_EXAMPLES,
    TRAIN_EXAMPLES,
    VIEW_EXAMPLES,
)

DATA_HELP = settings_of(TrainConfig)["data"][1].help
DOG_HELP = "DoG: bake (nearest Gaussians), drop, or keep where the format knows them (default: bake)"
ABLATE_FLAGS = [
    *("steps", "target", "downscale", "max_primitives", "max_world_scale", "split", "sh_degree"),
    *("background", "antialiased", "near_clip", "initial_primitives", "variant", "log_every", "test_every", "memory"),
    "checkpoint_seconds",
]
MODEL_HELP = "model: .ply .spz .sog .glb .gltf .splat, or meta.json of SOG"
METAVARS = {int: "N", float: "X", str: "NAME"}
PRUNE_FLAGS = [
    *("preset", "steps", "target", "format", "batch_views", "downscale", "split", "background"),
    *("near_zone", "masks", "exposure", "data_on_disk", "seed", "variant", "log_every", "test_every"),
    *("memory", "checkpoint_seconds"),
]


class Parser(argparse.ArgumentParser):
    """Wrong use is one line on stderr, as every other error; the help is shown as it is written."""

    def __init__(self, **options):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"dogsplat: {message}; see {self.prog} --help\n")


class Version(argparse.Action):
    """``--version``: looked up when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from ..support.versions import versions  # here: what it imports takes a hundredth of a second

        found = versions()
        print("dogsplat", found.pop("mi_dogsplat") + "".join(f", {name} {value}" for name, value in found.items()))
        parser.exit()


def _add_settings(parser: argparse.ArgumentParser, kind: type, names: list[str] | None = None) -> None:
    """A flag per setting of a class (``settings_of``), of all or of those that are named."""
    for name, (hint, setting) in settings_of(kind).items():
        if names is not None and name not in names:
            continue
        flag, default = "--" + name.replace("_", "-"), getattr(kind, name)
        if hint is bool:
            parser.add_argument(flag, action="store_true", help=setting.help)
            continue
        if _parsed(hint)[0] is bool:  # with None, for what somebody else says
            parser.add_argument(flag, action=argparse.BooleanOptionalAction, help=setting.help)
            continue
        value, count = _parsed(hint)
        metavar: Any = setting.metavar or METAVARS[value]
        text = " ".join(map(str, default)) if isinstance(default, tuple) else default
        options: dict[str, Any] = {"nargs": count, "metavar": tuple(metavar.split())} if count else {"metavar": metavar}
        shown = (setting.help + ("" if default is None else f" (default: {text})")).replace("%", "%%")
        parser.add_argument(flag, type=value, default=default, help=shown, **options)


def _parsed(hint: Any) -> tuple[type, int]:
    """How a type is read from words: (that of each word, how many there are; 0 if it is no tuple)."""
    if get_origin(hint) in (Union, types.UnionType):  # with None
        hint = get_args(hint)[0]
    return (get_args(hint)[0], len(get_args(hint))) if get_origin(hint) is tuple else (hint, 0)


def _add_picture_flags(parser: argparse.ArgumentParser, *others: str) -> None:
    """How a model is drawn, and ``others`` of a training."""
    _add_settings(parser, PictureOptions)
    _add_settings(parser, TrainConfig, [*others, "variant"])


def _add_view_flags(parser: argparse.ArgumentParser) -> None:
    """From where a model is seen."""
    parser.add_argument("--data", metavar="DATA", help="data set whose views --camera names")
    parser.add_argument("--camera", metavar="NAME_or_JSON", help="a view of DATA by name, or a camera JSON file")


def build_parser(descriptions: dict[str, str]) -> argparse.ArgumentParser:
    """Subcommands, each with its description."""
    parser = Parser(
        prog="dogsplat",
        description="Small, sharp, differentiable radiance fields in Mitsuba 3.",
        epilog=EPILOG,
    )
    parser.add_argument("--version", action=Version, nargs=0, help="versions of the package and of what it stands on")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, summary: str, examples: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=summary, description=descriptions[name], epilog=examples)

    p = command("train", "photographs to a model", TRAIN_EXAMPLES)
    p.add_argument("data", metavar="DATA", help=DATA_HELP)
    p.add_argument("-o", "--out", type=Path, required=True, metavar="RUN", help="run folder to write")
    _add_settings(p, TrainConfig, [name for name in settings_of(TrainConfig) if name not in ("data", "model")])
    p.add_argument("--resume", action="store_true", help="go on from the last checkpoint of RUN")

    p = command("prune", "a smaller model of one that exists", PRUNE_EXAMPLES)
    p.add_argument("model", metavar="MODEL", help=MODEL_HELP)
    p.add_argument("data", metavar="DATA", help=DATA_HELP)
    p.add_argument("-o", "--out", type=Path, required=True, metavar="RUN", help="run folder to write")
    _add_settings(p, TrainConfig, PRUNE_FLAGS)
    _add_settings(p, PictureOptions, ["antialiased", "near_clip"])
    p.add_argument("--resume", action="store_true", help="go on from the last checkpoint of RUN")

    p = command("ablate", "what each part of the method contributes", ABLATE_EXAMPLES)
    p.add_argument("data", metavar="DATA", help=DATA_HELP)
    p.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder to write, or to add to")
    p.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="random seeds (default: 0 1 2)")
    p.add_argument("--only", nargs="+", default=list(ABLATION), metavar="NAME", help=f"of {' '.join(ABLATION)}")
    _add_settings(p, TrainConfig, ABLATE_FLAGS)

    p = command("compare", "several methods under one budget, in one table", COMPARE_EXAMPLES)
    p.add_argument("data", nargs="+", metavar="DATA", help=DATA_HELP)
    p.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder to write, or to go on with")
    p.add_argument("--seeds", type=int, nargs="+", default=[0], metavar="N", help="random seeds (default: 0)")
    methods = f"of {' '.join(ALL)}, or sets: {' '.join(SETS)} (default: published)"
    p.add_argument("--only", nargs="+", default=list(PUBLISHED), metavar="NAME", help=methods)
    more = "targets beside --target, for the tables of equal bytes and time"
    p.add_argument("--more-targets", type=float, nargs="+", default=[], metavar="X", help=more)
    p.add_argument("--cluster", metavar="ADDRESS", help="of a Dask scheduler, as tcp://10.0.0.7:8786")
    p.add_argument(
        "--workers", type=int, default=0, metavar="N", help="runs at a time, on this machine (default: 0: no Dask)"
    )
    _add_settings(p, TrainConfig, ABLATE_FLAGS)

    p = command("render", "a model or Mitsuba scene to a picture", RENDER_EXAMPLES)
    p.add_argument("model", type=Path, metavar="MODEL_or_SCENE", help=f"{MODEL_HELP}; or Mitsuba scene .xml")
    p.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=".png; .exr or .npz with alpha, depth")
    _add_view_flags(p)
    p.add_argument("--aovs", metavar="NAMES", help="channels of an .exr beside colour and alpha (default: depth)")
    _add_picture_flags(p)

    p = command("eval", "metrics of a model on the test split", EVAL_EXAMPLES)
    p.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    p.add_argument("data", metavar="DATA", help=DATA_HELP)
    p.add_argument("-o", "--out", type=Path, metavar="DIR", help="also write renders, error maps and metrics.json")
    p.add_argument("--color-correct", action="store_true", help="also PSNR after each view's best colour map")
    _add_picture_flags(p, "masks", "data_on_disk")

    p = command("capture", "any Mitsuba scene into a training set", CAPTURE_EXAMPLES)
    p.add_argument("scene", type=Path, metavar="SCENE.xml", help="Mitsuba scene")
    p.add_argument("-o", "--out", type=Path, required=True, metavar="DATA", help="folder to write, or to go on with")
    _add_settings(p, CaptureConfig)
    _add_settings(p, TrainConfig, ["variant"])

    p = command("poses", "photographs or a video into a training set", POSES_EXAMPLES)
    p.add_argument("source", type=Path, metavar="INPUT", help="folder of images, or a video")
    p.add_argument("-o", "--out", type=Path, required=True, metavar="DATA", help="folder to write, or to go on with")
    _add_settings(p, PosesConfig)

    p = command("check", "numerics: error against float64 and run time, extreme inputs", CHECK_EXAMPLES)
    p.add_argument("model", type=Path, nargs="?", metavar="MODEL", help="model to measure as well")
    p.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder for check.html and check.json")
    p.add_argument("--only", nargs="+", metavar="PART", help=f"of {' '.join(PARTS)} (default: all that can be run)")
    p.add_argument("--runs", type=Path, nargs="+", default=[], metavar="RUN", help="run folders, for training")
    _add_view_flags(p)
    p.add_argument("--width", type=int, default=256, metavar="N", help="of the pictures, in pixels (default: 256)")
    p.add_argument("--rounds", type=int, default=9, metavar="N", help="timings of each setting (default: 9)")
    _add_picture_flags(p)

    p = command("export", "a model in the format of another program", EXPORT_EXAMPLES)
    p.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    p.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join((*FORMATS, ".html")))
    p.add_argument("--dog", default="bake", metavar="HOW", help=DOG_HELP)
    p.add_argument("--spz-version", type=int, default=3, metavar="N", help="of an .spz: 3 or 4 (default: 3)")
    p.add_argument("--data", metavar="DATA", help="measure the loss on its test views, against its photographs too")
    p.add_argument("--views", type=int, default=8, metavar="N", help="views to measure on; 0: none (default: 8)")
    _add_picture_flags(p)

    p = command("film", "a model along a camera path, to a video or pictures", FILM_EXAMPLES)
    p.add_argument("model", type=Path, metavar="MODEL_or_RUN", help=f"{MODEL_HELP}; or run folder")
    p.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=".mp4, FOLDER, FOLDER/%%04d.exr")
    p.add_argument("--data", metavar="DATA", help="data set whose cameras the path follows (default: that of the run)")
    _add_settings(p, FilmConfig)
    _add_settings(p, PictureOptions, ["background", "antialiased", "near_clip", "linear"])
    _add_settings(p, TrainConfig, ["variant"])

    p = command("simplify", "fewer primitives, without photographs", SIMPLIFY_EXAMPLES)
    p.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    p.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join(FORMATS))
    _add_settings(p, SimplifyConfig)
    _add_settings(p, PictureOptions, ["background", "antialiased", "near_clip"])
    _add_settings(p, TrainConfig, ["variant"])

    p = command("clean", "a model without what it does not need, or what you do not want", CLEAN_EXAMPLES)
    p.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    p.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join(FORMATS))
    _add_settings(p, CleanConfig)
    p.add_argument("--data", metavar="DATA", help="for --seen, --floaters, and PSNR on photographs before and after")
    p.add_argument("--preview", type=Path, metavar="OUT.png", help="also write a picture of before and after")
    _add_picture_flags(p)

    p = command("view", "a model, or a run while it trains, in the browser", VIEW_EXAMPLES)
    p.add_argument("model", type=Path, metavar="MODEL_or_RUN", help=f"{MODEL_HELP}; or run folder")
    p.add_argument("--data", metavar="DATA", help="photographs to compare with (default: those of the run)")
    p.add_argument("--host", default="127.0.0.1", metavar="NAME", help="address to listen on (default: 127.0.0.1)")
    p.add_argument("--port", type=int, default=8080, metavar="N", help="port to listen on (default: 8080)")
    _add_picture_flags(p)

    p = command("info", "what a file is and what is wrong with it", INFO_EXAMPLES)
    p.add_argument("file", type=Path, metavar="FILE", help=f"{MODEL_HELP}; run folder, or data set")
    p.add_argument("--features", action="store_true", help="what the kernels need for it, at what cost, and leave out")
    return parser
