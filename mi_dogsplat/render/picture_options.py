"""How a model is drawn, wherever that is a choice: in renders, measurements, exports, the viewer, and training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from ..scene.drawing import Drawing
from ..support.settings import Setting, check_settings

BACKGROUNDS = ("black", "white", "auto", "random")
BEHIND = "black, white, auto: white for images with alpha, else black"

Downscale = Annotated[int, Setting("shrink the images by this whole factor, once, at load", least=1)]
Background = Annotated[str, Setting(f"{BEHIND}; random: another each step", choices=BACKGROUNDS)]
MIP = "compensate opacities for the screen-space low-pass filter"
NEAR = "primitives nearer to the camera plane are dropped, world units"
Antialiased = Annotated[bool, Setting(MIP)]
FILE = "(default: as the file says)"


@dataclass(frozen=True)
class PictureOptions:
    """What all pictures of a model have in common; a background of ``random`` is that of ``auto`` outside of training.

    None is for what the file of the model says, and for what is usual where it says nothing (``drawn_as``).

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    downscale: Downscale = 1
    background: Annotated[str, Setting(f"{BEHIND}; random is for training: as auto here", choices=BACKGROUNDS)] = "auto"
    antialiased: Annotated[bool | None, Setting(f"{MIP} {FILE}")] = None
    near_clip: Annotated[float | None, Setting(f"{NEAR} {FILE}", least=0, most=1e30)] = None
    linear: Annotated[bool | None, Setting(f"its colours are linear radiance, not sRGB {FILE}")] = None

    white: Annotated[float | None, Setting(f"linear radiance that is shown as white {FILE}", "L", 1e-30, 1e30)] = None

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def drawing(self) -> Drawing:
        """What these options say."""
        return Drawing(self.antialiased, self.near_clip, self.linear, white=self.white)

    def or_trained(self, name: str, trained: Mapping[str, Any]) -> Any:
        """What these options say of ``name`` or, where that is the default, what a run was ``trained`` with."""
        said, default = getattr(self, name), getattr(PictureOptions, name)
        return said if said != default else trained.get(name, default)
