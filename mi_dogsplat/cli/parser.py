"""The parser of ``dogsplat``: its commands, what its help says, and how wrong use is reported."""

from __future__ import annotations

import argparse
import re
from typing import Any, NoReturn

from .commands import COMMANDS

EPILOG = """
A first run:
  dogsplat train photos/ -o run --downscale 2 --steps 7000 --max-primitives 60000
  dogsplat info run/point_cloud.ply
  dogsplat render run/point_cloud.ply -o view.png --data photos/ --camera 0001

photos/ is a COLMAP folder (images/ and sparse/0), a folder with transforms.json (instant-ngp, nerfstudio) or
transforms_train.json (NeRF synthetic), or a Mitsuba scene XML. For plain images or a video, poses are found
first, as dogsplat poses does. run/report.html shows how the training went.
Exit codes: 0: done. 2: wrong use or bad input; one line says what to do. 1: dogsplat check found a defect, or
a run of dogsplat compare failed. 130: stopped by Ctrl-C. 143: stopped by SIGTERM. 129: terminal closed.
"""


NEGATIVE = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$", re.IGNORECASE)  # argparse knows -0.5, but no -5e-1, nor -5.


class Parser(argparse.ArgumentParser):
    """Wrong use is one line on stderr, as every other error; the help is shown as it is written."""

    def __init__(self, **options):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)
        self._negative_number_matcher = NEGATIVE  # what it matches is a value, and no flag

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"dogsplat: {message}; see {self.prog} --help\n")


class CommandParser(Parser):
    """That of one command, which says itself what it does not know: its own help tells what it does."""

    def parse_known_args(self, *args: Any, **options: Any) -> tuple[Any, list[str]]:
        known, unknown = super().parse_known_args(*args, **options)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return known, unknown


class Version(argparse.Action):
    """``--version``: looked up when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from ..support.versions import versions  # here: what it imports takes a hundredth of a second

        found = versions()
        print("dogsplat", found.pop("mi_dogsplat") + "".join(f", {name} {value}" for name, value in found.items()))
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """All of ``COMMANDS``, each with its arguments; ``command`` of what is parsed is the name of one."""
    parser = Parser(
        prog="dogsplat",
        description="Small, sharp, differentiable radiance fields in Mitsuba 3.",
        epilog=EPILOG,
    )
    versions = "show the versions of the package and of what it depends on"
    parser.add_argument("--version", action=Version, nargs=0, help=versions)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=CommandParser)
    for name, command in COMMANDS.items():
        texts = {"help": command.SUMMARY, "description": command.run.__doc__, "epilog": command.EXAMPLES}
        command.add_arguments(commands.add_parser(name, **texts))
    return parser
