"""All settings of structure from motion; ``poses.json`` in the data set's folder holds them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..datasets.world import Length, check_world
from ..support.settings import Setting, check_settings, refuse

SETTINGS = "poses.json"
EQUIRECTANGULAR = "EQUIRECTANGULAR"  # of panoramas of all directions, which are cut into views of pinholes
LENSES = (  # lens.py reads them all but the last one
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", EQUIRECTANGULAR,
)  # fmt: skip
FREE = ("gpu", "source", "masks")  # may change from one start to the next; digests tell what lies there
DEFAULT_LENS = "SIMPLE_RADIAL"
LENS = (
    f"lens of each camera, as a camera model of COLMAP: {', '.join(LENSES)}; the last is for panoramas, which are cut "
    f"into six views each (default: {DEFAULT_LENS}, or {EQUIRECTANGULAR} if the images say so)"
)
FRAMES = "number of frames to take from a video (default: as many as its motion needs, at most 300)"
MASKS = "folder of masks, named like the images; what is black is not matched (default: INPUT/masks if it exists)"
LINEAR = "keep the light of raw photographs, as OpenEXR (default: they become JPEG); OpenEXR images always keep theirs"
UNDISTORT = "remove lens distortion from the images, for programs that know only pinholes (default: they keep it)"
SIZE = "longest side of the images in which features are looked for; larger images are shrunk for this"


@dataclass(frozen=True)
class PosesConfig:
    """What stands beside a field's type is the help text of its flag. Raises ``DataError`` that names the flag."""

    lens: Annotated[str | None, Setting(LENS, "MODEL", choices=LENSES)] = None
    frames: Annotated[int | None, Setting(FRAMES, least=2)] = None
    masks: Annotated[str | None, Setting(MASKS, "FOLDER")] = None
    linear: Annotated[bool, Setting(LINEAR)] = False
    undistort: Annotated[bool, Setting(UNDISTORT)] = False
    scale: Length = None
    feature_size: Annotated[int, Setting(SIZE, least=64)] = 2000
    seed: Annotated[int, Setting("seed of all random choices", least=0, most=2**31 - 1)] = 0
    gpu: Annotated[bool, Setting("find and match features on a GPU (needs a pycolmap with CUDA)")] = False

    def __post_init__(self) -> None:
        check_settings(self)
        check_world(None, self.scale)
        if self.panoramas and self.undistort:
            refuse("undistort", f"is for lenses, and the views of --lens {EQUIRECTANGULAR} have none", "leave it out")
        if self.panoramas and self.linear:
            refuse("linear", f"is not made of panoramas, which --lens {EQUIRECTANGULAR} cuts", "leave one of them out")

    @property
    def panoramas(self) -> bool:
        """Whether the images show all directions."""
        return self.lens == EQUIRECTANGULAR

    @property
    def camera_model(self) -> str:
        """COLMAP's name of the cameras of the images in which features are sought."""
        return "PINHOLE" if self.panoramas else self.lens or DEFAULT_LENS
