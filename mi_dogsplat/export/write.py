"""A model to a file of another format, and what that costs, measured on pictures; behind ``dogsplat export``."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..datasets import load_dataset
from ..datasets.world_config import WorldConfig
from ..film.subject import read_subject
from ..formats.coded import snapped
from ..formats.model import Model
from ..formats.read import read_model, read_source
from ..formats.table import SOG, Format, format_to_write
from ..formats.upright import upright
from ..formats.write import SPZ_VERSIONS, require_spz_version, write_model
from ..render.picture_options import PictureOptions
from ..report.run_folder import MODEL
from ..scene.drawing import DrawnAs, drawn_as
from ..scene.radiance import brightened
from ..scene.splats import Splats
from ..scene.transform import transformed
from ..scene.whole import whole
from ..support.errors import DataError
from ..support.wording import count
from .bake import baked
from .losses import Loss, losses, views_of
from .refine import goal_of, refined, steps_for
from .web_page import PAGE, opening_of, read_page, write_page

SMALL = {"SPZ": "spz", "SOG": "sog"}  # of the formats that have coarse grids, their names there
DOG_CHOICES, KEPT_OR_NOT = ("bake", "drop", "keep"), ("drop", "keep")


def plain_gaussians(splats: Splats, dog: str) -> Splats:
    """The model without DoG, by a rule of ``DOG_CHOICES``: its nearest Gaussians, or its primaries alone."""
    return {"bake": baked, "drop": Splats.plain, "keep": lambda splats: splats}[dog](splats)


@dataclass(frozen=True)
class Exported:
    """``n_splats``: primitives that were written; ``losses``: stage by stage, over ``n_views`` views.

    ``left_out``: a line for each thing that did not get into the file, or out of the one that was read.
    ``refine_seconds``: what the steps towards pictures took; None where nothing was done.
    """

    n_splats: int
    n_views: int
    losses: list[Loss]
    left_out: list[str] = field(default_factory=list)
    refine_seconds: float | None = None


def export_model(
    model: str | Path,
    out: str | Path,
    dog: str = "bake",
    data: str | Path | None = None,
    views: int = 8,
    options: PictureOptions = PictureOptions(),
    spz_version: int = SPZ_VERSIONS[0],
    refine: int | None = None,
    show: Callable[[int, int], None] | None = None,
    small: bool = False,
    world: WorldConfig = WorldConfig(),
    slopes: str = "drop",
    cuts: str = "drop",
) -> Exported:
    """Write a model file in the format that the name of ``out`` asks for, and measure what is lost.

    Args:
        model: the model, of any format.
        out: ends in one of ``formats.table.FORMATS``, or in .html: a page with a viewer inside.
        dog: what becomes of DoG, one of ``DOG_CHOICES`` (``plain_gaussians``); keep: only where the format knows them.
        data: a data set: it is refined on its training views, compared with on its test views, and a page opens from
            one; None: views from around the model.
        views: at most so many; 0 measures nothing.
        options: how the pictures are drawn; what they do not say, the model's file does.
        spz_version: of an SPZ file.
        refine: steps that make up for DoG, slopes and cuts that were taken out (``refine.py``); None: ``steps_for`` the
            data set where there were any, DoG not dropped, and a Mitsuba variant is set.
        show: called with the steps of it that are done, and how many there are.
        small: coarse grids and a palette, for which the model is refined too (docs/quantisation.md); SPZ and SOG.
        world: what is up, and how long a unit is, where the model's file is not to say so.
        slopes: what becomes of colours that vary over their primitive, one of ``KEPT_OR_NOT``; drop: mean colours,
            which are the nearest; keep: only where the format knows them.
        cuts: what becomes of primitives that a plane cuts off, likewise; drop: the whole ones nearest to them.

    Measuring and refining need a Mitsuba variant. Raises ``DataError``.
    """
    model, out = Path(model), Path(out)
    page = out.name.lower().endswith(PAGE)
    chosen = SOG if page else format_to_write(out, (PAGE,))
    _require(chosen, dog, {"--slopes": slopes, "--cuts": cuts}, small, world, views)
    require_spz_version(out, chosen, spz_version)
    read = read_source(model, out, "export")
    splats = read.splats
    drawing = world.over(options.drawing.over(read.drawing), data)
    if not out.parent.is_dir():  # said before what takes long
        raise DataError(out, "cannot be written (there is no such folder)", "make it, or name another one")
    stages = _stages(splats, dog, slopes, cuts)
    plain = list(stages.values())[-1]
    steps, drawn, seconds = _steps(refine, dog, plain is not splats, small), drawn_as(drawing), None
    grids = SMALL[chosen.name] if small else None
    dataset = load_dataset(data, options.downscale) if data and (steps != 0 or views) else None
    steps = steps_for(dataset) if steps is None else steps
    if steps:
        start = time.perf_counter()
        goal = goal_of(splats, dataset, steps, options, drawn, drawing.up)
        plain = stages[f"refined, {steps} steps"] = refined(plain, goal, steps, show, grids)
        seconds = time.perf_counter() - start
    elif grids:
        plain = stages["on the grids of a small file"] = _on_grids(plain, grids, drawn)
    left_out = [f"{model.name}: {line}" for line in read.left_out]
    if "without cuts" in stages:
        left = f"the cuts of {count(splats.n_cuts)} primitives are left out, for the whole ones nearest to them"
        left_out.append(left + ("; --cuts keep keeps them" if chosen.cuts else ""))
    if "without slopes" in stages:
        left = f"the slopes of {count(splats.n_slopes)} primitives are left out, which have their mean colours"
        left_out.append(left + ("; --slopes keep keeps them" if chosen.slopes else ""))
    written, matrix = replace(read, splats=plain, drawing=drawing), np.eye(4)
    if world.upright and not page:  # a page is always upright
        written, matrix = upright(written)
    if page:
        left_out += _write_page(model, out, written, dog, data, options)
    else:
        left_out += write_model(out, written, spz_version)
    if not views:
        return Exported(plain.n_splats, 0, [], left_out, seconds)
    seen = views_of(splats, dataset, views, options, drawn, drawing.up)
    again = (read_page(out) if page else read_model(out)).splats
    stages["read from the file"] = transformed(again, np.linalg.inv(matrix))
    return Exported(plain.n_splats, len(seen.cameras), losses(stages, seen), left_out, seconds)


def _require(chosen: Format, dog: str, kept: dict[str, str], small: bool, world: WorldConfig, views: int) -> None:
    """Raise ``DataError`` for what does not go with the format that is written, or with the rest.

    ``kept``: flag to one of ``KEPT_OR_NOT``.
    """
    if dog not in DOG_CHOICES or (dog == "keep" and not chosen.dog):
        problem = f'"{dog}" is unknown' if dog not in DOG_CHOICES else f"{chosen.name} has no room for DoG to keep"
        raise DataError("--dog", problem, "use bake or drop")
    for flag, how in kept.items():
        if how not in KEPT_OR_NOT or (how == "keep" and not getattr(chosen, flag.removeprefix("--"))):
            problem = f'"{how}" is unknown' if how not in KEPT_OR_NOT else f"{chosen.name} has no room for them"
            raise DataError(flag, problem, "use drop")
    if small and chosen.name not in SMALL:
        raise DataError("--small", f"{chosen.name} has no codes that compress", "name a file that ends in .spz or .sog")
    if small and world.upright:
        remedy = "make it upright first: dogsplat clean MODEL -o UPRIGHT.ply --upright"
        raise DataError("--upright", "the grids of a small file are for the model as it lies", remedy)
    if views < 0:
        raise DataError("--views", f"{views} is too small", "use at least 0")


def _stages(splats: Splats, dog: str, slopes: str, cuts: str) -> dict[str, Splats]:
    """The model as it is, and after each thing that is taken out of it; the last one is what the format gets.

    Cuts come first: what is left of a primitive has another mean colour than the whole of it.
    """
    stages, plain = {"as it is": splats}, splats
    if cuts == "drop" and splats.n_cuts:
        plain = stages["without cuts"] = whole(plain)
    if slopes == "drop" and splats.n_slopes:
        plain = stages["without slopes"] = plain.without_slopes()
    if dog != "keep" and splats.n_dog:
        stages[f"without DoG ({dog})"] = plain_gaussians(plain, dog)
    return stages


def _on_grids(splats: Splats, grids: str, drawn: DrawnAs) -> Splats:
    """The model as a small file has it, ``grids`` by their name in ``SMALL``."""
    if not drawn.linear:
        return snapped(grids, splats, linear=False)
    return brightened(snapped(grids, brightened(splats, 1 / drawn.white), linear=True), drawn.white)


def _write_page(
    model: Path, out: Path, written: Model, dog: str, data: str | Path | None, options: PictureOptions
) -> list[str]:
    """A page that opens as the model was photographed, where that is known; what is left out."""
    subject = read_subject(model, data, options)
    title = model.resolve().parent.name if model.name == MODEL else model.stem
    return write_page(out, written, opening_of(subject, title, dog))


def _steps(refine: int | None, dog: str, taken_out: bool, small: bool) -> int | None:
    """Of the refinement, None for as many as the data set needs; ``taken_out``: whether DoG, slopes or cuts were.

    Raises ``DataError`` where it is asked for and has nothing to make up for.
    """
    if refine is None:
        return None if (small or (taken_out and dog != "drop")) and mi.variant() else 0
    if refine < 0:
        raise DataError("--refine", f"{refine} is too small", "use at least 0")
    if refine and not taken_out and not small:
        raise DataError("--refine", "no DoG, slopes or cuts are taken out that could be made up for", "leave it out")
    return refine
