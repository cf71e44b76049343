"""A model without what it does not need, and without what is not wanted; behind ``dogsplat clean``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..datasets import Dataset, View, load_dataset
from ..datasets.masks import Masks
from ..datasets.world_config import WorldConfig
from ..formats.model import Model
from ..formats.read import read_source, require_writable
from ..formats.table import PLY, format_to_write
from ..formats.upright import upright
from ..formats.write import require_encoder, write_model
from ..inspection.unneeded import Unneeded
from ..measure.metrics import psnr
from ..render.picture import background_color, photograph, picture_of, seen_as
from ..render.picture_options import PictureOptions
from ..render.viewpoint import viewpoint
from ..scene.drawing import DrawnAs, drawn_as
from ..scene.finite import finite_primitives
from ..scene.splats import Array, Splats
from ..support.arguments import checks_arguments
from ..support.errors import DataError
from ..support.pictures import write_png
from ..support.variants import require_arrays
from .clean_config import CleanConfig
from .regions import in_box, in_sphere, largest_parts
from .views import evidence, seen, within_masks


@dataclass(frozen=True)
class Cleaned:
    """What became of a model: primitives before and after, and why each left (the first reason, in this order)."""

    n_before: int
    n_after: int
    taken_out: list[tuple[str, int]]
    """reason and number of primitives; none that are 0"""
    unneeded: list[str]
    """a line for each kind of what is not needed, of all that was wanted"""
    psnr: tuple[float, float] | None
    """dB on the photographs of the data, before and after; None without data, and where masks are all black"""
    left_out: list[str]
    """a line for each thing that the formats have no room for"""


@checks_arguments
def clean_model(
    model: str | Path,
    out: str | Path,
    config: CleanConfig = CleanConfig(),
    data: str | Path | None = None,
    preview: str | Path | None = None,
    options: PictureOptions = PictureOptions(),
    world: WorldConfig = WorldConfig(),
) -> Cleaned:
    """Write a model file anew, without what ``unneeded.py`` finds and what ``config`` does not want.

    Args:
        model: the model, of any format.
        out: the file to write, in the format of its name.
        config: what is not wanted.
        data: a data set, for ``seen``, ``masks``, ``floaters``, and the PSNR before and after.
        preview: a .png to write, of the model before and after.
        options: how pictures are drawn; what they do not say, the model's file does.
        world: what is up, and how long a unit is, where the model's file is not to say so.

    Pictures need a Mitsuba variant. Raises ``DataError``.
    """
    draws = bool(data or preview)
    if draws:
        require_arrays()
    model, out = Path(model), Path(out)
    if config.needs_data and not data:
        raise DataError(config.needs_data, "needs the training views of a data set", "add --data DATA")
    if preview and Path(preview).suffix.lower() != ".png":
        raise DataError(preview, "no known picture format", "name a file that ends in .png")
    options.require_use(images=draws, pictures=draws)
    chosen = format_to_write(out)
    require_encoder(out, chosen)
    if chosen is not PLY and config.mixed_sh:
        raise DataError("--mixed-sh", "only PLY holds an SH degree per primitive", "name a file that ends in .ply")
    read = read_source(model, out, "clean", finite=False)
    if preview:
        require_writable(Path(preview))  # before the model is written
    finite = finite_primitives(read.splats)
    splats, drawn = read.splats.select(finite), drawn_as(options.drawing, read.drawing)
    if not splats.n_splats:
        raise DataError(model, "no primitive has numbers that are all finite", "use another model")
    options.require_for(drawn.linear)
    drawing = world.over(options.drawing.over(read.drawing), data)
    dataset = load_dataset(data, options.shrink) if data else None
    views = dataset.train if dataset else []
    masks = Masks(config.masks, views) if config.masks else None
    kept, taken_out = wanted(splats, config, views, masks, drawn)
    unneeded = Unneeded.of(kept)
    after = unneeded.taken_out(kept, config.mixed_sh)
    if after.n_splats == 0:
        raise DataError(model, "no primitive would be left", "remove less")
    left_out = [f"{model.name}: {line}" for line in read.left_out]
    if config.mixed_sh and not after.mixed_sh and unneeded.saved_by_mixing < 0:
        left_out.append("--mixed-sh: an SH degree for each primitive would make the file larger, so all keep the same")
    written = replace(read, splats=after, drawing=drawing)
    left_out += write_model(out, upright(written)[0] if world.upright else written, sh_rows=True)
    quality = _quality(dataset, splats, after, options.background, drawn, masks) if dataset else None
    if preview:
        write_preview(Path(preview), replace(read, splats=splats, drawing=drawing), after, data, options)
    found = [(reason, number) for reason, number in [("not finite", int((~finite).sum())), *taken_out] if number]
    idle = unneeded.described(kept, config.mixed_sh)
    return Cleaned(read.splats.n_splats, after.n_splats, found, idle, quality, left_out)


def wanted(
    splats: Splats, config: CleanConfig, views: Sequence[View], masks: Masks | None, drawn: DrawnAs
) -> tuple[Splats, list[tuple[str, int]]]:
    """What is wanted of a model, and how many primitives leave for each reason, the first that holds of each."""
    kept, numbers = np.ones(splats.n_splats, bool), []
    for reason, keep in rules(splats, config, views, masks, drawn):
        numbers.append((reason, int((kept & ~keep).sum())))
        kept &= keep
    left = splats.select(kept)
    if config.connected:  # of what is left: a crop may cut a part off
        parts = largest_parts(left, config.connected)
        numbers.append(("not connected", int((~parts).sum())))
        left = left.select(parts)
    return left, numbers


def rules(
    splats: Splats, config: CleanConfig, views: Sequence[View], masks: Masks | None, drawn: DrawnAs
) -> list[tuple[str, Array]]:
    """Why primitives leave, and which of them stay [N], rule by rule."""
    found, cameras = [], [view.camera for view in views]
    if config.box:
        found.append(("outside of the box", in_box(splats, config.box[:3], config.box[3:])))
    if config.sphere:
        found.append(("outside of the sphere", in_sphere(splats, config.sphere[:3], config.sphere[3])))
    if config.min_opacity is not None:
        found.append(("too faint", splats.opacities >= config.min_opacity))
    if config.max_scale is not None:
        found.append(("too large", splats.scales.max(axis=1) <= config.max_scale))
    if config.seen:
        found.append(("never seen", seen(splats, cameras, drawn)))
    if masks:
        found.append(("outside of the masks", within_masks(splats, views, masks, drawn)))
    if config.floaters:
        found.append(("floaters", ~evidence(splats, cameras, drawn).floats))
    return found


def write_preview(out: Path, before: Model, after: Splats, data: str | Path | None, options: PictureOptions) -> None:
    """Both models side by side, from the first test view of the data or a camera that frames the first one."""
    view = viewpoint(before.splats, data, None, options, before.drawing)
    pictures = [picture_of(s, view.background, view.drawn)(view.camera).color for s in (before.splats, after)]
    write_png(out, np.concatenate(pictures, axis=1))


def _quality(
    dataset: Dataset, before: Splats, after: Splats, background_name: str | None, drawn: DrawnAs, masks: Masks | None
) -> tuple[float, float] | None:
    """Mean PSNR of two models on the test views, or on all views without a split, where masks are not black."""
    background = background_color(background_name, dataset.has_alpha)
    pairs = [(view, masks.of(view) if masks else None) for view in dataset.test or dataset.train]
    pairs = [(view, mask) for view, mask in pairs if mask is None or mask.any()]
    if not pairs:
        return None
    drawn = drawn.beside(dataset.white)

    def mean(splats: Splats) -> float:
        picture = picture_of(splats, background, drawn)
        return float(np.mean([psnr(seen_as(picture(v.camera), v), photograph(v, background), m) for v, m in pairs]))

    return mean(before), mean(after)
