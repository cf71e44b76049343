"""Brightness that curves: its matrix, its average, and what is left of it in other models."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.export.bake import baked
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.curvatures import ENTRIES, matrices, mean_brightness, rows_of, turned
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from sloped_models import with_curvatures, with_slopes
from splat_scenes import C0, axis_rotation, image_of, make_camera, make_splats, random_splats, rasterized, rounded

ROWS = np.random.default_rng(0).normal(size=(5, 6))
W = np.random.default_rng(1).normal(size=(5, 40, 3))  # standard deviations


def brighter(rows: np.ndarray, w: np.ndarray) -> np.ndarray:
    """[B, P] ½ wᵀ Q w, term by term."""
    xx, yy, zz, xy, xz, yz = rows.T[:, :, None]
    x, y, z = np.moveaxis(w, -1, 0)
    return 0.5 * (xx * x * x + yy * y * y + zz * z * z) + xy * x * y + xz * x * z + yz * y * z


def test_a_row_is_the_matrix_of_its_quadratic_form_and_back():
    Q = matrices(ROWS)
    np.testing.assert_allclose(0.5 * np.einsum("bpi,bij,bpj->bp", W, Q, W), brighter(ROWS, W), rtol=1e-12)
    np.testing.assert_array_equal(Q, Q.swapaxes(1, 2))
    np.testing.assert_array_equal(rows_of(Q), ROWS)
    assert [Q[0, a, b] for a, b in ENTRIES] == ROWS[0].tolist()


def test_a_place_is_as_bright_when_it_is_told_by_turned_axes():
    turn = np.stack([axis_rotation(axis, 1.0)[0] for axis in W[:, 0]])
    there = np.einsum("bij,bpj->bpi", turn, W)
    np.testing.assert_allclose(brighter(turned(ROWS, turn), there), brighter(ROWS, W), rtol=1e-10, atol=1e-12)
    assert np.abs(turned(ROWS, turn) - ROWS).max() > 0.1


def from_side(quat: np.ndarray) -> Camera:
    """Turned at random about the origin, 3 units away from it."""
    return make_camera(48, 40, 60.0, w2c=affine(reference.rotations(quat[None])[0], (0, 0, 3)))


@pytest.mark.parametrize(
    ("scales", "row"),
    [((0.3, 0.3, 0.3), (1, 0, 0, 0, 0, 0)), ((0.3, 0.3, 0.3), (0.3, -0.8, 1.2, 0.4, 0, 1)),
     ((0.4, 0.1, 0.3), (0, 1, 0, 1, 0.5, -1)), ((0.4, 0.3, 0.06), (0.3, -0.8, 1.2, 0.4, 0, 1))],
)  # fmt: skip
def test_the_average_is_what_comes_nearest_in_pictures_from_all_sides(scales, row):
    """Oracle: of constant colours tried in pictures, the best one."""
    one = rounded(make_splats([[0, 0, 0]], [scales], 0.6, 0.5))
    curved = replace(one, curvature_index=[0], brightness_curvatures=[row])
    cameras = [from_side(axis) for axis in np.random.default_rng(3).normal(size=(100, 4))]

    def pictures(splats: Splats) -> np.ndarray:
        return np.stack([image_of(rasterized(splats, camera), camera).astype(np.float64) for camera in cameras])

    truth, plain = pictures(curved), pictures(one)
    by_color = (pictures(replace(one, sh_coeffs=one.sh_coeffs + np.float32(1 / C0))) - plain).ravel()
    best = by_color @ (truth - plain).ravel() / (by_color @ by_color)
    average = mean_brightness(np.array([row], float), np.log([scales]))[0]
    assert average == pytest.approx(best, abs=0.02)
    flat = curved.without_curvatures()
    assert flat.n_curvatures == 0
    np.testing.assert_allclose(flat.sh_coeffs[0, 0], one.sh_coeffs[0, 0] + average / C0, rtol=1e-5)


def test_without_slopes_means_without_curvatures_too_and_each_alone_leaves_the_other():
    splats = with_curvatures(with_slopes(random_splats(10)), every=3)
    assert splats.is_varied.tolist() == [i % 2 == 0 or i % 3 == 0 for i in range(10)]
    even = splats.without_slopes()
    assert not even.is_varied.any()
    np.testing.assert_array_equal(even.sh_coeffs, splats.without_curvatures().sh_coeffs)
    np.testing.assert_array_equal(splats.without_curvatures().color_slopes, splats.color_slopes)
    assert np.abs(even.sh_coeffs - splats.sh_coeffs).max() > 0.01


def test_radiance_in_another_unit_scales_them():
    splats = with_curvatures(random_splats(10))
    found = brightened(splats, 3.0).brightness_curvatures
    np.testing.assert_allclose(found, 3 * splats.brightness_curvatures, rtol=1e-6)


def test_a_baked_primitive_is_as_bright_at_each_place():
    splats = with_curvatures(random_splats(20, degree=0, dog_share=1), every=1)
    found = baked(splats)
    points = splats.means[:, None] + 0.1 * np.random.default_rng(2).normal(size=(20, 7, 3))

    def at(model: Splats) -> np.ndarray:
        axes = reference.rotations(model.quats.astype(np.float64))
        w = np.einsum("nka,npk->npa", axes, points - model.means[:, None]) / model.scales.astype(np.float64)[:, None]
        return brighter(model.brightness_curvatures.astype(np.float64), w)

    np.testing.assert_allclose(at(found), at(splats), rtol=1e-4, atol=1e-6)
    assert np.abs(found.brightness_curvatures / splats.brightness_curvatures - 1).max() > 0.1
