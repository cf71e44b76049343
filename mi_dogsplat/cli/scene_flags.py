"""Flags of commands that draw models or Mitsuba scenes: those of scenes, and what is said where they do not fit."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..render.picture_options import PictureOptions
from ..support.errors import DataError

if TYPE_CHECKING:
    from ..render.scene_to_draw import SceneOptions

FOR_SCENES = {
    "spp": ("a model is drawn with one sample", "leave it out, or render a scene .xml"),
    "denoise": ("a model has no noise", "leave it out"),
    "sensor": ("a model has no sensors", "leave it out"),
    "define": ("is only for parameters of a scene", "leave it out"),
}


def add_scene_flags(parser: argparse.ArgumentParser) -> None:
    """How a scene is drawn (``SceneOptions``)."""
    parser.add_argument(
        "--spp", type=int, default=0, metavar="N", help="samples per pixel of a scene (default: 0: what the scene says)"
    )
    parser.add_argument(
        "-s", "--sensor", type=int, default=0, metavar="N", help="sensor of a scene, counted from 0 (default: 0)"
    )
    parser.add_argument(
        "-D", "--define", action="append", default=[], metavar="NAME=VALUE", help="set $NAME, a parameter of a scene"
    )
    parser.add_argument(
        "--denoise", action="store_true", help="remove the noise of a scene's light paths (by Open Image Denoise)"
    )


def is_scene(file: Path) -> bool:
    """Whether a file is a Mitsuba scene by its name; others are models."""
    return file.suffix.lower() == ".xml"


def scene_options(args: argparse.Namespace, of_models: Sequence[str]) -> SceneOptions:
    """What the flags say of a scene. Raises ``DataError`` for arguments ``of_models`` that are given."""
    from ..render.scene_to_draw import SceneOptions  # of the active variant

    for name in of_models:
        if getattr(args, name) != getattr(PictureOptions(), name, None):
            flag = f"--{name.replace('_', '-')}"
            raise DataError(flag, "is only for models; a scene says itself how it is drawn", "leave it out")
    return SceneOptions(args.spp, args.denoise, args.sensor, dict(_definition(text) for text in args.define))


def require_no_scene_flags(args: argparse.Namespace) -> None:
    """Raise ``DataError`` for what is given and a model has no use for."""
    for name, (problem, remedy) in FOR_SCENES.items():
        if getattr(args, name):
            raise DataError(f"--{name}", problem, remedy)


def _definition(text: str) -> tuple[str, str]:
    """(name, value) of ``NAME=VALUE``."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise DataError("--define", f'"{text}" is not NAME=VALUE', "write it like -D spp=16")
    return name, value
