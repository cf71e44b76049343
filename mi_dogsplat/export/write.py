"""``dogsplat export``: a model to a file of another format, and what that costs, measured on pictures."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..measure.metrics import psnr
from ..render.framing import NEAR_SHARE, cameras_around, robust_sphere
from ..render.picture import background_color, over_background
from ..render.render_files import picture_of
from ..scene.cameras import Camera
from ..scene.ply import read_ply, write_ply
from ..scene.splats import Array, Splats
from ..support.errors import DataError
from ..support.files import replacing
from . import compressed_ply, gltf, sog, spz
from .bake import baked
from .packing import morton_order, turned_rub

DOG_CHOICES = ("bake", "drop")


@dataclass(frozen=True)
class Format:
    """How a model of plain Gaussians becomes a file, and back; ``rub``: with y up, unlike PLY; ``sorted``: in space."""

    write: Callable[[Path, Splats], None]
    read: Callable[[Path], Splats]
    rub: bool = False
    sorted: bool = True


def _bytes_of(encode: Callable[[Splats], bytes]) -> Callable[[Path, Splats], None]:
    return lambda path, splats: _write_bytes(path, encode(splats))


FORMATS = {  # by the end of the file's name; the longer one first
    ".compressed.ply": Format(_bytes_of(compressed_ply.encode), compressed_ply.decode),
    ".ply": Format(write_ply, read_ply, sorted=False),
    ".spz": Format(_bytes_of(spz.encode), spz.decode, rub=True),
    ".sog": Format(_bytes_of(sog.encode), sog.decode),
    ".glb": Format(_bytes_of(gltf.encode), gltf.decode, rub=True, sorted=False),
}


@dataclass(frozen=True)
class Views:
    """From where a loss is measured: cameras, and photographs [H, W, 3] if there are any."""

    cameras: list[Camera]
    photographs: list[Array]
    background: float
    near_clip: float
    antialiased: bool

    def pictures(self, splats: Splats) -> list[Array]:
        """[H, W, 3] of each view."""
        picture = picture_of(splats, self.background, self.near_clip, antialiased=self.antialiased)
        return [picture(camera).color for camera in self.cameras]


def format_of(out: Path) -> Format:
    """The format that the name of a file asks for. Raises ``DataError``."""
    for suffix, chosen in FORMATS.items():
        if out.name.lower().endswith(suffix):
            return chosen
    raise DataError(out, "no known format", f"name a file that ends in {', '.join(FORMATS)}")


def plain_gaussians(splats: Splats, dog: str) -> Splats:
    """The model without DoG, by a rule of ``DOG_CHOICES``: its nearest Gaussians, or its primaries alone."""
    return baked(splats) if dog == "bake" else splats.plain()


def export(args: argparse.Namespace, show: Callable[[str], None] = print) -> None:
    """Write ``args.model`` to ``args.out`` and show what is lost, as PSNR over views. Raises ``DataError``.

    ``args.dog``: see ``plain_gaussians``. ``args.views``: at most so many views are compared, none if 0; those of
    ``args.data`` with its photographs, else from around the model. ``downscale``, ``background``, ``near_clip`` and
    ``antialiased`` are those of the pictures.
    """
    chosen = format_of(args.out)
    if args.dog not in DOG_CHOICES:
        raise DataError("--dog", f'"{args.dog}" is unknown', f"use {' or '.join(DOG_CHOICES)}")
    splats = read_ply(args.model)
    if args.out.exists() and args.out.samefile(args.model):
        raise DataError(args.out, "is the model itself, which would be lost", "name another file")
    if splats.n_splats == 0:
        raise DataError(args.model, "the model is empty", "export one that has primitives")
    plain = plain_gaussians(splats, args.dog)
    write(args.out, plain)
    if args.views:
        views = _views(args, splats)
        stages = {"as it is": splats, f"without DoG ({args.dog})": plain} if splats.n_dog else {"as it is": splats}
        read = chosen.read(args.out)
        stages["read from the file"] = turned_rub(read) if chosen.rub else read
        for line in loss_table(stages, views):
            show(line)
    megabytes, before = args.out.stat().st_size / 1e6, args.model.stat().st_size / 1e6
    show(f"{args.out}: {plain.n_splats:,} primitives, {megabytes:.2f} MB; {args.model.name} has {before:.2f} MB")


def write(out: Path, plain: Splats) -> None:
    """Write a model of plain Gaussians, in the axes of 3DGS PLY, in the format of the name. Raises ``DataError``."""
    chosen = format_of(out)
    if chosen.sorted:
        plain = plain.select(morton_order(plain.means))
    chosen.write(out, turned_rub(plain) if chosen.rub else plain)


def loss_table(stages: dict[str, Splats], views: Views) -> list[str]:
    """Lines: mean PSNR of each stage against the first, and against the photographs."""
    reference = views.pictures(next(iter(stages.values())))
    lines = [f"PSNR over {len(views.cameras)} views{'':6s}of the model" + "   of photographs" * bool(views.photographs)]
    for number, (name, splats) in enumerate(stages.items()):
        pictures = views.pictures(splats) if number else reference
        columns = [f"{mean_psnr(pictures, reference):6.2f} dB" if number else f"{'-':>6s}   "]
        if views.photographs:
            columns.append(f"{mean_psnr(pictures, views.photographs):6.2f} dB")
        lines.append(f"  {name:24s}" + "       ".join(columns).rstrip())
    return lines


def mean_psnr(pictures: list[Array], truth: list[Array]) -> float:
    """Mean over pairs of pictures, in dB."""
    return float(np.mean([psnr(a, b) for a, b in zip(pictures, truth, strict=True)]))


def _views(args: argparse.Namespace, splats: Splats) -> Views:
    if not args.data:
        near_clip = min(args.near_clip, NEAR_SHARE * robust_sphere(splats)[1])
        background = background_color(args.background, False)
        return Views(cameras_around(splats, args.views), [], background, near_clip, args.antialiased)
    from ..datasets import load_dataset  # here: it needs the extra "train"

    dataset = load_dataset(args.data, args.downscale)
    background = background_color(args.background, dataset.has_alpha)
    held_out = dataset.test or dataset.train
    views = held_out[:: -(-len(held_out) // args.views)]
    photographs = [over_background(view.image, background) for view in views]
    return Views([view.camera for view in views], photographs, background, args.near_clip, args.antialiased)


def _write_bytes(path: Path, content: bytes) -> None:
    try:
        with replacing(path) as part:
            part.write_bytes(content)
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise DataError(path, problem, "check that the folder exists and is writable") from error
