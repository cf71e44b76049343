"""The room of the panoramas: what hangs on its walls hangs there as it was photographed."""

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.support.srgb import srgb_to_linear

from benchmarks.poses.closed_room import HEIGHT, LENGTH, PICTURES, WIDTH, closed_room


def test_pictures_hang_upright_and_are_not_mirrored():
    room, n = closed_room(), 9
    for k, (picture, width) in enumerate(PICTURES):
        pixels = picture() / 255
        rows, columns = (np.arange(n) * side // n + side // (2 * n) for side in pixels.shape[:2])
        height = width * pixels.shape[0] / pixels.shape[1]
        across = 0.3 + width * ((columns + 0.5) / pixels.shape[1] - 0.5)  # [n] to the right of the wall's middle
        up = HEIGHT / 2 + 0.2 + height * (0.5 - (rows + 0.5) / pixels.shape[0])  # [n] above the floor
        away = (WIDTH if k % 2 == 0 else LENGTH) / 2
        z, x = (side.ravel() for side in np.meshgrid(up, across, indexing="ij"))
        turn = np.pi / 2 * k  # about the vertical, seen from above to the left
        towards = np.stack([x * np.cos(turn) - away * np.sin(turn), x * np.sin(turn) + away * np.cos(turn), z - 1.4])
        hit = room.ray_intersect(mi.Ray3f(mi.Point3f(0, 0, 1.4), dr.normalize(mi.Vector3f(towards))))
        shown = np.array(hit.bsdf().eval_diffuse_reflectance(hit))  # [3, n * n]
        expected = srgb_to_linear(pixels[np.ix_(rows, columns)].reshape(-1, 3)).T
        assert np.corrcoef(shown.ravel(), expected.ravel())[0, 1] > 0.95
