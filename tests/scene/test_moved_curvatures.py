"""Curvatures go along where their primitive goes: under maps on the host and on the device, and to a whole one."""

from collections.abc import Callable
from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest
from cut_models import flattened, with_cuts, with_second_cuts
from mi_dogsplat.engine.motion import moved
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.scene.whole import whole
from places import points_in
from sloped_models import curvature_brightness, slope_colors, with_curvatures, with_slopes
from splat_scenes import C0, axis_rotation, random_splats

TURN = axis_rotation([1, -2, 0.7], 2.1)[0]
MIRROR = np.eye(3) - 2 * np.outer([0.6, 0, 0.8], [0.6, 0, 0.8])
SHEAR = np.array([[1.2, 0.5, 0], [0, 0.7, -0.3], [0.1, 0, 2.0]])
SIMILARITIES = {"turn": TURN, "mirror": MIRROR, "scale": 1.7 * np.eye(3), "point mirror": -0.4 * TURN}
MAPS = SIMILARITIES | {"shear": SHEAR, "mirrored shear": SHEAR @ MIRROR, "stretch": np.diag([1.0, 1, 3])}
PLANES: dict[str, Callable[..., Splats]] = {
    "a cut": with_cuts,
    "a second cut": with_second_cuts,
    "both": lambda splats, every: with_second_cuts(with_cuts(splats, every), every),
}


def matrix_of(linear: np.ndarray) -> np.ndarray:
    return affine(linear, (0.4, -0.3, 0.2))


def some_flat() -> Splats:
    splats = with_curvatures(random_splats(60))
    splats.log_scales[::3, 1] = -6
    return splats


def assert_as_bright(before: Splats, after: Splats, matrix: np.ndarray):
    points = points_in(before, before.curvature_index)
    seen = curvature_brightness(before, points)
    assert seen.std() > 0.2
    found = curvature_brightness(after, points @ matrix[:3, :3].T + matrix[:3, 3])
    np.testing.assert_allclose(found, seen, atol=1e-3)  # rounding of means, in units of the thinnest scale


@pytest.mark.parametrize("linear", MAPS.values(), ids=MAPS)
def test_a_place_is_as_bright_as_before_it_was_moved(linear):
    splats, matrix = some_flat(), matrix_of(linear)
    assert_as_bright(splats, transformed(splats, matrix), matrix)


@pytest.mark.parametrize("linear", SIMILARITIES.values(), ids=SIMILARITIES)
def test_so_it_is_on_the_device(linear):
    splats, matrix = some_flat(), matrix_of(linear)
    params = moved(upload(splats), mi.Transform4f(matrix))
    arrays = {name: params[name].numpy() for name in ("means", "log_scales", "quats", "brightness_curvatures")}
    found = {name: values.reshape(getattr(splats, name).shape) for name, values in arrays.items()}
    assert_as_bright(splats, replace(splats, **found), matrix)


def colors_at(splats: Splats, points: np.ndarray) -> np.ndarray:
    """[N, P, 3] colours of primitives of SH degree 0 at points [N, P, 3], each at its own."""
    colors = 0.5 + C0 * np.repeat(splats.sh_coeffs[:, :1].astype(np.float64), points.shape[1], axis=1)
    colors[splats.slope_index] += slope_colors(splats, points[splats.slope_index])
    colors[splats.curvature_index] += curvature_brightness(splats, points[splats.curvature_index])[..., None]
    return colors


@pytest.mark.parametrize("given", PLANES.values(), ids=PLANES)
def test_each_place_of_a_flat_primitive_that_becomes_whole_keeps_its_colour(given):
    """Where there are slopes, which take what is linear about the new centre."""
    splats = flattened(given(with_curvatures(with_slopes(random_splats(30, degree=0), every=1)), every=1))
    points = points_in(splats)
    found = whole(splats)
    np.testing.assert_allclose(colors_at(found, points), colors_at(splats, points), atol=5e-3)
    only_slopes = whole(replace(splats, curvature_index=[], brightness_curvatures=np.zeros((0, 6))))
    assert np.abs(found.sh_coeffs - only_slopes.sh_coeffs).max() > 0.02
    assert np.abs(found.color_slopes - only_slopes.color_slopes).max() > 0.02


@pytest.mark.parametrize("given", PLANES.values(), ids=PLANES)
def test_where_there_are_no_slopes_opposite_places_keep_theirs_together(given):
    """About the new centre, nothing is lost but what is linear."""
    splats = flattened(given(with_curvatures(random_splats(30, degree=0), every=1), every=1))
    found = whole(splats)
    there = points_in(found, np.arange(30))
    opposite = 2 * found.means.astype(np.float64)[:, None] - there
    after, before = (colors_at(of, there) + colors_at(of, opposite) for of in (found, splats))
    np.testing.assert_allclose(after, before, atol=5e-3)
    assert np.abs(colors_at(found, there) - colors_at(splats, there)).max() > 0.05
    assert not found.n_slopes


def test_slopes_of_others_stay_as_they_are_where_primitives_have_curvatures_alone():
    """Each third primitive has slopes, each second one curvatures; two planes cut off all."""
    splats = with_curvatures(with_slopes(random_splats(30, degree=0), every=3), every=2)
    found = whole(PLANES["both"](splats, every=1))
    alone = whole(PLANES["both"](replace(splats, curvature_index=[], brightness_curvatures=np.zeros((0, 6))), every=1))
    np.testing.assert_array_equal(found.slope_index, splats.slope_index)
    np.testing.assert_array_equal(found.color_slopes[1::2], alone.color_slopes[1::2])
    assert np.abs(found.color_slopes[::2] - alone.color_slopes[::2]).max() > 0.02
