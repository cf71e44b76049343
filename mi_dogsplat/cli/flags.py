"""Flags that several commands share, and settings as flags: from the class to its flags, from the arguments to it."""

from __future__ import annotations

import argparse
import types
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NoReturn, TypeVar, Union, get_args, get_origin

from ..datasets.world import check_world
from ..render.picture_options import PictureOptions
from ..support.settings import settings_of
from ..training.config import TrainConfig

T = TypeVar("T")

DATA_HELP = settings_of(TrainConfig)["data"][1].help
MODEL_HELP = "model: .ply .spz .sog .glb .gltf .usd .usdz .splat, or meta.json of SOG"
METAVARS = {int: "N", float: "X", str: "NAME"}
OF_RUN = {
    name: settings_of(PictureOptions)[name][1].help.removesuffix(")") + "; for a run folder: as in its training)"
    for name in ("downscale", "background")
}
"""Help of what a command that takes run folders takes from them."""


class NoFlag(argparse.Action):
    """What other commands call ``--data``. argparse would take it for ``--data-on-disk``, silently."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        parser.error("argument --data: DATA stands without a flag here, as in the first example")


def add_data(parser: argparse.ArgumentParser, said: str = DATA_HELP, **options: Any) -> None:
    """The argument DATA of a command that cannot do without; ``options`` are those of ``add_argument``."""
    parser.add_argument("data", metavar="DATA", help=said, **options)
    parser.add_argument("--data", action=NoFlag, dest="no_flag", nargs="?", help=argparse.SUPPRESS)


def add_settings(
    parser: argparse.ArgumentParser, kind: type, names: list[str] | None = None, said: Mapping[str, str] = {}
) -> None:
    """A flag per setting of a class (``settings_of``), of all or of those that are named.

    said: help of those which mean something else, or more, in this command than the class says.
    """
    for name, (hint, setting) in settings_of(kind).items():
        if names is not None and name not in names:
            continue
        setting = replace(setting, help=said.get(name, setting.help))
        flag, default = "--" + name.replace("_", "-"), getattr(kind, name)
        value, count = _parsed(hint)
        if value is bool:  # with None, for what somebody else says, there is a --no-FLAG, too
            action = "store_true" if hint is bool else argparse.BooleanOptionalAction
            parser.add_argument(flag, action=action, help=setting.help)
            continue
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


def add_picture_flags(
    parser: argparse.ArgumentParser, *others: str, without: Sequence[str] = (), said: Mapping[str, str] = {}
) -> None:
    """How a model is drawn, ``without`` some of that, and ``others`` of a training; ``said`` as in ``add_settings``."""
    add_settings(parser, PictureOptions, [name for name in settings_of(PictureOptions) if name not in without], said)
    add_settings(parser, TrainConfig, [*others, "variant"])


def add_view_flags(parser: argparse.ArgumentParser) -> None:
    """From where a model is seen."""
    parser.add_argument("--data", metavar="DATA", help="data set whose views --camera names")
    view = "a view of DATA, by its name or image, or a camera file in JSON"
    parser.add_argument("--camera", metavar="NAME_or_JSON", help=view)


def given_settings(kind: type[T], args: argparse.Namespace, **others: Any) -> T:
    """Settings from the arguments that are called as they are, and from ``others``.

    Checked by the class, which raises a ``DataError`` that names the flag.
    """
    given = {name: value for name, value in vars(args).items() if name in settings_of(kind)}
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    return kind(**values | others)


def training_config(args: argparse.Namespace, **others: Any) -> TrainConfig:
    """The settings of a training among the arguments.

    ``model`` is the model of ``prune`` only: other commands have arguments of that name.
    """
    config = given_settings(TrainConfig, args, **{"model": None, **others})
    check_world(config.up, config.scale, config.unit)  # before poses are searched for; the settings of a run have both
    return config
