"""Places that depend on the view: what they are, and what becomes of them when a model is moved, stretched, made whole,
baked, written or divided."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest
from cut_models import with_cuts, with_second_cuts
from mi_dogsplat import read_ply, reference, write_ply
from mi_dogsplat.engine.motion import moved
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.export.bake import baked
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.linear_map import view_projection
from mi_dogsplat.scene.shifts import mean_views, seen_from
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.scene.whole import whole
from shifted_models import places_seen, with_shifts
from splat_scenes import axis_rotation, make_camera, random_splats, rounded, scalar_transform, tilted_camera

VIEWS = np.random.default_rng(0).normal(size=(9, 3))
VIEWS /= np.linalg.norm(VIEWS, axis=1, keepdims=True)
TURN = axis_rotation([1, -2, 0.5], 1.1)[0]
MIRROR = TURN @ np.diag([1.0, -1, 1])
SHEAR = np.array([[1.4, 0.3, 0], [0, 0.8, -0.2], [0.1, 0, 1.1]])


@pytest.fixture
def splats() -> Splats:
    return with_shifts(random_splats(14, seed=2, degree=1))


def of(linear: np.ndarray) -> np.ndarray:
    return affine(linear, (0.3, -2, 1))


def test_the_twin_sees_them_at_their_places(splats):
    camera = tilted_camera()
    views = splats.means[splats.shift_index].astype(np.float64) - camera.position
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    places = np.array([of_all[row] for row, of_all in enumerate(places_seen(splats, views))])
    pixels, depths = camera.project(places)
    projection = reference.project(splats, camera)
    assert projection.visible.all()
    np.testing.assert_allclose(projection.means2d[splats.shift_index], pixels, rtol=1e-9)
    np.testing.assert_allclose(projection.depths[splats.shift_index], depths, rtol=1e-9)
    found, expected = seen_from(splats, camera.position), splats.means.astype(np.float64)
    expected[splats.shift_index] = places
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_without_them_a_model_is_where_it_is_stored_and_only_its_place_changes(splats):
    still = splats.without_shifts()
    assert splats.n_shifts == 7 and still.n_shifts == 0
    camera = tilted_camera()
    with_them, without = (reference.project(s, camera) for s in (splats, still))
    apart = np.linalg.norm(with_them.means2d - without.means2d, axis=1)
    assert (apart[splats.shift_index] > 0.1).all() and not apart[1::2].any()
    np.testing.assert_array_equal(with_them.colors, without.colors)


def test_seen_from_the_mean_view_a_primitive_is_where_it_is_stored(splats):
    axes = reference.rotations(splats.quats[splats.shift_index].astype(np.float64))
    for row, of_primitive in enumerate(axes):
        view = of_primitive @ splats.mean_views[row].astype(np.float64)
        place = places_seen(splats, view[None])[row, 0]
        np.testing.assert_allclose(place, splats.means[splats.shift_index[row]], atol=1e-7)


@pytest.mark.parametrize("isometry", [TURN, MIRROR], ids=["turned", "mirrored"])
def test_they_go_along_with_a_similarity(splats, isometry):
    matrix = of(2.5 * isometry)
    after = transformed(splats, matrix)
    expected = places_seen(splats, VIEWS) @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(places_seen(after, VIEWS @ isometry.T), expected, atol=2e-6)
    np.testing.assert_array_equal(after.view_shifts, splats.view_shifts)


@pytest.mark.parametrize("isometry", [TURN, MIRROR], ids=["turned", "mirrored"])
def test_on_the_device_they_go_along_as_on_the_host(splats, isometry):
    matrix = of(2.5 * isometry)
    after, on_host = moved(upload(splats), mi.Transform4f(scalar_transform(matrix).matrix)), transformed(splats, matrix)
    for name in ("view_shifts", "mean_views"):
        np.testing.assert_array_equal(after[name].numpy(), getattr(on_host, name).ravel())


def test_of_other_maps_they_are_the_nearest_linear_ones(splats):
    """A fit to many directions, which knows no quadrature and no formula."""
    after = transformed(splats, of(SHEAR))
    rng = np.random.default_rng(3)
    seen = rng.normal(size=(40_000, 3))
    seen = np.concatenate([seen, -seen]) / np.linalg.norm(np.concatenate([seen, seen]), axis=1, keepdims=True)
    before = seen @ np.linalg.inv(SHEAR).T
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    np.testing.assert_allclose(view_projection(SHEAR), np.linalg.lstsq(seen, before, rcond=None)[0].T, atol=0.02)
    stretched = places_seen(splats, before[:500]) @ SHEAR.T + of(SHEAR)[:3, 3]
    moves = stretched - after.means[after.shift_index].astype(np.float64)[:, None]
    apart = np.linalg.norm(places_seen(after, seen[:500]) - stretched, axis=2).mean(axis=1)
    assert (apart < 0.15 * np.linalg.norm(moves, axis=2).mean(axis=1)).all()


def test_an_exact_linear_map_of_views_is_kept(splats):
    """Of a stretch by next to nothing the nearest linear function is exact, whatever becomes of the axes."""
    nearly = TURN @ np.diag([1.0, 1 + 2e-4, 1])
    after = transformed(splats, of(nearly))
    expected = places_seen(splats, VIEWS) @ nearly.T + of(nearly)[:3, 3]
    moves = np.abs(expected - after.means[after.shift_index].astype(np.float64)[:, None]).max()
    assert np.abs(places_seen(after, VIEWS @ TURN.T) - expected).max() < 1e-3 * moves


@pytest.mark.parametrize("having", [with_cuts, lambda splats: with_second_cuts(with_cuts(splats))], ids=["one", "two"])
def test_what_becomes_whole_moves_as_it_did(having):
    splats = having(with_shifts(random_splats(14, seed=2, degree=1), every=1))
    found = whole(splats)

    def moves(model: Splats) -> np.ndarray:
        return places_seen(model, VIEWS) - model.means[model.shift_index].astype(np.float64)[:, None]

    assert np.abs(found.log_scales - splats.log_scales).max() > 0.1
    np.testing.assert_allclose(moves(found), moves(splats), atol=2e-5)


def test_what_is_baked_moves_as_it_did(splats):
    found = baked(splats)
    both = np.isin(splats.shift_index, splats.dog_index)
    assert np.abs(found.log_scales - splats.log_scales)[splats.shift_index[both]].max() > 0.02
    np.testing.assert_allclose(places_seen(found, VIEWS), places_seen(splats, VIEWS), atol=2e-6)


def test_the_mean_view_is_that_of_all_cameras(splats):
    cameras = [make_camera(), tilted_camera(), make_camera(w2c=of(TURN))]
    found = mean_views(splats.means, splats.quats, np.array([camera.position for camera in cameras]))
    for i in range(splats.n_splats):
        axes = reference.rotations(splats.quats[i : i + 1].astype(np.float64))[0]
        offsets = [splats.means[i] - camera.position for camera in cameras]
        expected = np.mean([offset / np.linalg.norm(offset) for offset in offsets], axis=0) @ axes
        np.testing.assert_allclose(found[i], expected, atol=1e-6)


def test_a_camera_at_the_very_place_of_a_primitive_has_no_view_of_it():
    zero, one = np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]])
    np.testing.assert_array_equal(mean_views(zero, one, zero), zero)
    np.testing.assert_array_equal(mean_views(zero, one, np.array([[0.0, 0, 0], [0, 0, -2]])), [[0, 0, 0.5]])


def test_a_file_keeps_them_to_the_bit(splats, tmp_path):
    write_ply(tmp_path / "model.ply", splats)
    back = read_ply(tmp_path / "model.ply")
    for name in ("shift_index", "view_shifts", "mean_views"):
        np.testing.assert_array_equal(getattr(back, name), getattr(splats, name))


def test_a_file_without_them_is_the_one_from_before(splats, tmp_path):
    write_ply(tmp_path / "model.ply", splats.without_shifts())
    assert b"shift" not in (tmp_path / "model.ply").read_bytes()


def test_selected_and_joined_primitives_keep_theirs(splats):
    part = splats.select([4, 3, 0])
    np.testing.assert_array_equal(part.shift_index, [0, 2])
    np.testing.assert_array_equal(part.view_shifts, splats.view_shifts[[2, 0]])
    joined = part.joined(splats)
    np.testing.assert_array_equal(joined.shift_index, [0, 2, *(3 + splats.shift_index)])
    np.testing.assert_array_equal(joined.mean_views[2:], splats.mean_views)


def test_a_shape_that_does_not_fit_is_named(splats):
    with pytest.raises(ValueError, match=r'"mean_views" has 6 rows, "shift_index" has 7'):
        replace(splats, mean_views=splats.mean_views[1:])
    with pytest.raises(ValueError, match=r'"view_shifts" has shape \[7, 9\], expected \[7, 3, 3\]'):
        replace(splats, view_shifts=splats.view_shifts.reshape(7, 9))


def test_all_of_them_take_part_in_the_random_models_of_the_tests():
    splats = rounded(random_splats(40, shift_share=0.5))
    assert 5 < splats.n_shifts < 35
