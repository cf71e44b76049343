"""What is drawn: the model that all passes of a render share, what a pass makes of it, and what of it is splatted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi

from ..engine.options import RasterOptions
from ..engine.rasterize import Frame
from ..scene.drawing import DrawnAs
from .sensor import ViewPass
from .transfer import linear_to_srgb, srgb_to_linear


@dataclass
class SplattedModel:
    """The primitives of all shapes of a scene, which the passes of a render share, and how they are drawn."""

    params: dict
    sh_degree: int
    drawn_as: DrawnAs


@dataclass
class Drawn:
    """What a pass draws; ``derivative``: wanted for its graph only."""

    scene: Any  # mi.Scene
    view_pass: ViewPass
    params: dict
    options: RasterOptions
    linear: bool  # colours of primitives, not sRGB
    derivative: bool
    hole: mi.Float | None = None  # [H*W] share of holdouts, if there are masks; T lets nothing pass there

    def uncovered(self, T: mi.Float) -> mi.Float:
        """What splats that are shown leave of each pixel."""
        return T if self.hole is None else T + self.hole

    def encoded(self, radiance: list) -> list:
        """Radiance in the primitives' colour space."""
        return radiance if self.linear else linear_to_srgb(radiance)

    def decoded(self, colors: list) -> list:
        """Colours of the primitives' space as radiance."""
        return colors if self.linear else srgb_to_linear(colors)


@dataclass
class Splatted:
    """A view of a pass: its splats, in front of the surfaces that its rays meet."""

    drawn: Drawn
    frame: Frame
    surfaces: Any  # Surfaces; None where none are seen
