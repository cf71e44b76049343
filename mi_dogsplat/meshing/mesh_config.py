"""How a mesh is made of a model; what stands beside a field's type is the help text of its flag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..support.settings import Setting, check_settings, is_said, refuse

DEPTHS = {"median": "median_depth", "expected": "depth"}  # to AOVs
USUAL_VOXEL = "(default: radius of the model / 128, or a few times that if the views are coarse)"
VOXEL = f"spacing of the grid on which the surface is found, in world units {USUAL_VOXEL}"
REACH = "how far the mesh extends from the middle of the model, in radii of the model"
MIN_FACES = "leave out connected parts with fewer triangles than this"
CONNECTED = "keep only the N connected parts with the most triangles"
FACES = "simplify the mesh to N triangles if it has more"
TEXTURE = "write colours as a texture of N x N pixels, not for each vertex; needs --faces, and is not for .ply"
PHOTOGRAPHS = "take colours from the photographs of --data, which are sharper than the model"
MASKS = "folder of masks, named like the images of --data; black pixels give no colours; for --photographs"
DEPTH = (
    "depth of a pixel that is fused: median, of what stops half of the light; or expected, the mean, for models that "
    "were trained with --depths"
)
VIEWS = "number of views to fuse, from around the model and from inside of it; --data has its own views"
SIZE = "width and height of these views, in pixels"
INSIDE = "share of these views that show the model from free places inside of it; use 1 for a room"


@dataclass(frozen=True)
class MeshConfig:
    """Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed."""

    voxel: Annotated[float | None, Setting(VOXEL, "X", least=1e-30, most=1e30)] = None
    reach: Annotated[float, Setting(REACH, "X", least=1e-3, most=100)] = 2.0
    min_faces: Annotated[int, Setting(MIN_FACES, least=1)] = 100
    connected: Annotated[int | None, Setting(CONNECTED, least=1)] = None
    faces: Annotated[int | None, Setting(FACES, least=4)] = None
    texture: Annotated[int | None, Setting(TEXTURE, least=64, most=16_384)] = None
    photographs: Annotated[bool, Setting(PHOTOGRAPHS)] = False
    masks: Annotated[str | None, Setting(MASKS, "FOLDER")] = None
    depth: Annotated[str, Setting(DEPTH, "WHICH", choices=tuple(DEPTHS))] = "median"
    views: Annotated[int, Setting(VIEWS, least=1)] = 96
    size: Annotated[tuple[int, int], Setting(SIZE, "W H")] = (640, 480)
    inside: Annotated[float, Setting(INSIDE, least=0, most=1)] = 0.5

    def __post_init__(self) -> None:
        check_settings(self)
        if self.texture is not None and self.faces is None:
            refuse("texture", "needs few triangles", "also give --faces, for instance 20000")
        if self.masks is not None and not self.photographs:
            refuse("masks", "are for the colours of photographs", "give --photographs, too, or leave it out")
        if not 16 <= min(self.size) <= max(self.size) <= 16_384:
            refuse("size", f"{self.size[0]} x {self.size[1]} is out of range", "use 16 to 16384 pixels")

    def require_use(self, own_views: bool) -> None:
        """Raise ``DataError`` for what is said of views that are not made, or photographs that are not there.

        ``own_views``: those of data are fused.
        """
        if self.photographs and not own_views:
            refuse("photographs", "needs photographs", "name their data set by --data")
        for name in ("views", "size", "inside"):
            if own_views and is_said(self, name):
                refuse(name, "is not for --data, whose training views are fused", "leave it out")
