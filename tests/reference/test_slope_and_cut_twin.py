"""What holds for slopes and for cuts in the float64 twin: in samples of space, against differences, on rays."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from every_pair import every_pair
from mi_dogsplat import reference
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.reference.forward import RAW_PARAMETERS, colors_at
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.reference.rays import gather, meet
from own_axes_models import CURVED, CUT, EACH_KIND, KINDS, PLANE_KINDS, SECOND_CUT, SLOPED, Kind
from splat_scenes import axis_rotation, make_camera, make_splats, random_splats, rounded, tilted_camera
from tiled_twin import BACKGROUND, MODES, SMALL, SMOOTH, adjoint_of, assert_gradients_near, assert_images_equal

ADJOINT = adjoint_of(SMALL)


def for_each_kind(name: str, slopes: Any, curvatures: Any, cuts: Any) -> pytest.MarkDecorator:
    """A test of each as ``kind``, with an argument ``name`` of which planes have the same."""
    cases = [(SLOPED, slopes), (CURVED, curvatures), *((kind, cuts) for kind in PLANE_KINDS)]
    return pytest.mark.parametrize(("kind", name), cases, ids=[kind.word for kind in KINDS])


def per_pixel(p: Any, kind: Kind) -> np.ndarray:
    """[N, …, 2] what a projection has of it."""
    return p.slopes if kind is SLOPED else p.cuts[PLANE_KINDS.index(kind)]


def test_curvatures_are_those_of_the_mean_that_a_pixel_sees():
    """w of it, as slopes along each axis alone tell it: w_a is what a slope of 1 adds to a channel."""
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    shape: Any = ([0.2, -0.1, 3], (0.2, 0.1, 0.3))
    camera, values = tilted_camera(f=20.0), np.array([0.5, -1, 0.8, 0.3, -0.7, 0.4])
    to_w = reference.project(SLOPED.given(make_splats(*shape, quats=quat), np.eye(3)), camera).slopes[0]  # [axis, 2]
    splats = CURVED.given(make_splats(*shape, quats=quat, colors=0.4), values)
    p, d = reference.project(splats, camera), np.random.default_rng(2).normal(size=(30, 2))
    w = d @ to_w.T
    xx, yy, zz, xy, xz, yz = values
    x, y, z = w.T
    expected = (xx * x**2 + yy * y**2 + zz * z**2) / 2 + xy * x * y + xz * x * z + yz * y * z
    got = colors_at(p, 0, *(p.means2d[0] + d).T) - p.colors[0]
    np.testing.assert_allclose(got, np.repeat(expected[:, None], 3, 1), atol=1e-12)
    assert np.abs(expected).max() > 1


LINEAR = [(SLOPED, np.random.default_rng(1).normal(size=(3, 3))), *((k, np.array([1.0, -2, 0.7])) for k in PLANE_KINDS)]


def test_a_pixel_sees_the_mean_of_what_lies_behind_it():
    """Samples of a turned primitive, blurred by the filter: the regression of what they have on the place in the image.

    For cuts that is n.w.
    """
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    splats = make_splats([0.2, -0.1, 3], (0.2, 0.1, 0.3), quats=quat)
    camera = tilted_camera(f=20.0)
    p, R = reference.project(splats, camera), reference.rotations(splats.quats)[0]
    samples = np.random.default_rng(0).normal(size=(1000, 5))  # three numbers of the primitive, two of the filter
    samples = np.concatenate([samples, -samples])
    samples = np.linalg.solve(np.linalg.cholesky(np.cov(samples.T)), samples.T).T  # as uncorrelated as all there are
    w, blur = samples[:, :3], samples[:, 3:]
    offsets = w * 1e-3 * np.exp(splats.log_scales[0]) @ R.T  # so near that the projection is linear
    d = (camera.project(splats.means[0] + offsets)[0] - p.means2d[0]) / 1e-3 + np.sqrt(reference.LOW_PASS) * blur
    to_d = np.linalg.lstsq(d, w, rcond=None)[0].T  # [3, 2]
    for kind, values in LINEAR:
        projected = per_pixel(reference.project(kind.given(splats, values), camera), kind)[0]
        np.testing.assert_allclose(values.T @ to_d, projected, atol=1e-6 * np.abs(projected).max(), err_msg=kind.word)


# --- images ---


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("dog_share", [0, 0.5])
@pytest.mark.parametrize("choices", MODES)
@pytest.mark.parametrize("shares", [{"slope_share": 0.6}, {"slope_share": 0.4, "cut_share": 0.6},
                                    {"cut_share": 0.5, "second_cut_share": 0.5}, {"curvature_share": 0.6},
                                    {"slope_share": 0.5, "curvature_share": 0.5, "cut_share": 0.5}],
                         ids=["slopes", "slopes and cuts", "both planes", "curvatures", "three kinds"])  # fmt: skip
def test_the_tiled_twin_shows_what_the_plain_one_does(shares, dog_share, smooth, choices):
    splats = random_splats(60, seed=1, dog_share=dog_share, **shares)
    assert_images_equal(splats, tilted_camera(53, 37), smooth, **choices)


@for_each_kind("atol", 1e-15, 1e-15, 1e-14)
def test_zeros_change_nothing(kind: Kind, atol):
    splats, camera = rounded(random_splats(20, seed=1)), tilted_camera(53, 37)
    zero = replace(splats, **{kind.group.index: np.arange(20), kind.name: np.zeros((20, *kind.shape))})
    expected = render_tiled(splats, camera).image
    np.testing.assert_allclose(render_tiled(zero, camera).image, expected, atol=atol)


@for_each_kind("places", [(2, 1, 0), (3, 0, 2)], [(2, 1), (3, 5)], [(2, 1), (3, 0)])
def test_a_primitive_whose_values_are_not_finite_is_not_visible(kind: Kind, places):
    splats = kind.drawn(1, 5)
    for place, value in zip(places, (np.nan, np.inf), strict=True):
        kind.values(splats)[place] = value
    np.testing.assert_array_equal(reference.project(splats, make_camera()).visible, [True, True, False, False, True])


# --- gradients ---


@every_pair(shares=[{"slope_share": 0.5}, {"slope_share": 1}, {"cut_share": 0.5}, {"cut_share": 1},
                    {"slope_share": 0.5, "cut_share": 0.5}, {"slope_share": 0.5, "cut_share": 1},
                    {"second_cut_share": 0.5}, {"slope_share": 0.5, "cut_share": 0.6, "second_cut_share": 0.5},
                    {"cut_share": 1, "second_cut_share": 1}, {"curvature_share": 0.5}, {"curvature_share": 1},
                    {"slope_share": 0.5, "curvature_share": 0.6, "cut_share": 0.6, "second_cut_share": 0.5}],
            dog_share=[0, 0.5], antialiased=[False, True], negative_transmittance=[True, False])  # fmt: skip
def test_gradients_of_every_parameter_equal_differences(shares, dog_share, antialiased, negative_transmittance):
    choices = {"antialiased": antialiased, "negative_transmittance": negative_transmittance}
    splats = random_splats(4, seed=9, degree=1, dog_share=dog_share, **shares)
    kinds = [kind for kind in KINDS if kind.share in shares]
    for n, share in [(len(kind.index(splats)), shares[kind.share]) for kind in kinds]:
        assert (n == 4) == (share == 1) and n > 1
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, background=BACKGROUND, **choices)
    got = gradients_tiled(splats, SMALL, ADJOINT, BACKGROUND, **choices, **SMOOTH)
    assert tuple(got) == (*RAW_PARAMETERS, *(kind.name for kind in kinds))
    least = dict.fromkeys((CUT.name, SECOND_CUT.name), 1e-3)  # the image depends less on normals than on all else
    assert all(np.abs(values).max() > least.get(name, 1e-2) for name, values in got.items() if values.size)
    assert_gradients_near(got, expected)


@EACH_KIND
def test_primitives_that_are_not_seen_have_no_gradient(kind: Kind):
    splats = kind.drawn(0.7, 9, seed=8)
    got = gradients_tiled(splats, SMALL, ADJOINT, near_clip=2.5)[kind.name].reshape(-1, np.prod(kind.shape))
    seen = reference.project(splats, SMALL, near_clip=2.5).visible[kind.index(splats)]
    assert 0 < seen.sum() < len(seen)
    assert got[seen].any(1).all() and not got[~seen].any()
    none = gradients_tiled(splats, SMALL, ADJOINT, near_clip=100.0)
    assert none[kind.name].shape == getattr(splats, kind.name).shape and not any(g.any() for g in none.values())


@pytest.mark.parametrize("groups", [
    {"slope_index": [1, 2, 5], "color_slopes": np.ones((3, 3, 3)) / 3},
    {"slope_index": [1, 2], "color_slopes": np.ones((2, 3, 3)) / 3,
     "cut_index": [2, 3, 5], "cut_normals": np.ones((3, 3))},
    {"slope_index": [1, 2], "color_slopes": np.ones((2, 3, 3)) / 3, "cut_index": [2, 3, 5],
     "cut_normals": np.ones((3, 3)), "second_cut_index": [0, 3], "second_cut_normals": np.ones((2, 3))},
    {"curvature_index": [0, 4], "brightness_curvatures": np.ones((2, 6)) / 3},
], ids=["slopes", "slopes and cuts", "cuts of both planes", "curvatures"])  # fmt: skip
def test_a_mixed_model_has_gradients_of_all_groups(groups):
    splats = replace(rounded(random_splats(6, seed=3)).with_sh_degrees(np.arange(6) % 3), **groups)
    expected = reference.loss_gradients(splats, SMALL, ADJOINT)
    got = gradients_tiled(splats, SMALL, ADJOINT, **SMOOTH)
    own = (name for name in groups if not name.endswith("_index"))
    assert tuple(got) == (*RAW_PARAMETERS, *own, "sh1_coeffs", "sh2_coeffs")
    assert_gradients_near(got, expected)


# --- scores and rays ---


@for_each_kind("values", np.arange(9) / 9, np.arange(6) / 9, (3, -5, 1))
def test_a_footprint_is_what_the_picture_gains_with_the_primitive(kind: Kind, values):
    """Of one that hides nothing: its alpha times its colour less that of the background, at each pixel."""
    splats, camera = kind.given(make_splats([0, 0, 2], 0.3, 0.6), values), make_camera(20, 16, 20.0)
    footprint = reference_score.footprints(splats, camera, BACKGROUND)[0]
    with_it = reference.render(splats, camera, BACKGROUND)[0] - BACKGROUND
    alpha = reference_score.weights(splats, camera)[0][0]
    np.testing.assert_allclose(footprint * alpha, 0.6 * with_it.sum(-1), atol=1e-12)
    assert alpha.max() > 0.5


@for_each_kind("values", np.arange(9) / 9, np.arange(6) / 9, (3, 5, -4))
def test_a_ray_sees_what_a_pixel_does_where_the_primitive_is_small_and_the_filter_smaller(kind: Kind, values):
    camera = make_camera(20, 16, 4000.0)
    splats = kind.given(make_splats([0, 0, 2], (0.002, 0.003, 0.001), 0.6), values)
    image = reference.render(splats, camera, smooth=True)[0]
    x, y = reference.pixel_centres(0, 0, 20, 16)
    directions = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
    colors, _ = gather(meet(splats, np.zeros((len(x), 3)), directions, smooth=True), smooth=True)
    np.testing.assert_allclose(colors.reshape(image.shape), image, atol=0.02 * np.ptp(image))
