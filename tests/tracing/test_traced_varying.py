"""Colours that vary over their primitive, by slopes, by curvatures or both, on rays: against the float64 twin, a search
and closed forms."""

from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.scene.curvatures import rows_of
from mi_dogsplat.scene.splats import Splats
from ray_sets import gathered, random_rays, ray_set, traced_as_the_twin, tracer_of
from same_numbers import assert_same_numbers
from scipy.optimize import minimize_scalar
from splat_scenes import axis_rotation, make_splats, random_splats, rounded

SLOPES = np.array([[0.1, -0.2, 0.3], [0.4, 0.05, -0.1], [-0.3, 0.2, 0.15]])  # axis, channel
Q = np.array([[0.3, -0.15, 0.1], [-0.15, -0.2, 0.05], [0.1, 0.05, 0.25]])
WAYS = "slopes", "curvatures", "both"
EACH_WAY = pytest.mark.parametrize("way", WAYS)


def varied(way: str, splats: Any) -> Splats:
    """The first primitive has slopes, curvatures or both."""
    if way != "curvatures":
        splats.slope_index, splats.color_slopes = [0], SLOPES[None]
    if way != "slopes":
        splats.curvature_index, splats.brightness_curvatures = [0], rows_of(Q[None])
    return rounded(splats)


def beyond(way: str, w: np.ndarray) -> np.ndarray:
    """[..., 3] what its colour has at w [..., 3] beyond that of its centre."""
    slopes = w @ SLOPES * (way != "curvatures")
    return slopes + 0.5 * np.einsum("...a,ab,...b->...", w, Q, w)[..., None] * (way != "slopes")


def one(way: str, colors, **others) -> Splats:
    """A primitive at (.1, -.2, 4) that is turned, of three different scales."""
    quat = axis_rotation([1, 2, 0.5], 0.7)[1]
    return varied(way, make_splats([[0.1, -0.2, 4.0]], [[0.3, 0.2, 0.1]], 0.9, colors, quat, **others))


@EACH_WAY
def test_the_twin_has_the_colour_where_a_search_finds_the_largest_kernel(way):
    splats, rays = one(way, [[0.5, 0.4, 0.6]]), random_rays(40, seed=1, bounded=False)
    colors = rays.meet(splats, smooth=True).colors[:, 0]
    R, scales = reference.rotations(splats.quats.astype(float))[0], np.exp(splats.log_scales[0].astype(float))
    base = splats.sh_coeffs[0, 0] * 0.28209479177387814 + 0.5

    def local(o, d, t):
        return R.T @ (o + t * d - splats.means[0]) / scales

    for color, o, d in zip(colors, rays.origins.astype(float), rays.directions.astype(float), strict=True):
        t = minimize_scalar(lambda t, o=o, d=d: np.sum(local(o, d, t) ** 2), bracket=(-1, 1), tol=1e-12).x  # pyright: ignore
        np.testing.assert_allclose(color, base + beyond(way, local(o, d, t)), atol=1e-6)


@EACH_WAY
@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_colours_are_those_of_the_twin(negative_transmittance, way):
    """With both some primitives have slopes, some curvatures, some both and some neither."""
    shares = {"slope_share": 0.5 * (way != "curvatures"), "curvature_share": 0.5 * (way != "slopes")}
    splats, rays = rounded(random_splats(200, seed=1, **shares)), random_rays(250, seed=2)
    n = splats.is_varied.sum()
    assert splats.is_varied[splats.dog_index].any() and splats.n_slopes < 120 and splats.n_curvatures < 120
    assert n < splats.n_slopes + splats.n_curvatures if way == "both" else n > 80
    options = {"negative_transmittance": negative_transmittance}
    colors, T, _ = traced_as_the_twin(splats, rays, **options)
    without, T_without = gathered(tracer_of(splats.without_slopes(), **options), rays)
    assert np.abs(colors - without).max() > 0.1
    assert_same_numbers(T, T_without)


@EACH_WAY
def test_the_colour_of_the_centre_is_kept_from_below_0_and_the_sum_is_not(way):
    base = np.array([0.2, -0.4, 0.6])
    splats, rays = one(way, [base]), random_rays(200, seed=3, bounded=False)
    colors, T = gathered(tracer_of(splats), rays)
    seen = 1 - T > 0.05
    R, scales = reference.rotations(splats.quats.astype(float))[0], np.exp(splats.log_scales[0].astype(float))
    o, d = (rays.origins - splats.means[0]) @ R / scales, rays.directions @ R / scales
    w = o - d * ((o * d).sum(1) / (d * d).sum(1))[:, None]
    expected = np.maximum(base, 0) + beyond(way, w)
    np.testing.assert_allclose(colors[seen] / (1 - T[seen])[:, None], expected[seen], atol=1e-4)
    assert colors[seen].min() < -0.01


@EACH_WAY
def test_a_pseudo_gaussian_has_the_colour_that_its_primary_has_there(way):
    """So the colour over alpha is that of the Gaussian alone, and what varies is told per deviation of the primary."""
    dog, plain = one(way, [[0.5, 0.4, 0.6]], dog=[0], f_a=0.4, F=0.6), one(way, [[0.5, 0.4, 0.6]])
    rays = random_rays(300, seed=4, bounded=False)
    (colors, T), (of_plain, T_plain) = (gathered(tracer_of(splats), rays) for splats in (dog, plain))
    seen = 1 - T > 0.05
    assert seen.sum() > 20 and not np.allclose(T[seen], T_plain[seen], atol=0.01)
    ratio, of_plain = (c[seen] / (1 - left[seen])[:, None] for c, left in ((colors, T), (of_plain, T_plain)))
    np.testing.assert_allclose(ratio, of_plain, atol=2e-4)


@EACH_WAY
@pytest.mark.parametrize("thickness", [1e-2, 1e-5, 1e-9])
def test_disks_of_any_thickness_have_the_colour_of_where_the_ray_meets_their_plane(thickness, way):
    R, quat = axis_rotation([1, 2, 0.5], 0.7)
    centre, inside = np.array([0.2, -0.1, 4.0]), np.array([0.15, -0.05, 0])
    disk = varied(way, make_splats([centre], [[0.3, 0.2, thickness]], 0.9, 0.5, quat))
    target = centre + R @ inside
    colors, T = gathered(tracer_of(disk), ray_set([[0, 0, 0], [1, 0.5, 1]], [target, target - [1, 0.5, 1]]))
    expected = 0.5 + beyond(way, inside / [0.3, 0.2, 1])
    np.testing.assert_allclose(colors / (1 - T)[:, None], [expected] * 2, atol=0.02 * (thickness == 1e-2) + 1e-4)


@EACH_WAY
def test_shadows_stay_as_they_are(way):
    shares: dict[str, Any] = {"slope_share": float(way != "curvatures"), "curvature_share": float(way != "slopes")}
    splats, rays = rounded(random_splats(50, seed=9, **shares)), random_rays(100, seed=10)
    shadow, without = (tracer_of(of).transmittance(rays.ray).numpy() for of in (splats, splats.without_slopes()))
    np.testing.assert_array_equal(shadow, without)
    assert (shadow < 1).any()
