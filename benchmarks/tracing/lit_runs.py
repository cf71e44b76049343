"""What benchmarks in scenes of splats and surfaces have in common: their options, and rows of their tables."""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mi_dogsplat.editing.simplify import simplify_model
from mi_dogsplat.editing.simplify_config import SimplifyConfig
from mi_dogsplat.support.variants import set_variant

from .error_table import ErrorTable
from .lit_scenes import loaded, picture


def parser_of(name: str, description: str | None, size: tuple[int, int], truth: int) -> argparse.ArgumentParser:
    """Size of the pictures, samples of the truth, and variant."""
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks {name}", description=description)
    parser.add_argument("--size", nargs=2, type=int, default=size, metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--truth", type=int, default=truth, metavar="SPP")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    return parser


def contestants(parser: argparse.ArgumentParser) -> None:
    """Options that ``by_samples`` and ``by_primitives`` ask for."""
    parser.add_argument("--samples", nargs="+", type=int, default=[1, 4, 16, 64])
    parser.add_argument("--primitives", nargs="*", type=int, default=[2500, 1000])


def parsed(parser: argparse.ArgumentParser, argv: list[str]) -> argparse.Namespace:
    """The options; their variant is the active one from now on."""
    args = parser.parse_args(argv)
    args.size = args.size[0], args.size[1]
    set_variant(args.variant)
    return args


def by_samples(table: ErrorTable, args: argparse.Namespace, model: Any, meshes: Any, n: int) -> None:
    """Rows of a scene with a model of n primitives, and of the truth, by as many samples each."""
    for spp in args.samples:
        table.row("dogpath", spp, n, lambda seed, spp=spp: picture(model, spp, args.size, seed))
    for spp in args.samples:
        table.row("noise: path, meshes", spp, 0, lambda seed, spp=spp: picture(meshes, spp, args.size, seed))


def by_primitives(table: ErrorTable, args: argparse.Namespace, scene: Path, model: Path) -> None:
    """Rows of a scene with fewer primitives, those that ``dogsplat simplify`` merges a model to, without a fit."""
    most = max(args.samples)
    with TemporaryDirectory() as folder:
        for count in args.primitives:
            file = Path(folder) / f"{count}.ply"
            simplify_model(model, file, SimplifyConfig(target=str(count), steps=0))
            fewer = loaded(scene, file)
            table.row("dogpath", most, count, lambda seed, fewer=fewer: picture(fewer, most, args.size, seed))
