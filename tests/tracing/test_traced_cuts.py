"""Primitives that one plane or two cut off, on rays: against the float64 twin, a search and closed forms."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference import rays as twin
from mi_dogsplat.scene.row_groups import PLANES
from mi_dogsplat.scene.splats import Splats
from ray_sets import RaySet, gathered, random_rays, ray_set, traced_as_the_twin, tracer_of
from scipy.optimize import minimize_scalar
from splat_scenes import axis_rotation, make_splats, random_splats, rounded

Normals = tuple[list[float] | None, list[float] | None]  # of each plane; None where it does not cut
WAYS = "a cut", "a second cut", "both"
FROM_E4 = 1 + np.exp(-4.0)  # the largest factor of a cut


def cut_by(normals: Normals, splats: Any) -> Splats:
    """The first primitive cut off by these planes."""
    for plane, normal in zip(PLANES, normals, strict=True):
        if normal:
            (name,) = plane.names
            setattr(splats, plane.index, [0])
            setattr(splats, name, [normal])
    return rounded(splats)


def one(normals: Normals, scales=(0.3, 0.2, 0.1), opacity=0.9, **others) -> Splats:
    """A primitive at (.1, -.2, 4) that is turned, of three different scales."""
    quat = axis_rotation([1, 2, 0.5], 0.7)[1]
    return cut_by(normals, make_splats([[0.1, -0.2, 4.0]], [scales], opacity, 0.5, quat, **others))


def on_own_axes(splats: Splats, rays: RaySet) -> tuple[np.ndarray, np.ndarray]:
    """(origins, directions) of rays in standard deviations along the axes of the first primitive."""
    R, scales = reference.rotations(splats.quats.astype(float))[0], np.exp(splats.log_scales[0].astype(float))
    return (rays.origins - splats.means[0]).astype(float) @ R / scales, rays.directions.astype(float) @ R / scales


def left_at(w: np.ndarray, normals: Normals) -> np.ndarray:
    """Product of what planes leave of the kernels of a primitive at w [..., 3]."""
    return np.prod([FROM_E4 / (1 + np.exp(-4 - w @ np.array(normal))) for normal in normals if normal], axis=0)


@pytest.mark.parametrize(
    "normals", [([3, -2, 4], None), (None, [3, -2, 4]), ([3, -2, 4], [-1, 3, 2])], ids=WAYS)
@pytest.mark.parametrize("F", [None, [[1.6, 0.7, 1.2]]], ids=["Gaussian", "DoG"])
def test_alpha_is_that_of_the_whole_times_the_factor_where_a_search_finds_the_largest_primary(F, normals):
    others = {} if F is None else {"dog": [0], "f_a": 0.5, "F": F}
    splats, rays = one(normals, **others), random_rays(400, seed=1, bounded=False)
    o, d = on_own_axes(splats, rays)
    t = np.array([minimize_scalar(lambda t, o=o, d=d: np.sum((o + t * d) ** 2), bracket=(-1, 1), tol=1e-12).x  # pyright: ignore
                  for o, d in zip(o, d, strict=True)])
    left = left_at(o + t[:, None] * d, normals)
    alpha, whole = (1 - tracer_of(s).transmittance(rays.ray).numpy() for s in (splats, splats.without_cuts()))
    seen = (np.abs(whole) > 0.01) & (np.abs(whole * left) > 0.01)
    assert seen.sum() > 20 and left[seen].min() < 0.7 and left[seen].max() > 1.01
    np.testing.assert_allclose(alpha[seen], (whole * left)[seen], rtol=2e-3)
    gone = (np.abs(whole) > 0.01) & (np.abs(whole * left) < 0.5 / 255)
    assert gone.any() and not alpha[gone].any()


@pytest.mark.parametrize("cut_shares", [(0.5, 0), (0, 0.5), (0.5, 0.5)], ids=WAYS)
@pytest.mark.parametrize("slope_share", [0, 0.5])
@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_colours_and_shadows_are_those_of_the_twin(negative_transmittance, slope_share, cut_shares):
    splats = rounded(random_splats(200, 1, 3, 0.5, slope_share, *cut_shares))
    rays = random_rays(250, seed=2)
    for plane in (getattr(splats, plane.index) for plane, share in zip(PLANES, cut_shares, strict=True) if share):
        assert np.isin(splats.dog_index, plane).any() and 0 < len(plane) < 120
    options = {"negative_transmittance": negative_transmittance}
    colors, _, shadow = traced_as_the_twin(splats, rays, **options)
    whole = tracer_of(splats.without_cuts(), **options)
    for a, b in ((colors, gathered(whole, rays)[0]), (shadow, whole.transmittance(rays.ray).numpy())):
        assert np.abs(a - b).max() > 0.1


@pytest.mark.parametrize(
    "normals", [([-8, 3, 0], None), (None, [-8, 3, 0]), ([-8, 3, 0], [-1, 12, 0])], ids=WAYS)
@pytest.mark.parametrize("thickness", [1e-2, 1e-5, 1e-9])
def test_disks_of_any_thickness_are_cut_where_the_ray_meets_their_plane(thickness, normals):
    R, quat = axis_rotation([1, 2, 0.5], 0.7)
    centre, inside = np.array([0.2, -0.1, 4.0]), np.array([0.15, -0.05, 0])
    disk = cut_by(normals, make_splats([centre], [[0.3, 0.2, thickness]], 0.9, 0.5, quat))
    target = centre + R @ inside
    rays = ray_set([[0, 0, 0], [1, 0.5, 1]], [target, target - [1, 0.5, 1]])
    w = inside / [0.3, 0.2, 1]
    expected = 0.9 * np.exp(-0.5 * w @ w) * left_at(w, normals)
    alpha = 1 - tracer_of(disk).transmittance(rays.ray).numpy()
    np.testing.assert_allclose(alpha, [expected] * 2, atol=0.02 * (thickness == 1e-2) + 1e-4)


@pytest.mark.parametrize(
    ("splats", "reach"),
    [
        (one(([60, 0, 0], None), [0.3] * 3, 0.99 / 255), 0.045),
        (one(([1, 0, 0], None), [0.01] * 3, 0.5, dog=[0], f_a=0.99 / 255 / 0.5, F=100.0), 0.1),
        (one((None, [60, 0, 0]), [0.3] * 3, 0.99 / 255), 0.045),
        (one(([60, 0, 0], [60, 0, 0]), [0.3] * 3, 0.97 / 255), 0.045),
        (one(([1, 0, 0], [1, 0, 0]), [0.01] * 3, 0.5, dog=[0], f_a=0.97 / 255 / 0.5, F=100.0), 0.1),
    ],
    ids=["Gaussian", "pseudo-Gaussian", "Gaussian, by a second cut", "Gaussian, by both", "pseudo-Gaussian, by both"],
)
def test_what_only_the_factor_lifts_above_the_cutoff_is_drawn(splats, reach):
    """The whole kernel is below 1/255 everywhere; of the DoG primitive the pseudo-Gaussian is, far from the primary."""
    R = reference.rotations(splats.quats.astype(float))[0]
    target = splats.means[0] + np.linspace(0, reach, 50)[:, None] * R[:, 0]
    rays = ray_set(target - 2 * R[:, 1], R[:, 1])
    expected = twin.transmittance(rays.meet(splats))
    np.testing.assert_allclose(tracer_of(splats).transmittance(rays.ray).numpy(), expected, atol=1e-6)
    whole = tracer_of(splats.without_cuts()).transmittance(rays.ray).numpy()
    assert (expected != 1).sum() > (whole != 1).sum() + 10


def test_a_normal_of_zero_leaves_a_primitive_whole():
    splats, rays = rounded(random_splats(50, seed=3, cut_share=1, second_cut_share=1)), random_rays(100, seed=4)
    flat = replace(splats, cut_normals=0 * splats.cut_normals, second_cut_normals=0 * splats.second_cut_normals)
    for a, b in zip(gathered(tracer_of(flat), rays), gathered(tracer_of(splats.without_cuts()), rays), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-6)
