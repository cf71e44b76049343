"""A model to a file of another format, and what that costs, measured on pictures; behind ``dogsplat export``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..film.subject import MODEL as RUN_MODEL
from ..film.subject import read_subject
from ..formats import compressed_ply, gltf, sog, spz
from ..formats.packing import morton_order, turned_rub
from ..measure.metrics import psnr
from ..render.framing import NEAR_SHARE, cameras_around, robust_sphere
from ..render.picture import background_color, over_background
from ..render.picture_options import PictureOptions
from ..render.render_files import picture_of
from ..scene.cameras import Camera
from ..scene.ply import read_ply, write_ply
from ..scene.splats import Array, Splats
from ..support.errors import DataError
from ..support.files import replacing
from .bake import baked
from .web_page import Opening, opening_of, read_page, write_page

DOG_CHOICES = ("bake", "drop")
PAGE = ".html"


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
    PAGE: Format(lambda path, plain: write_page(path, plain, opening_of(plain, path.stem)), read_page),
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


@dataclass(frozen=True)
class Loss:
    """What a model has become on its way into a file, and its mean PSNR in dB; None where there is nothing to compare.

    ``of_model``: against pictures of the model as it was; ``of_photographs``: against the photographs of the data.
    """

    stage: str
    of_model: float | None
    of_photographs: float | None


@dataclass(frozen=True)
class Exported:
    """``n_splats``: primitives that were written; ``losses``: stage by stage, over ``n_views`` views."""

    n_splats: int
    n_views: int
    losses: list[Loss]


def export_model(
    model: str | Path,
    out: str | Path,
    dog: str = "bake",
    data: str | Path | None = None,
    views: int = 8,
    options: PictureOptions = PictureOptions(),
) -> Exported:
    """Write a model file in the format that the name of ``out`` asks for, and measure what is lost.

    Args:
        model: the model.
        out: ends in one of ``FORMATS``.
        dog: what becomes of DoG, one of ``DOG_CHOICES`` (``plain_gaussians``).
        data: a data set to compare with on its test views; None: on views from around the model.
        views: at most so many; 0 measures nothing.
        options: how the pictures are drawn.

    Measuring needs a Mitsuba variant. Raises ``DataError``.
    """
    model, out = Path(model), Path(out)
    chosen = format_of(out)
    if dog not in DOG_CHOICES:
        raise DataError("--dog", f'"{dog}" is unknown', f"use {' or '.join(DOG_CHOICES)}")
    if views < 0:
        raise DataError("--views", f"{views} is too small", "use at least 0")
    splats = read_ply(model)
    if out.exists() and out.samefile(model):
        raise DataError(out, "is the model itself, which would be lost", "name another file")
    if splats.n_splats == 0:
        raise DataError(model, "the model is empty", "export one that has primitives")
    plain = plain_gaussians(splats, dog)
    write(out, plain, _opening(model, splats, data, options) if out.name.lower().endswith(PAGE) else None)
    if not views:
        return Exported(plain.n_splats, 0, [])
    seen = _views(splats, data, views, options)
    stages = {"as it is": splats, f"without DoG ({dog})": plain} if splats.n_dog else {"as it is": splats}
    read = chosen.read(out)
    stages["read from the file"] = turned_rub(read) if chosen.rub else read
    return Exported(plain.n_splats, len(seen.cameras), losses(stages, seen))


def write(out: Path, plain: Splats, opening: Opening | None = None) -> None:
    """Write a model of plain Gaussians, in the axes of 3DGS PLY, in the format of the name. Raises ``DataError``.

    ``opening``: how a page shows it at first; None: framed whole.
    """
    chosen = format_of(out)
    if chosen.sorted:
        plain = plain.select(morton_order(plain.means))
    if opening:
        write_page(out, plain, opening)
    else:
        chosen.write(out, turned_rub(plain) if chosen.rub else plain)


def _opening(model: Path, splats: Splats, data: str | Path | None, options: PictureOptions) -> Opening:
    """How a page shows a model at first: as it was photographed, where that is known."""
    subject = read_subject(model, data, options)
    title = model.resolve().parent.name if model.name == RUN_MODEL else model.stem
    return opening_of(splats, title, subject.cameras, background=subject.background, antialiased=subject.antialiased)


def losses(stages: dict[str, Splats], views: Views) -> list[Loss]:
    """Of each stage, against the first one and against the photographs."""
    reference = views.pictures(next(iter(stages.values())))
    found = []
    for number, (name, splats) in enumerate(stages.items()):
        pictures = views.pictures(splats) if number else reference
        of_photographs = mean_psnr(pictures, views.photographs) if views.photographs else None
        found.append(Loss(name, mean_psnr(pictures, reference) if number else None, of_photographs))
    return found


def mean_psnr(pictures: list[Array], truth: list[Array]) -> float:
    """Mean over pairs of pictures, in dB."""
    return float(np.mean([psnr(a, b) for a, b in zip(pictures, truth, strict=True)]))


def _views(splats: Splats, data: str | Path | None, count: int, options: PictureOptions) -> Views:
    if not data:
        near_clip = min(options.near_clip, NEAR_SHARE * robust_sphere(splats)[1])
        background = background_color(options.background, False)
        return Views(cameras_around(splats, count), [], background, near_clip, options.antialiased)
    from ..datasets import load_dataset  # here: it needs the extra "train"

    dataset = load_dataset(data, options.downscale)
    background = background_color(options.background, dataset.has_alpha)
    held_out = dataset.test or dataset.train
    views = held_out[:: -(-len(held_out) // count)]
    photographs = [over_background(view.image, background) for view in views]
    return Views([view.camera for view in views], photographs, background, options.near_clip, options.antialiased)


def _write_bytes(path: Path, content: bytes) -> None:
    try:
        with replacing(path) as part:
            part.write_bytes(content)
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        raise DataError(path, problem, "check that the folder exists and is writable") from error
