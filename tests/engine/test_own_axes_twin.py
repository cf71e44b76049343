"""Slopes, curvatures and cuts: what the engine makes of them against the float64 twin and differences."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from every_pair import every_pair
from forward_mode import pushed, pushed_differences, random_directions
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.reference.forward import raw_names
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.reference.own_axes import index_of, quadratic_forms, values_of
from mi_dogsplat.scene.splats import Splats
from own_axes_models import KINDS
from read_together import read_gradients
from splat_scenes import (
    SMOOTH_OPTIONS,
    assert_gradients_equal,
    attached,
    image_of,
    mismatches,
    options,
    plane_of,
    random_splats,
    rasterized,
    rounded,
    tilted_camera,
)

GROUPS = tuple(kind.group for kind in KINDS)
BACKGROUND = (0.2, -0.3, 0.6)
CAMERA = tilted_camera(24, 20, f=20.0, cx=11.0, cy=10.5)
LARGE = tilted_camera(90, 70, f=80.0)
ADJOINT = np.random.default_rng(0).normal(size=(20, 24, 3))
MODES = {"antialiased": (False, True), "negative_transmittance": (True, False)}
SHARES = {"slopes": (0.6, 0, 0, 0), "cuts": (0, 0, 0.6, 0), "slopes and cuts": (0.6, 0, 0.6, 0),
          "cuts of all": (0, 0, 1, 0), "second cuts": (0, 0, 0, 0.6), "curvatures": (0, 0.6, 0, 0),
          "slopes and curvatures": (0.6, 0.6, 0, 0), "all of them": (0.6, 0.6, 0.6, 0.6)}  # fmt: skip
"""Of primitives with slopes, with curvatures, with cuts and with second cuts."""
CUTOFFS = {"cutoffs": ({}, {}), "smooth": (SMOOTH_OPTIONS, {"min_alpha": 0, "min_transmittance": 0})}
"""Of the engine and of the tiled twin."""
CASES = every_pair(varies=SHARES, dog_share=(0, 0.5), **MODES, kind=CUTOFFS)


def among_cases(*names: str, **wanted: Any) -> pytest.MarkDecorator:
    """Those of ``CASES`` with these values, of which a test takes the parameters ``names``: it shares their kernels."""
    columns, cases = CASES.args
    chosen = [dict(zip(columns, case, strict=True)) for case in cases]
    chosen = [case for case in chosen if all(case[name] in values for name, values in wanted.items())]
    return pytest.mark.parametrize(names, [[case[name] for name in names] for case in chosen])


def model(kind: str, n=10, seed=3, degree=1, dog_share=0.5) -> Splats:
    shares: dict[str, Any] = {each.share: share for each, share in zip(KINDS, SHARES[kind], strict=True)}
    splats = rounded(random_splats(n, seed, degree, dog_share, **shares))
    assert [each.n(splats) > 0 for each in KINDS] == [share > 0 for share in SHARES[kind]]
    return splats


def decided(splats: Splats, camera, **choices) -> np.ndarray:
    """[H, W] pixels where no cutoff hangs on rounding."""
    strict, lenient = (render_tiled(splats, camera, moved=moved, **choices).image for moved in (1e-4, -1e-4))
    return np.abs(strict - lenient).max(-1) < 1e-12


# --- projection and pictures ---


def test_what_changes_per_pixel_is_that_of_the_twin():
    splats = model("all of them", 300)
    ours, twin = project(upload(splats), DeviceCamera.upload(LARGE), sh_degree=1), reference.project(splats, LARGE)
    assert ours.slopes is not None and ours.cuts is not None
    np.testing.assert_array_equal(ours.visible.numpy(), twin.visible)
    slopes = np.stack([g.numpy() for g in ours.slopes]).reshape(2, 3, 300).transpose(2, 1, 0)
    cuts = np.stack([h.numpy() for h in ours.cuts]).reshape(2, 1, 2, 300) * np.log(2)  # the engine's exponents are of 2
    assert ours.curvatures is not None
    qxx, qxy, qyy = (q.numpy() for q in ours.curvatures)
    curvatures = np.array([[2 * qxx, qxy], [qxy, 2 * qyy]]).transpose(2, 0, 1)
    planes = zip(cuts.transpose(0, 3, 1, 2), twin.cuts[:, :, None], twin.cut, strict=True)
    of_kinds = (slopes, twin.slopes, twin.sloped), (curvatures, twin.curvatures, twin.curved), *planes
    for (got, expected, some), terms, kind in zip(of_kinds, terms_of_sums(splats), KINDS, strict=True):
        index = kind.index(splats)
        assert not got[~np.isin(np.arange(300), index)].any() and 100 < some.sum() < 250
        size = np.zeros((300, 1, 1))
        size[index, 0, 0] = terms.max((1, 2))
        assert (np.abs(got - expected) <= 1e-5 * size)[some].all()


def terms_of_sums(splats: Splats) -> list[np.ndarray]:
    """What the numbers per pixel of each of ``KINDS`` would be if nothing cancelled out in their sums over the axes of
    a primitive: [members, ., .]. Along a needle nearly everything does, and rounding stays as large as the terms."""
    along_axes = np.tile(np.eye(3), (splats.n_splats, 1, 1))  # slopes of 1 along one axis in each channel
    unit = replace(splats, color_slopes=along_axes, slope_index=np.arange(splats.n_splats))
    per_pixel = np.abs(reference.project(unit, LARGE).slopes).swapaxes(1, 2)  # [N, 2, 3]
    slopes, curvatures, *planes = (np.abs(values_of(splats, group)) for group in GROUPS)
    of_slopes, of_curvatures, *of_planes = (per_pixel[index_of(splats, group)] for group in GROUPS)
    cuts = [axes @ normals[:, :, None] for axes, normals in zip(of_planes, planes, strict=True)]
    return [of_slopes @ slopes, of_curvatures @ quadratic_forms(curvatures) @ of_curvatures.swapaxes(1, 2), *cuts]


@CASES
def test_the_picture_is_that_of_the_twin(varies, dog_share, antialiased, negative_transmittance, kind):
    splats = model(varies, 300, seed=5, dog_share=dog_share)
    choices = {"antialiased": antialiased, "negative_transmittance": negative_transmittance}
    ours, twins = CUTOFFS[kind]
    frame = rasterized(splats, LARGE, **choices, **ours)
    twin = render_tiled(splats, LARGE, BACKGROUND, **choices, **twins)
    sure = decided(splats, LARGE, **choices) if kind == "cutoffs" else np.ones(twin.T.shape, bool)
    assert sure.mean() > 0.9
    np.testing.assert_allclose(image_of(frame, LARGE, BACKGROUND)[sure], twin.image[sure], atol=2e-5)
    np.testing.assert_allclose(plane_of(frame.T, LARGE)[sure], twin.T[sure], atol=2e-5)
    even = render_tiled(splats.without_slopes().without_cuts(), LARGE, BACKGROUND, **choices, **twins)
    assert np.abs(even.image - twin.image).max() > 0.1


@pytest.mark.parametrize("patch", [1, 2, 4])
def test_the_pixels_of_a_block_each_have_their_own_colour_and_kernel(patch):
    splats = model("all of them", 100, seed=6)
    expected = render_tiled(splats, LARGE, BACKGROUND, **CUTOFFS["smooth"][1]).image
    frame = rasterized(splats, LARGE, patch=patch, **SMOOTH_OPTIONS)
    np.testing.assert_allclose(image_of(frame, LARGE, BACKGROUND), expected, atol=2e-5)


def test_depth_knows_nothing_of_slopes():
    splats = model("slopes", 60)
    planes = [rasterized(s, LARGE, depth=True).depth for s in (splats, splats.without_slopes())]
    ours, even = (plane_of(plane, LARGE) for plane in planes if plane is not None)
    np.testing.assert_allclose(ours, even, rtol=1e-6)


def test_mixed_degrees_go_with_slopes_and_cuts():
    splats = model("all of them", 60, degree=3).with_sh_degrees(np.arange(60) % 4)
    assert splats.n_slopes and splats.n_cuts and splats.mixed_sh
    expected = render_tiled(splats, LARGE, BACKGROUND, **CUTOFFS["smooth"][1]).image
    np.testing.assert_allclose(image_of(rasterized(splats, LARGE, **SMOOTH_OPTIONS), LARGE, BACKGROUND), expected,
                               atol=2e-5)  # fmt: skip


# --- reverse mode ---


def gradients_of(splats: Splats, choices: RasterOptions, adjoint: np.ndarray = ADJOINT) -> dict[str, np.ndarray]:
    params = attached(splats)
    frame = rasterize(params, DeviceCamera.upload(CAMERA), choices)
    loss = mi.Float(0)
    for c in range(3):
        weights = mi.Float(adjoint[..., c].ravel().astype(np.float32))
        loss += dr.sum(weights * (frame.colors[c] + frame.T * BACKGROUND[c]))
    dr.backward(loss)
    got = read_gradients(params, [name for name in raw_names(splats) if name in params])
    return {name: values.reshape(getattr(splats, name).shape) for name, values in got.items()}


@CASES
def test_gradients_of_every_parameter_are_those_of_the_twin(varies, dog_share, antialiased, negative_transmittance,
                                                            kind):  # fmt: skip
    splats = model(varies, 60, seed=5, dog_share=dog_share)
    choices = {"antialiased": antialiased, "negative_transmittance": negative_transmittance}
    ours, twins = CUTOFFS[kind]
    adjoint = ADJOINT * (decided(splats, CAMERA, **choices)[..., None] if kind == "cutoffs" else 1)
    got = gradients_of(splats, options(splats, **choices, **ours), adjoint)
    expected = gradients_tiled(splats, CAMERA, adjoint, BACKGROUND, **choices, **twins)
    assert [each.name in got for each in KINDS] == [share > 0 for share in SHARES[varies]]
    assert_gradients_equal(got, {name: expected[name] for name in got})


@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_gradients_of_every_parameter_equal_differences(dog_share):
    """With all of them; fewer do by way of the twin, whose gradients equal differences too (``tests/reference``)."""
    splats = model("all of them", dog_share=dog_share)
    expected = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND)
    got = gradients_of(splats, options(splats, **SMOOTH_OPTIONS))
    assert_gradients_equal(got, {name: expected[name] for name in got})


def test_slopes_of_a_colour_at_its_limit_have_gradients_and_the_colour_has_none():
    splats = model("slopes", 6)
    splats.sh_coeffs[:] = [[-5], [0], [0], [0]]
    choices = {"antialiased": True, "negative_transmittance": False}  # as in ``CASES``
    got = gradients_of(splats, options(splats, **choices, **SMOOTH_OPTIONS))
    expected = gradients_tiled(splats, CAMERA, ADJOINT, BACKGROUND, **choices, **CUTOFFS["smooth"][1])
    assert not got.pop("sh_coeffs").any() and not expected.pop("sh_coeffs").any()
    assert_gradients_equal(got, expected)


@among_cases("varies", "dog_share", *MODES, kind=["smooth"])
def test_gradients_beyond_the_clamp_of_the_linearisation_are_those_of_the_twin(varies, dog_share, antialiased,
                                                                               negative_transmittance):  # fmt: skip
    splats = model(varies, 8, seed=2, dog_share=dog_share)
    choices = {"antialiased": antialiased, "negative_transmittance": negative_transmittance}
    splats.means[:, 0] *= 3
    splats.log_scales += 1
    expected = gradients_tiled(splats, CAMERA, ADJOINT, BACKGROUND, **choices, **CUTOFFS["smooth"][1])
    got = gradients_of(splats, options(splats, **choices, **SMOOTH_OPTIONS))
    assert_gradients_equal(got, {name: expected[name] for name in got})


# --- forward mode ---


FORWARD = "slopes", "slopes and cuts", "second cuts", "curvatures", "all of them"


@among_cases("varies", "dog_share", *MODES, varies=FORWARD)
def test_forward_mode_along_random_directions_equals_differences(varies, dog_share, antialiased,
                                                                 negative_transmittance):  # fmt: skip
    splats = model(varies, dog_share=dog_share)
    choices = {"antialiased": antialiased, "negative_transmittance": negative_transmittance}
    for seed in range(2):
        directions = random_directions(splats, seed)
        got = pushed(splats, CAMERA, directions, options(splats, **choices, **SMOOTH_OPTIONS))
        assert_gradients_equal(got, pushed_differences(splats, CAMERA, directions, **choices))


def test_forward_mode_along_each_parameter_alone_equals_differences():
    splats = model("all of them")
    for name, direction in random_directions(splats, 4).items():
        got = pushed(splats, CAMERA, {name: direction}, options(splats, **SMOOTH_OPTIONS))
        table = mismatches(got, pushed_differences(splats, CAMERA, {name: direction}))
        assert not table, f"{name}\n{table}"


@among_cases("varies", "dog_share", *MODES, "kind", varies=FORWARD)
def test_forward_and_reverse_mode_are_adjoint(varies, dog_share, antialiased, negative_transmittance, kind):
    """For one parameter at a time. The others have tangents of 0, so that one set of kernels is enough."""
    splats = model(varies, 400, seed=1, dog_share=dog_share)
    splats.logit_opacities += 2
    chosen = {"antialiased": antialiased, "negative_transmittance": negative_transmittance}
    choices = options(splats, **chosen, **CUTOFFS[kind][0])
    gradients, directions = gradients_of(splats, choices), random_directions(splats, 7)
    for name, direction in directions.items():
        along = {other: direction if other == name else 0 * values for other, values in directions.items()}
        tangent = pushed(splats, CAMERA, along, choices)
        forward = ADJOINT * (tangent["image"] + tangent["T"][..., None] * BACKGROUND)
        reverse = gradients[name] * direction
        scale = np.abs(forward).sum() + np.abs(reverse).sum()
        assert scale > 1e-3 and abs(forward.sum() - reverse.sum()) < 1e-3 * scale, name
