"""A model to a file of another format, and what that costs, measured on pictures; behind ``dogsplat export``."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..datasets import load_dataset
from ..datasets.masks import Masks, without_mask
from ..datasets.world_config import WorldConfig
from ..film.subject import read_subject
from ..formats.model import Model
from ..formats.read import read_model, read_source
from ..formats.table import SOG, Format, format_to_write
from ..formats.upright import upright
from ..formats.write import require_encoder, write_model
from ..inspection.unneeded import Unneeded
from ..render.picture_options import PictureOptions
from ..report.run_folder import MODEL
from ..runs.masks_of_run import without_masks_of_run
from ..scene.appearance import APPEARANCE, read_appearance
from ..scene.drawing import DrawnAs, drawn_as
from ..scene.radiance import from_units_of_white
from ..scene.splats import Splats
from ..scene.transform import transformed
from ..support.arguments import checks_arguments
from ..support.errors import DataError
from ..support.settings import refuse
from ..support.variants import require_arrays
from ..support.wording import counted
from .export_config import SMALL_GRIDS, ExportConfig
from .losses import Loss, losses, views_of
from .refine import by_data, by_renders, refined, steps_for
from .stages import on_grids, stages_of, taken_out
from .web_page import PAGE, opening_of, read_page, write_page


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


@checks_arguments
def export_model(
    model: str | Path,
    out: str | Path,
    config: ExportConfig = ExportConfig(),
    data: str | Path | None = None,
    options: PictureOptions = PictureOptions(),
    world: WorldConfig = WorldConfig(),
    show: Callable[[int, int], None] | None = None,
) -> Exported:
    """Write a model file in the format that the name of ``out`` asks for, and measure what is lost.

    Args:
        model: the model, of any format.
        out: ends in one of ``formats.table.FORMATS``, or in .html: a page with a viewer inside.
        config: what becomes of what other programs do not know, and how the file is made.
        data: a data set: it is refined on its training views, without what an ``appearance.json`` beside the model has
            of their exposure, compared with on its test views, and a page opens from one; None: views from around it.
        options: how the pictures are drawn; what they do not say, the model's file does.
        world: what is up, and how long a unit is, where the model's file is not to say so.
        show: called with the steps of the refinement that are done, and how many there are.

    Measuring and refining need a Mitsuba variant. Raises ``DataError``.
    """
    model, out = Path(model), Path(out)
    page = out.name.lower().endswith(PAGE)
    chosen = SOG if page else format_to_write(out, (PAGE,))
    config.require_room(chosen, world.upright and not page)  # which is always upright
    require_encoder(out, chosen, config.spz_version)
    read = read_source(model, out, "export")
    drawing = world.over(options.drawing.over(read.drawing), data)
    stages, drawn = stages_of(read.splats, config), drawn_as(drawing)
    options.require_for(drawn.linear)
    left_out = [*(f"{model.name}: {line}" for line in read.left_out), *taken_out(stages, chosen)]
    plain, seconds = list(stages.values())[-1], None
    steps = _steps(config, plain is not read.splats)
    draws = steps != 0 or config.views > 0  # for steps or measures
    if draws:
        require_arrays()
    looked_at = data if draws else None
    options.require_use(images=bool(looked_at), pictures=bool(page or config.views or looked_at))
    if data and not (looked_at or page or world.scale):
        unused = "there is nothing to refine, and --views 0 measures nothing"
        left_out.append(f"only world.json of --data is used: {unused}")
    if config.masks and not looked_at:
        refuse("masks", "is for photographs, and none are used", "add --data DATA, or leave it out")
    dataset, masks = None, None
    if looked_at:
        dataset = load_dataset(looked_at, options.shrink)
        masks = Masks(config.masks, dataset.views) if config.masks else None
        left_out += without_mask(config.masks, (view.name for view in dataset.views))
        left_out += without_masks_of_run(model, config.masks)
    steps = steps_for(dataset) if steps is None else steps
    grids = SMALL_GRIDS[chosen.name] if config.small else None
    if steps:
        if Unneeded.of(plain).invisible.all():
            problem = "all of its primitives are invisible, so that refinement has no effect"
            raise DataError(model, problem, "add --refine 0, or use another model")
        start = time.perf_counter()
        if dataset:
            learned = model.parent / APPEARANCE
            appearance = read_appearance(learned) if learned.is_file() else None
            goal = by_data(read.splats, dataset, steps, options, drawn, masks, appearance)
        else:
            goal = by_renders(read.splats, steps, drawn, drawing.up)
        plain = stages[f"refined, {counted(steps, 'step')}"] = refined(plain, goal, steps, show, grids)
        seconds = time.perf_counter() - start
    elif grids:
        plain = stages["on coarse grids"] = on_grids(plain, grids, drawn)
    written, turned = replace(read, splats=plain, drawing=drawing), np.eye(4)
    if page:
        left_out += _write_page(model, out, written, config.dog, grids, data, options)
    else:
        if world.upright:
            written, turned = upright(written)
        left_out += write_model(out, written, config.spz_version)
    if not config.views:
        return Exported(plain.n_splats, 0, [], left_out, seconds)
    seen = views_of(read.splats, dataset, config.views, options, drawn, drawing.up, masks)
    again = _in_units_of(drawn, read_page(out) if page else read_model(out), chosen)
    stages["read from the file"] = transformed(again, np.linalg.inv(turned))
    return Exported(plain.n_splats, len(seen.cameras), losses(stages, seen), left_out, seconds)


def _in_units_of(drawn: DrawnAs, again: Model, chosen: Format) -> Splats:
    """Primitives as they were read, in the units of the model: a file may be in those of white and not say so."""
    unsaid = chosen.in_white and not (again.drawing.linear and again.drawing.white)
    return from_units_of_white(again.splats, drawn) if unsaid else again.splats


def _write_page(
    model: Path,
    out: Path,
    written: Model,
    dog: str,
    grids: str | None,
    data: str | Path | None,
    options: PictureOptions,
) -> list[str]:
    """A page that opens as the model was photographed, where that is known; what is left out."""
    subject = read_subject(model, data, options)
    subject = replace(subject, model=replace(subject.model, drawing=written.drawing))  # flags may say what is up
    title = model.resolve().parent.name if model.name == MODEL else model.stem
    return write_page(out, written, opening_of(subject, title, dog), grids)


def _steps(config: ExportConfig, something_taken_out: bool) -> int | None:
    """Of the refinement, None for as many as the data set needs; ``something_taken_out``: DoG or rows.

    Raises ``DataError`` where it is asked for and has nothing to make up for.
    """
    if config.refine is None:
        made_up_for = config.small or (something_taken_out and config.dog != "drop")
        return None if made_up_for and mi.variant() else 0
    if config.refine and not something_taken_out and not config.small:
        problem = "no DoG, slopes, curvatures, cuts or shifts are left out, so there is nothing to make up for"
        raise DataError("--refine", problem, "leave it out")
    return config.refine
