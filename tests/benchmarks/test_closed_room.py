"""The room of the panoramas: what hangs on its walls hangs there as it was photographed."""

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.support.srgb import srgb_to_linear

from benchmarks.poses.closed_room import HEIGHT, LENGTH, PICTURES, WIDTH, closed_room, distances, surfaces


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


def test_what_rays_meet_is_on_the_surfaces_and_nothing_else_is():
    room, n = closed_room(), 3000
    flat, rng = surfaces(room), np.random.default_rng(0)
    towards = mi.Vector3f(rng.normal(size=(3, n)))
    hit = room.ray_intersect(mi.Ray3f(mi.Point3f(0, 0, 1.4), dr.normalize(towards)))
    places = hit.p.numpy().T
    assert len(flat) == 6 + 1 + 4 + 4 * 6
    assert distances(places, flat).max() < 1e-5
    inwards = places + 0.05 * (np.array([0, 0, 1.4]) - places) / np.array(hit.t)[:, None]
    off = distances(inwards, flat)  # at most as far as they were moved; at right angles to a surface, as far
    slant = np.abs(np.sum(hit.n.numpy().T * (inwards - places), axis=1))
    assert off.max() < 0.05 + 1e-5 and np.mean(np.abs(off - slant) < 1e-5) > 0.8
    np.testing.assert_allclose(distances(np.array([[0.0, 0, 1.4], [0, 0, -1]]), flat), [1.39, 1], rtol=1e-6)
