"""How a model is drawn, wherever that is a choice: in renders, measurements, exports, the viewer, and training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..support.settings import Setting, check_settings

BACKGROUNDS = ("black", "white", "auto", "random")
BEHIND = "black, white, auto: white for images with alpha, else black; random: another each step"

Downscale = Annotated[int, Setting("shrink the images by this whole factor, once, at load", least=1)]
Background = Annotated[str, Setting(BEHIND, choices=BACKGROUNDS)]
Antialiased = Annotated[bool, Setting("compensate opacities for the screen-space low-pass filter")]
NearClip = Annotated[
    float, Setting("primitives nearer to the camera plane are dropped, world units", least=0, most=1e30)
]


@dataclass(frozen=True)
class PictureOptions:
    """What all pictures of a model have in common; a background of ``random`` is that of ``auto`` outside of training.

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    downscale: Downscale = 1
    background: Background = "auto"
    antialiased: Antialiased = False
    near_clip: NearClip = 0.2

    def __post_init__(self) -> None:
        check_settings(self)
