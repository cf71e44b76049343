"""How a model is drawn, wherever that is a choice: in renders, measurements, exports, the viewer, and training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

from ..scene.drawing import Drawing
from ..support.settings import Setting, check_settings, refuse

BACKGROUNDS = ("black", "white", "auto", "random")
BEHIND = "auto is white for images with alpha, else black"

SHRINK = "shrink the images by this whole factor when they are loaded"
Downscale = Annotated[int, Setting(SHRINK, least=1)]
PAINTED = f"colour behind the model: black, white, auto or random; {BEHIND}; random is a new colour at each step"
Background = Annotated[str, Setting(PAINTED, choices=BACKGROUNDS)]
MIP = "compensate opacities for the screen-space low-pass filter"
NEAR = "leave out primitives that are nearer to the camera plane than this, in world units"
Antialiased = Annotated[bool, Setting(MIP)]
FILE = "(default: as the file says)"
BEHIND_PICTURES = f"colour behind the model: black, white or auto; {BEHIND}; random is the same as auto"


@dataclass(frozen=True)
class PictureOptions:
    """What all pictures of a model have in common; a background of ``random`` is that of ``auto`` outside of training.

    None is for what the file of the model, or its run, says, and for what is usual where it says nothing (``drawn_as``;
    a downscale of 1, a background of ``auto``).

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    downscale: Annotated[int | None, Setting(f"{SHRINK} (default: 1)", least=1)] = None
    background: Annotated[str | None, Setting(f"{BEHIND_PICTURES} (default: auto)", choices=BACKGROUNDS)] = None
    antialiased: Annotated[bool | None, Setting(f"{MIP} {FILE}")] = None
    near_clip: Annotated[float | None, Setting(f"{NEAR} {FILE}", least=0, most=1e30)] = None
    linear: Annotated[bool | None, Setting(f"the colours of the model are linear radiance, not sRGB {FILE}")] = None

    white: Annotated[float | None, Setting(f"linear radiance that is shown as white {FILE}", "L", 1e-30, 1e30)] = None

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def drawing(self) -> Drawing:
        """What these options say."""
        return Drawing(self.antialiased, self.near_clip, self.linear, white=self.white)

    @property
    def shrink(self) -> int:
        """The factor of images."""
        return self.downscale or 1

    def require_for(self, linear: bool) -> None:
        """Raise ``DataError`` for a white that pictures of a model, ``linear`` or not, do not go by."""
        if self.white is not None and not linear:
            problem = "is for linear radiance, but the model has sRGB colours"
            refuse("white", problem, "leave it out, or add --linear")

    def require_use(self, images: bool, pictures: bool) -> None:
        """Raise ``DataError`` for what has no effect: a downscale where no ``images`` are shrunk, a background where no
        ``pictures`` are drawn over it. What is usual may always be said."""
        if self.shrink > 1 and not images:
            refuse("downscale", "there are no images to shrink", "leave it out")
        if self.background not in (None, "auto") and not pictures:
            refuse("background", "no picture with a background is drawn", "leave it out")

    def or_trained(self, trained: Mapping[str, Any]) -> PictureOptions:
        """With the downscale and background of a run that was ``trained`` with these settings, where none is said."""
        said = {name: getattr(self, name) for name in ("downscale", "background")}
        return replace(self, **{name: trained.get(name) if value is None else value for name, value in said.items()})
