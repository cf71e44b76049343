"""One kernel fuses every view: none is compiled anew for another camera, size of pictures or number of blocks."""

import numpy as np
import pytest
from mi_dogsplat.meshing.blocks import BlockFinder
from mi_dogsplat.meshing.fusion import Fusion
from mi_dogsplat.scene.cameras import Camera
from splat_scenes import kernels, make_camera, tilted_camera


def added(camera: Camera, n: int, voxel: float = 0.1, near: float = 0.4) -> set[str]:
    """Kernels that bring a view of some points' blocks to a new sum."""
    rng = np.random.default_rng(n)
    finder = BlockFinder(np.array([0.0, 0.0, 3.0]), voxel, 4 * voxel)
    finder.add(rng.uniform([-1, -1, 2], [1, 1, 4], (n, 3)))
    fusion = Fusion(finder.blocks(), 4 * voxel)
    depth = rng.uniform(1, 5, (camera.height, camera.width)).astype(np.float32)

    def run():
        for _ in range(2):
            fusion.add(camera, depth, near)
        fusion.distances()

    return kernels(run)


@pytest.mark.parametrize("n", [1, 40])
def test_one_kernel_fuses_all_views(n):
    first = added(make_camera(64, 48), 9)
    assert len(first) <= 2
    assert added(tilted_camera(31, 23, 25.0), n, 0.03, 0.0) <= first
    assert added(make_camera(16, 20, 5.0), n, 2.0) <= first
