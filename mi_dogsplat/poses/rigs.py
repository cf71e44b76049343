"""The views of a panorama are taken from one place, in directions that are known: for COLMAP a rig of cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .colmap_database import opened
from .panoramas import SIDES, side_rotation


def tie_views(pycolmap: Any, database: Path) -> None:
    """Make the views of each panorama in the database a frame of one rig, unless they are."""
    with opened(pycolmap, database) as content:
        if content.num_rigs() == 1:
            return
        first, *others = SIDES
        cameras = [pycolmap.RigConfigCamera(ref_sensor=True, image_prefix=f"{first}/")]
        for side in others:
            turn = pycolmap.Rotation3d(side_rotation(side) @ side_rotation(first).T)
            pose = pycolmap.Rigid3d(turn, np.zeros(3))
            cameras.append(pycolmap.RigConfigCamera(image_prefix=f"{side}/", cam_from_rig=pose))
        pycolmap.apply_rig_config([pycolmap.RigConfig(cameras=cameras)], content)
