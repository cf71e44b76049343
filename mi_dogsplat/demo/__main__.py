"""The main job on a scene that ships. Path-traces a small training set, trains a compact model on it, and writes a
report and a picture of the truth beside the model.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..cli.errors import one_line_errors
from ..support.variants import set_variant


def main(argv: list[str] | None = None) -> int:
    """Entry point of ``make demo``; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m mi_dogsplat.demo", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("demo"), help="folder to write")
    parser.add_argument("--steps", type=int, default=3000, help="training steps")
    parser.add_argument("--target", type=int, default=10_000, help="primitives of the compact model")
    parser.add_argument("--views", type=int, default=48, help="training views to render")
    parser.add_argument("--size", type=int, default=256, help="their width and height in pixels")
    parser.add_argument("--picture", type=Path, help="where truth and model are shown (default: OUT/demo.png)")
    parser.add_argument("--variant", default="auto", help="Mitsuba variant (default: auto)")
    args = parser.parse_args(argv)

    def run() -> None:
        set_variant(args.variant)
        from .tour import tour  # here: it needs the extra "train"

        picture = args.picture or args.out / "demo.png"
        tour(args.out, args.steps, args.target, args.views, args.size, picture)

    return one_line_errors(run, program="demo")


if __name__ == "__main__":
    sys.exit(main())
