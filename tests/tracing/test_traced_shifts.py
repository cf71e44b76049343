"""Primitives whose place depends on the view, on rays: against the float64 twin, and models that stand still."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.tracing.bounds import bounds_of
from mi_dogsplat.tracing.primitives import primitives_of
from ray_sets import decided, gathered, random_rays, ray_set, traced_as_the_twin, tracer_of
from same_numbers import assert_same_numbers
from shifted_models import places_seen, standing, with_shifts
from splat_scenes import make_splats, random_splats, rounded

VIEWS = [[0, 0, 1], [0, 0, -1], [0.6, 0, 0.8], [-0.48, 0.64, -0.6]]


def beside(direction: Any, n: int, seed: int, length: float = 1.0):
    """Parallel rays through what ``random_splats`` makes, from within it and from before it."""
    origins = np.random.default_rng(seed).uniform([-1.5, -1.2, 1.5], [1.5, 1.2, 5], (n, 3))
    origins[::2] -= 8 * np.asarray(direction)
    return ray_set(origins, np.asarray(direction, float) * length)


@pytest.mark.parametrize("view", VIEWS)
def test_on_parallel_rays_all_is_as_if_primitives_stood_where_they_are_seen(view):
    """Their places, their order, and what of them is within a segment; but for the colours that vary over them."""
    splats, rays = with_shifts(random_splats(100, seed=1)), beside(view, 250, seed=2, length=3.0)
    still = standing(splats, view)
    sure, moved = decided(still, rays), np.linalg.norm(still.means - splats.means, axis=1)
    assert sure.sum() > 200 and (moved > 0.1).sum() > 20
    for a, b in zip(gathered(tracer_of(splats), rays), gathered(tracer_of(still), rays), strict=True):
        np.testing.assert_allclose(a[sure], b[sure], atol=2e-5)
    shadows = [tracer_of(model).transmittance(rays.ray).numpy() for model in (splats, still, splats.without_shifts())]
    np.testing.assert_allclose(shadows[0][sure], shadows[1][sure], atol=2e-6, rtol=2e-5)
    assert np.abs(shadows[0] - shadows[2]).max() > 0.1


def test_the_twin_places_them_as_the_definition_says():
    splats, rays = with_shifts(random_splats(20, seed=3)), random_rays(30, seed=4)
    meetings = rays.meet(splats, smooth=True)
    for k in range(30):
        ray = rays.select(np.array([k]))
        view = ray.directions[0] / np.linalg.norm(ray.directions[0].astype(float))
        expected = ray.meet(standing(splats, view), smooth=True)
        for name in ("places", "alphas", "colors"):
            np.testing.assert_allclose(getattr(meetings, name)[k], getattr(expected, name)[0], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("share", [0, 0.5], ids=["alone", "beside all else"])
@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_colours_and_shadows_are_those_of_the_twin(negative_transmittance, share):
    splats = rounded(random_splats(200, 1, 3, 0.5, share, share, share, share, shift_share=0.5))
    assert np.isin(splats.dog_index, splats.shift_index).any() and splats.n_shifts < 120
    rays, options = random_rays(250, seed=2), {"negative_transmittance": negative_transmittance}
    colors, _, _ = traced_as_the_twin(splats, rays, **options)
    assert np.abs(colors - gathered(tracer_of(splats.without_shifts(), **options), rays)[0]).max() > 0.1


@pytest.mark.parametrize("thickness", [0.2, 1e-3, 1e-6])
def test_rays_to_places_far_off_meet_the_centre(thickness):
    """Moves of many standard deviations, which only a box of all places holds, and discs."""
    rng = np.random.default_rng(5)
    quat = rng.normal(size=(1, 4))
    splat: Any = make_splats([[0.1, -0.2, 4]], [[0.3, 0.2, thickness]], 0.9, 0.5, quat)
    splat.shift_index, splat.mean_views = [0], [[0.3, 0.2, -0.1]]
    splat.view_shifts = rng.normal(0, 10, (1, 3, 3)) * [[1], [1], [0]]  # within the disc
    splats = rounded(splat)
    directions = rng.normal(size=(200, 3))
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    places = places_seen(splats, unit)[0]
    assert np.linalg.norm(places - splats.means[0], axis=1).mean() > 1
    rays = ray_set(places - 2 * unit, directions)
    alpha = 1 - tracer_of(splats).transmittance(rays.ray).numpy()
    np.testing.assert_allclose(alpha, 0.9, atol=1e-4 if thickness > 1e-4 else 0.1)


def test_boxes_are_those_of_all_places():
    """They hold what is met in each direction, and are no larger than that."""
    splats = with_shifts(random_splats(40, seed=6), every=1)
    found, of_still = (bounds_of(primitives_of(upload(model), 3), 8) for model in (splats, splats.without_shifts()))
    views = np.random.default_rng(7).normal(size=(1000, 3))
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    places = places_seen(splats, views)  # [N, views, 3]
    for axis in range(3):
        low, high = np.array(found.low[axis]), np.array(found.high[axis])
        half = (np.array(of_still.high[axis]) - np.array(of_still.low[axis])) / 2
        least, most = places[:, :, axis].min(1), places[:, :, axis].max(1)
        reach, above, below = (most - least) / 2, high - half - most, least - half - low
        for slack in (above, below):
            assert (slack > -1e-5).all() and (slack < 0.02 * reach + 1e-4).all()


def test_no_shift_at_all_and_a_view_along_the_mean_one_change_nothing():
    splats, rays = with_shifts(random_splats(60, seed=8)), random_rays(120, seed=9)
    none = replace(splats, view_shifts=0 * splats.view_shifts)
    for a, b in zip(gathered(tracer_of(none), rays), gathered(tracer_of(splats.without_shifts()), rays), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-6)
    view = np.array([0.48, 0.6, 0.64])
    along = np.einsum("nxa,x->na", reference.rotations(splats.quats[splats.shift_index].astype(float)), view)
    splats, rays = replace(splats, mean_views=along), beside(view, 120, seed=10)
    sure = decided(splats.without_shifts(), rays)
    for a, b in zip(gathered(tracer_of(splats), rays), gathered(tracer_of(splats.without_shifts()), rays), strict=True):
        np.testing.assert_allclose(a[sure], b[sure], atol=2e-5)


def test_primitives_that_stay_have_the_bits_of_a_model_without_shifts():
    """One far off has a shift; the others pay no digit for it."""
    still = rounded(random_splats(30, seed=19)).joined(rounded(make_splats([[500.0, 0, 0]])).uniform_sh(3))
    one = replace(still, shift_index=[30], view_shifts=np.ones((1, 3, 3)), mean_views=np.zeros((1, 3)))
    rays = random_rays(200, seed=20)
    for a, b in zip(gathered(tracer_of(one), rays), gathered(tracer_of(still), rays), strict=True):
        assert_same_numbers(a, b)
