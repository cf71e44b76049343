"""``dogsplat capture``: its flags, and what it shows meanwhile."""

from __future__ import annotations

import argparse
import dataclasses
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ..datasets.capture_config import CaptureConfig
from .field_help import field_help

FORMS: dict[str, dict[str, Any]] = {  # how argparse takes each flag
    "path": {"metavar": "NAME_or_JSON"},
    "views": {"type": int, "metavar": "N"},
    "test": {"type": int, "metavar": "N"},
    "size": {"type": int, "nargs": 2, "metavar": ("W", "H")},
    "fov": {"type": float, "metavar": "DEGREES"},
    "spp": {"type": int, "metavar": "N"},
    "seed": {"type": int, "metavar": "N"},
    "up": {"metavar": "AXIS"},
    "elevations": {"type": float, "nargs": 2, "metavar": ("LOW", "HIGH")},
    "zoom": {"type": float, "metavar": "X"},
    "center": {"type": float, "nargs": 3, "metavar": ("X", "Y", "Z")},
    "radius": {"type": float, "metavar": "R"},
    "downscale": {"type": int, "metavar": "K"},
    "alpha": {"action": "store_true"},
    "depth": {"metavar": "FORMAT"},
    "points": {"type": int, "metavar": "N"},
}


def add_capture_flags(parser: argparse.ArgumentParser) -> None:
    """A flag per field of ``CaptureConfig``."""
    texts = field_help(CaptureConfig)
    for field in dataclasses.fields(CaptureConfig):
        form = FORMS[field.name]
        default = " ".join(map(str, field.default)) if isinstance(field.default, tuple) else field.default
        shown = texts[field.name] + ("" if default is None or default is False else f" (default: {default})")
        parser.add_argument("--" + field.name, default=field.default, help=shown, **form)


def run_capture(args: argparse.Namespace) -> Path:
    """Fill the folder ``args.out`` from the scene ``args.scene`` while a bar shows how far it is."""
    from tqdm import tqdm

    from ..datasets.capture import capture

    given: dict[str, Any] = {}
    for field in dataclasses.fields(CaptureConfig):
        value = getattr(args, field.name)
        given[field.name] = tuple(value) if isinstance(value, list) else value
    config = CaptureConfig(**given)
    with ExitStack() as stack:
        bars: list[tqdm] = []  # none until the scene is loaded: an error before that is a single line

        def show(done: int, n: int, framing: str) -> None:
            if not bars:
                print(framing, flush=True)
                bars.append(stack.enter_context(tqdm(total=n, unit="view", dynamic_ncols=True)))
            bars[0].update(done - bars[0].n)

        return capture(args.scene, args.out, config, show)
