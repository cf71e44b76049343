"""What is taken out of a model on its way into another format, stage by stage."""

from __future__ import annotations

from ..formats.coded import snapped
from ..formats.table import Format
from ..scene.drawing import DrawnAs
from ..scene.kinds import varying
from ..scene.radiance import from_units_of_white, in_units_of_white
from ..scene.splats import Splats
from ..scene.whole import whole
from ..support.wording import counted
from .bake import baked
from .export_config import ExportConfig

AS_IT_IS, WITHOUT_SHIFTS, WITHOUT_CUTS = "as it is", "without shifts", "without cuts"
WITHOUT_SLOPES = "without slopes"


def stages_of(splats: Splats, config: ExportConfig) -> dict[str, Splats]:
    """The model as it is, and after each thing that is taken out of it; the last one is what the format gets.

    Shifts come first, which change no shape and no colour. Then come cuts: what is left of a primitive has another mean
    colour than the whole of it.
    """
    stages, plain = {AS_IT_IS: splats}, splats
    if config.shifts == "drop" and splats.n_shifts:
        plain = stages[WITHOUT_SHIFTS] = plain.without_shifts()
    if config.cuts == "drop" and splats.is_cut.any():
        plain = stages[WITHOUT_CUTS] = whole(plain)
    if config.slopes == "drop" and splats.is_varied.any():
        plain = stages[WITHOUT_SLOPES] = plain.without_slopes()
    if config.dog != "keep" and splats.n_dog:
        stages[f"without DoG ({config.dog})"] = baked(plain) if config.dog == "bake" else plain.plain()
    return stages


def taken_out(stages: dict[str, Splats], chosen: Format) -> list[str]:
    """A line for the shifts, for the cuts, and for slopes and curvatures that the stages have taken out, with how to
    keep them."""
    splats, lines = stages[AS_IT_IS], []
    if WITHOUT_SHIFTS in stages:
        left = f"the shifts of {counted(splats.n_shifts, 'primitive')} are left out: each has its mean place"
        lines.append(left + ("; --shifts keep keeps them" if chosen.shifts else ""))
    if WITHOUT_CUTS in stages:
        cut = counted(splats.is_cut.sum(), "primitive")
        left = f"the cuts of {cut} are left out: each becomes the nearest whole primitive"
        lines.append(left + ("; --cuts keep keeps them" if chosen.cuts else ""))
    if WITHOUT_SLOPES in stages:
        varied = counted(splats.is_varied.sum(), "primitive")
        left = f"the {varying(splats)} of {varied} are left out: each has its mean colour"
        lines.append(left + ("; --slopes keep keeps them" if chosen.slopes else ""))
    return lines


def on_grids(splats: Splats, grids: str, drawn: DrawnAs) -> Splats:
    """The model as a small file has it, ``grids`` by their name in ``SMALL_GRIDS``."""
    return from_units_of_white(snapped(grids, in_units_of_white(splats, drawn), linear=drawn.linear), drawn)
