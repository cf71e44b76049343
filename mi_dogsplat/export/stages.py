"""What is taken out of a model on its way into another format, stage by stage."""

from __future__ import annotations

from ..formats.coded import snapped
from ..formats.table import Format
from ..scene.drawing import DrawnAs
from ..scene.kinds import varying
from ..scene.radiance import brightened
from ..scene.splats import Splats
from ..scene.whole import whole
from ..support.wording import counted
from .bake import baked
from .export_config import ExportConfig

AS_IT_IS, WITHOUT_CUTS, WITHOUT_SLOPES = "as it is", "without cuts", "without slopes"


def stages_of(splats: Splats, config: ExportConfig) -> dict[str, Splats]:
    """The model as it is, and after each thing that is taken out of it; the last one is what the format gets.

    Cuts come first: what is left of a primitive has another mean colour than the whole of it.
    """
    stages, plain = {AS_IT_IS: splats}, splats
    if config.cuts == "drop" and splats.is_cut.any():
        plain = stages[WITHOUT_CUTS] = whole(plain)
    if config.slopes == "drop" and splats.is_varied.any():
        plain = stages[WITHOUT_SLOPES] = plain.without_slopes()
    if config.dog != "keep" and splats.n_dog:
        stages[f"without DoG ({config.dog})"] = baked(plain) if config.dog == "bake" else plain.plain()
    return stages


def taken_out(stages: dict[str, Splats], chosen: Format) -> list[str]:
    """A line for the cuts and one for slopes and curvatures that the stages have taken out, with how to keep them."""
    splats, lines = stages[AS_IT_IS], []
    if WITHOUT_CUTS in stages:
        cut = counted(splats.is_cut.sum(), "primitive")
        left = f"the cuts of {cut} are left out: each becomes the whole one nearest to it"
        lines.append(left + ("; --cuts keep keeps them" if chosen.cuts else ""))
    if WITHOUT_SLOPES in stages:
        varied = counted(splats.is_varied.sum(), "primitive")
        left = f"the {varying(splats)} of {varied} are left out: each has its mean colour"
        lines.append(left + ("; --slopes keep keeps them" if chosen.slopes else ""))
    return lines


def on_grids(splats: Splats, grids: str, drawn: DrawnAs) -> Splats:
    """The model as a small file has it, ``grids`` by their name in ``SMALL_GRIDS``."""
    if not drawn.linear:
        return snapped(grids, splats, linear=False)
    return brightened(snapped(grids, brightened(splats, 1 / drawn.white), linear=True), drawn.white)
