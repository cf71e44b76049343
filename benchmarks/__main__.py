"""Run benchmarks by name; all timings without arguments. Experiments take flags of their own: NAME --help."""

import argparse
import importlib
import sys
from typing import Any

from mi_dogsplat.cli.errors import one_line_errors
from mi_dogsplat.support.variants import set_variant

from .names import EXPERIMENTS, ROOM_OF, TIMINGS


def module(name: str) -> Any:
    return importlib.import_module(f"benchmarks.{ROOM_OF[name]}.{name}")


if sys.argv[1:] and sys.argv[1] in ROOM_OF and sys.argv[1] not in TIMINGS:
    program = f"python -m benchmarks {sys.argv[1]}"
    sys.exit(one_line_errors(lambda: module(sys.argv[1]).main(sys.argv[2:]), program=program))
parser = argparse.ArgumentParser(
    prog="python -m benchmarks",
    description=__doc__,
    epilog="\n".join(["experiments:", *(f"  {room}: {', '.join(names)}" for room, names in EXPERIMENTS.items())]),
    formatter_class=argparse.RawDescriptionHelpFormatter,
)
parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(TIMINGS)} (default: all)")
parser.add_argument("--variant", default="llvm_ad_rgb")
args = parser.parse_args()
if late := [name for name in args.names if name in ROOM_OF and name not in TIMINGS]:
    parser.error(f"{late[0]} is an experiment, which comes first, with its flags behind it: {late[0]} --help")
if unknown := sorted({*args.names} - {*TIMINGS}):
    parser.error(f"no benchmark is called {unknown[0]}: --help lists them")


def timings() -> None:
    set_variant(args.variant)
    for name in args.names or TIMINGS:
        print(f"# {name} ({args.variant})")
        module(name).main()


sys.exit(one_line_errors(timings, program="python -m benchmarks"))
