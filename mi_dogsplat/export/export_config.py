"""What becomes of a model in another format; what stands beside a field's type is the help text of its flag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..formats.table import Format
from ..formats.write import SPZ_VERSIONS
from ..support.settings import Setting, check_settings, refuse

SMALL_GRIDS = {"SPZ": "spz", "SOG": "sog"}  # of the formats that have coarse grids, their names there

KEEP = "keep (for formats that can hold them)"
DOG = f"what becomes of DoG: bake (the nearest Gaussians), drop (only their primaries), or {KEEP}"
SLOPES = f"what becomes of colours that vary over a primitive: drop (mean colours remain), or {KEEP}"
CUTS = f"what becomes of planes that cut primitives off: drop (the nearest whole primitives), or {KEEP}"
SHIFTS = f"what becomes of places that depend on the view: drop (mean places remain), or {KEEP}"
SPZ_VERSION = "version of an .spz file: 3 or 4"
SMALL = "for SPZ and SOG: half the bytes or less, by coarse grids and a palette, for which the model is refined"
REFINE = "steps of refinement after something was left out, 10 to 100 ms each on a CPU; 0: none (default: 300 to 1000)"
MASKS = "folder of masks, named like the images of --data; black pixels count neither in refinement nor in measures"
VIEWS = "measure the loss on at most this many views; 0: not at all"


@dataclass(frozen=True)
class ExportConfig:
    """Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed."""

    dog: Annotated[str, Setting(DOG, "HOW", choices=("bake", "drop", "keep"))] = "bake"
    slopes: Annotated[str, Setting(SLOPES, "HOW", choices=("drop", "keep"))] = "drop"
    cuts: Annotated[str, Setting(CUTS, "HOW", choices=("drop", "keep"))] = "drop"
    shifts: Annotated[str, Setting(SHIFTS, "HOW", choices=("drop", "keep"))] = "drop"
    spz_version: Annotated[int, Setting(SPZ_VERSION)] = SPZ_VERSIONS[0]
    small: Annotated[bool, Setting(SMALL)] = False
    refine: Annotated[int | None, Setting(REFINE, "STEPS", least=0)] = None
    masks: Annotated[str | None, Setting(MASKS, "FOLDER")] = None
    views: Annotated[int, Setting(VIEWS, least=0)] = 8

    def __post_init__(self) -> None:
        check_settings(self)

    def require_room(self, chosen: Format, upright: bool) -> None:
        """Raise ``DataError`` for what the format has no room for; ``upright``: whether the model is to be turned."""
        if self.dog == "keep" and not chosen.dog:
            refuse("dog", f"{chosen.name} cannot hold DoG", "use bake or drop")
        for name, how in {"slopes": self.slopes, "cuts": self.cuts, "shifts": self.shifts}.items():
            if how == "keep" and not getattr(chosen, name):
                refuse(name, f"{chosen.name} cannot hold them", "use drop")
        if self.spz_version != SPZ_VERSIONS[0] and chosen.name != "SPZ":
            refuse("spz_version", f"{chosen.name} has no versions", "leave it out, or name a file that ends in .spz")
        if self.small and chosen.name not in SMALL_GRIDS:
            refuse("small", f"{chosen.name} has no grids to make coarser", "name a file that ends in .spz or .sog")
        if self.small and upright:
            remedy = "make it upright first: dogsplat clean MODEL -o UPRIGHT.ply --upright"
            refuse("upright", "a small file is refined for the axes of the model", remedy)
