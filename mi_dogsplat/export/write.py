"""A model to a file of another format, and what that costs, measured on pictures; behind ``dogsplat export``."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..film.subject import MODEL as RUN_MODEL
from ..film.subject import read_subject
from ..formats.model import Model
from ..formats.read import read_model
from ..formats.table import SOG, format_to_write
from ..formats.write import SPZ_VERSIONS, write_model
from ..measure.metrics import psnr
from ..render.framing import NEAR_SHARE, cameras_around, robust_sphere
from ..render.picture import background_color, over_background
from ..render.picture_options import PictureOptions
from ..render.render_files import picture_of
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs, drawn_as
from ..scene.splats import Array, Splats
from ..support.errors import DataError
from .bake import baked
from .web_page import PAGE, opening_of, read_page, write_page

DOG_CHOICES = ("bake", "drop", "keep")


@dataclass(frozen=True)
class Views:
    """From where a loss is measured: cameras, and photographs [H, W, 3] if there are any."""

    cameras: list[Camera]
    photographs: list[Array]
    background: float
    near_clip: float
    antialiased: bool
    linear: bool = False

    def pictures(self, splats: Splats) -> list[Array]:
        """[H, W, 3] of each view."""
        how = self.background, self.near_clip
        picture = picture_of(splats, *how, antialiased=self.antialiased, linear=self.linear)
        return [picture(camera).color for camera in self.cameras]


def plain_gaussians(splats: Splats, dog: str) -> Splats:
    """The model without DoG, by a rule of ``DOG_CHOICES``: its nearest Gaussians, or its primaries alone."""
    return {"bake": baked, "drop": Splats.plain, "keep": lambda splats: splats}[dog](splats)


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
    """``n_splats``: primitives that were written; ``losses``: stage by stage, over ``n_views`` views.

    ``left_out``: a line for each thing that did not get into the file, or out of the one that was read.
    """

    n_splats: int
    n_views: int
    losses: list[Loss]
    left_out: list[str] = field(default_factory=list)


def export_model(
    model: str | Path,
    out: str | Path,
    dog: str = "bake",
    data: str | Path | None = None,
    views: int = 8,
    options: PictureOptions = PictureOptions(),
    spz_version: int = SPZ_VERSIONS[0],
) -> Exported:
    """Write a model file in the format that the name of ``out`` asks for, and measure what is lost.

    Args:
        model: the model, of any format.
        out: ends in one of ``formats.table.FORMATS``, or in .html: a page with a viewer inside.
        dog: what becomes of DoG, one of ``DOG_CHOICES`` (``plain_gaussians``); keep: only where the format knows them.
        data: a data set to compare with on its test views, from which a page opens; None: views from around the model.
        views: at most so many; 0 measures nothing.
        options: how the pictures are drawn; what they do not say, the model's file does.
        spz_version: of an SPZ file.

    Measuring needs a Mitsuba variant. Raises ``DataError``.
    """
    model, out = Path(model), Path(out)
    page = out.name.lower().endswith(PAGE)
    chosen = SOG if page else format_to_write(out, (PAGE,))
    if dog not in DOG_CHOICES or (dog == "keep" and not chosen.dog):
        problem = f'"{dog}" is unknown' if dog not in DOG_CHOICES else f"{chosen.name} has no room for DoG to keep"
        raise DataError("--dog", problem, "use bake or drop")
    if views < 0:
        raise DataError("--views", f"{views} is too small", "use at least 0")
    read = read_model(model)
    splats = read.splats
    drawing = options.drawing.over(read.drawing)
    if out.exists() and out.samefile(model):
        raise DataError(out, "is the model itself, which would be lost", "name another file")
    if splats.n_splats == 0:
        raise DataError(model, "the model is empty", "export one that has primitives")
    plain = plain_gaussians(splats, dog)
    left_out = [f"{model.name}: {line}" for line in read.left_out]
    written = replace(read, splats=plain, drawing=drawing)
    if page:
        left_out += _write_page(model, out, written, dog, data, options)
    else:
        left_out += write_model(out, written, spz_version)
    if not views:
        return Exported(plain.n_splats, 0, [], left_out)
    seen = _views(splats, data, views, options, drawn_as(drawing))
    stages = {"as it is": splats}
    if splats.n_dog and not plain.n_dog:
        stages[f"without DoG ({dog})"] = plain
    stages["read from the file"] = (read_page(out) if page else read_model(out)).splats
    return Exported(plain.n_splats, len(seen.cameras), losses(stages, seen), left_out)


def _write_page(
    model: Path, out: Path, written: Model, dog: str, data: str | Path | None, options: PictureOptions
) -> list[str]:
    """A page that opens as the model was photographed, where that is known; what is left out."""
    subject = read_subject(model, data, options)
    title = model.resolve().parent.name if model.name == RUN_MODEL else model.stem
    return write_page(out, written, opening_of(subject, title, dog))


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


def _views(splats: Splats, data: str | Path | None, count: int, options: PictureOptions, drawn: DrawnAs) -> Views:
    how = drawn.antialiased, drawn.linear
    if not data:
        near_clip = min(drawn.near_clip, NEAR_SHARE * robust_sphere(splats)[1])
        background = background_color(options.background, False)
        return Views(cameras_around(splats, count), [], background, near_clip, *how)
    from ..datasets import load_dataset  # here: it needs the extra "train"

    dataset = load_dataset(data, options.downscale)
    background = background_color(options.background, dataset.has_alpha)
    held_out = dataset.test or dataset.train
    views = held_out[:: -(-len(held_out) // count)]
    photographs = [over_background(view.image, background) for view in views]
    return Views([view.camera for view in views], photographs, background, drawn.near_clip, *how)
