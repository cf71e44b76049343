"""The command ``dogsplat`` (= ``python -m mi_dogsplat``): from the words on the command line to the exit status."""

from __future__ import annotations

from ..support.starting import raise_when_interrupted
from .commands import COMMANDS
from .errors import one_line_errors, quiet_pipe
from .parser import build_parser
from .streams import discard_unread, open_closed_streams, print_every_character

# of pyproject.toml, named as the commands that need them; the others need "train"
EXTRAS = ("export", "film", "mesh", "poses", "view")


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit status."""

    def run() -> int:
        args = build_parser().parse_args(argv)
        extra = args.command if args.command in EXTRAS else "train"

        def command() -> int | None:
            raise_when_interrupted()  # here, where it is caught
            return COMMANDS[args.command].run(args)

        return one_line_errors(command, extra)

    open_closed_streams()
    print_every_character()
    status = quiet_pipe(run)
    discard_unread()
    return status
