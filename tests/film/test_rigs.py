"""Of cameras that a rig had at one moment, or the sides of a panorama, a path follows one."""

from pathlib import Path

import numpy as np
import pytest
from dataset_folders import transforms_folder
from mi_dogsplat.datasets.transforms import RIG_FRAME
from mi_dogsplat.film.data_cameras import data_cameras
from mi_dogsplat.film.rigs import one_of_each_moment
from mi_dogsplat.poses.panoramas import SIDES, side_rotation
from mi_dogsplat.scene.cameras import Camera, affine, inverse_rigid
from scipy.spatial.transform import Rotation

N = 12


def panoramas(backwards: bool = False) -> tuple[list[Camera], list[int | None], list[Camera]]:
    """The sides of panoramas of a walk around a corner, by the names of the sides; their moments; and those that look
    ahead."""
    cameras: dict[str, list[Camera]] = {side: [] for side in sorted(SIDES)}
    for k in range(N):
        turned = Rotation.from_euler("y", 8.0 * k + (180 if backwards else 0), degrees=True).as_matrix()
        place = np.array([np.cos(np.radians(8 * k)), 0, np.sin(np.radians(8 * k))]) * (-5, 0, 5)
        for side, views in cameras.items():
            c2w = affine(turned @ side_rotation(side).T, place)
            views.append(Camera(inverse_rigid(c2w), 20, 20, 16, 16, 32, 32))
    every = [camera for views in cameras.values() for camera in views]
    return every, [*range(N)] * len(cameras), cameras["back" if backwards else "front"]


@pytest.mark.parametrize("backwards", [False, True])
def test_of_panoramas_the_sides_that_look_ahead_are_followed(backwards):
    cameras, moments, ahead = panoramas(backwards)
    assert one_of_each_moment(cameras, moments) == ahead
    alone = Camera(np.eye(4), 20, 20, 16, 16, 32, 32)
    assert one_of_each_moment([*cameras, alone], [*moments, None]) == [*ahead, alone]


def test_cameras_without_a_rig_are_all_followed():
    cameras = panoramas()[0]
    assert one_of_each_moment(cameras, [None] * len(cameras)) == cameras
    assert one_of_each_moment(cameras, range(len(cameras))) == cameras
    assert one_of_each_moment([], []) == []


def test_data_say_which_cameras_are_of_one_moment(tmp_path):
    def followed(folder: Path, moments: list[int | None]) -> list[int]:
        """Numbers of the cameras, by their places."""
        frames = [{"file_path": f"images/r_{k}", "transform_matrix": affine(np.eye(3), (0.2 * k, 0, 0)).tolist()}
                  | ({} if moment is None else {RIG_FRAME: moment}) for k, moment in enumerate(moments)]  # fmt: skip
        data = data_cameras(transforms_folder(folder, n=len(moments), frames=frames))
        assert len(data.cameras) == len(moments)
        return [round(camera.position[0] / 0.2) for camera in data.followed]

    assert followed(tmp_path / "none", [None] * 4) == [0, 1, 2, 3]
    assert followed(tmp_path / "some", [7, None, 7, 3, 3]) == [0, 1, 3]
