"""What becomes of a model in another format; what stands beside a field's type is the help text of its flag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..formats.table import Format
from ..formats.write import SPZ_VERSIONS
from ..support.settings import Setting, check_settings, refuse

SMALL_GRIDS = {"SPZ": "spz", "SOG": "sog"}  # of the formats that have coarse grids, their names there

DOG = "DoG: bake (nearest Gaussians), drop (their primaries alone), or keep where the format knows them"
SLOPES = "colours that vary over their primitive: drop (mean colours, the nearest), or keep where the format knows them"
CUTS = "primitives that a plane cuts off: drop (nearest whole ones), or keep where the format knows them"
SHIFTS = "places that depend on the view: drop (mean places), or keep where the format knows them"
SPZ_VERSION = "version of an .spz: 3 or 4"
SMALL = "SPZ, SOG: coarse grids and a palette, half the bytes or less; refined to lose little"
REFINE = "steps that make up for what is left out, on a CPU 10 to 100 ms each; 0: none (default: 300 to 1000)"
MASKS = "folder of masks, named as the images of --data: black pixels are neither refined towards nor measured"
VIEWS = "measure the loss on at most so many views; 0: on none"


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
            refuse("dog", f"{chosen.name} has no room for DoG to keep", "use bake or drop")
        for name, how in {"slopes": self.slopes, "cuts": self.cuts, "shifts": self.shifts}.items():
            if how == "keep" and not getattr(chosen, name):
                refuse(name, f"{chosen.name} has no room for them", "use drop")
        if self.spz_version != SPZ_VERSIONS[0] and chosen.name != "SPZ":
            refuse("spz_version", f"{chosen.name} has no versions", "leave it out, or name a file that ends in .spz")
        if self.small and chosen.name not in SMALL_GRIDS:
            refuse("small", f"{chosen.name} has no codes that compress", "name a file that ends in .spz or .sog")
        if self.small and upright:
            remedy = "make it upright first: dogsplat clean MODEL -o UPRIGHT.ply --upright"
            refuse("upright", "the grids of a small file are for the model as it lies", remedy)
