"""Derivatives of the whole path in both modes, against finite differences of the float64 twin, lane by lane.

The twin is differentiated without cutoffs: with them an image jumps wherever a primitive crosses 1/255.
"""

from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from every_pair import every_pair
from forward_mode import pushed, pushed_differences, random_directions
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.rasterize import Frame, RasterOptions, rasterize
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.scene.splats import Splats
from read_together import read, read_gradients
from splat_scenes import (
    SMOOTH_OPTIONS,
    assert_gradients_equal,
    attached,
    differences,
    make_splats,
    mismatches,
    options,
    random_splats,
    rounded,
    tilted_camera,
)

BACKGROUND = (0.2, -0.3, 0.6)
CAMERA = tilted_camera(16, 12, f=14.0, cx=7.0, cy=6.5)
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3))


def small_model(degree=1, n=6, seed=3, dog_share=0.5) -> Splats:
    return rounded(random_splats(n, seed=seed, degree=degree, dog_share=dog_share))


def gradients_of(splats: Splats, loss: Callable[[Frame], mi.Float], choices: RasterOptions,
                 probe=None) -> dict[str, np.ndarray]:
    """Reverse mode, in the shapes of the parameters."""
    params = attached(splats)
    dr.backward(loss(rasterize(params, DeviceCamera.upload(CAMERA), choices, probe)))
    got = read_gradients(params, [name for name in RAW_PARAMETERS if name in params])
    return {name: values.reshape(getattr(splats, name).shape) for name, values in got.items()}


def image_loss(frame: Frame) -> mi.Float:
    """sum(adjoint * (image over the background))"""
    loss = mi.Float(0)
    for c in range(3):
        adjoint = mi.Float(ADJOINT[..., c].ravel().astype(np.float32))
        loss += dr.sum(adjoint * (frame.colors[c] + frame.T * BACKGROUND[c]))
    return loss


# Reverse mode

@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_gradients_of_every_parameter_equal_differences(degree):
    splats = small_model(degree)
    expected = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND)
    assert_gradients_equal(gradients_of(splats, image_loss, options(splats, **SMOOTH_OPTIONS)), expected)


@pytest.mark.parametrize("antialiased, negative_transmittance", [(True, True), (False, False), (True, False)])
@pytest.mark.parametrize("seed", [5, 6])
def test_gradients_of_the_other_modes_equal_differences(antialiased, negative_transmittance, seed):
    splats = small_model(seed=seed)
    choices = {"antialiased": antialiased, "negative_transmittance": negative_transmittance}
    expected = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND, **choices)
    got = gradients_of(splats, image_loss, options(splats, **choices, **SMOOTH_OPTIONS))
    assert_gradients_equal(got, expected)


@pytest.mark.parametrize("n", [1, 2, 6])
def test_gradients_of_plain_gaussians_equal_differences(n):
    splats = small_model(n=n, seed=8, dog_share=0)
    expected = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND)
    assert_gradients_equal(gradients_of(splats, image_loss, options(splats, **SMOOTH_OPTIONS)), expected)


def test_gradients_of_a_single_dog_primitive_equal_differences():
    splats = rounded(make_splats([0.1, 0, 2], [0.3, 0.5, 0.2], 0.7, (0.3, 0.6, 0.9), dog=[0],
                                 quats=(0.2, 0.4, 0.1, 0.8)))
    expected = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND)
    assert_gradients_equal(gradients_of(splats, image_loss, options(splats, **SMOOTH_OPTIONS)), expected)


def test_gradients_are_zero_where_kernels_are_saturated_and_colours_clamped():
    splats = rounded(make_splats([[0, 0, 2], [0.3, 0.2, 3]], 1e4, [0.9999, 0.6], [[0.2, 0.3, 0.4], [-2, 0.5, -1]],
                                 dog=[0, 1]))
    got = gradients_of(splats, image_loss, options(splats, **SMOOTH_OPTIONS))
    assert not got["sh_coeffs"][1, 0, [0, 2]].any() and got["sh_coeffs"][1, 0, 1]
    expected = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND)
    for name in ("logit_opacities", "dog_logit_opacities", "sh_coeffs"):
        np.testing.assert_allclose(got[name], expected[name], rtol=1e-2, atol=1e-4 * np.abs(expected[name]).max())
    along = {"logit_opacities": np.ones(2, np.float32)}
    tangent = pushed(splats, CAMERA, along, options(splats, depth=True, **SMOOTH_OPTIONS))
    assert_gradients_equal(tangent, pushed_differences(splats, CAMERA, along, depth=True))


def test_gradients_beyond_the_clamp_of_the_linearisation_equal_differences():
    splats = small_model(0, seed=2)
    splats.means[:, 0] *= 3
    splats.log_scales += 1
    expected = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND)
    assert_gradients_equal(gradients_of(splats, image_loss, options(splats, **SMOOTH_OPTIONS)), expected)


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("scales", [(15, 1e7, 1e-3), (1e4, 1e4, 1e-3)], ids=str)
def test_gradients_of_kernels_of_huge_areas_equal_differences(scales, antialiased):
    """70,000 px wide, or a needle of 1e8 px by 100: the square of their determinants is no float."""
    splats = rounded(make_splats([0.1, 0, 2], scales, 0.6, (0.3, 0.6, 0.9)))
    adjoint = np.ones((CAMERA.height, CAMERA.width, 3))
    expected = reference.loss_gradients(splats, CAMERA, adjoint, antialiased=antialiased)

    def loss(frame: Frame) -> mi.Float:
        return dr.sum(frame.colors[0] + frame.colors[1] + frame.colors[2])

    got = gradients_of(splats, loss, options(splats, antialiased=antialiased, **SMOOTH_OPTIONS))
    for name in ("log_scales", "logit_opacities"):
        largest = np.abs(expected[name]).max()
        np.testing.assert_allclose(got[name], expected[name], rtol=0, atol=1e-2 * largest, err_msg=name)


@pytest.mark.parametrize("what", ["T", "depth", "everything"])
def test_gradients_of_transmittance_and_depth_equal_differences(what):
    splats, weight = small_model(), {"T": (0, 1, 0), "depth": (0, 0, 1), "everything": (1, 0.7, -0.4)}[what]
    adjoint = ADJOINT[..., 0]

    def loss(frame: Frame) -> mi.Float:
        assert frame.depth is not None
        δ = mi.Float(adjoint.ravel().astype(np.float32))
        return dr.sum(δ * (weight[0] * frame.colors[1] + weight[1] * frame.T + weight[2] * frame.depth))

    def expected_loss(splats: Splats) -> float:
        image, T, depth = reference.render(splats, CAMERA, smooth=True)
        return float(np.sum(adjoint * (weight[0] * image[..., 1] + weight[1] * T + weight[2] * depth)))

    got = gradients_of(splats, loss, options(splats, depth=True, **SMOOTH_OPTIONS))
    expected = differences(splats, expected_loss)
    if what != "everything":
        assert not expected["sh_coeffs"].any() and not got.pop("sh_coeffs").any()
        del expected["sh_coeffs"]
    assert_gradients_equal(got, expected)


def test_the_gradient_of_the_probe_is_that_of_the_projected_centres():
    splats = small_model()
    p = reference.project(splats, CAMERA)
    everything, eps = [reference.depth_order(p)], 1e-5
    expected = np.zeros((splats.n_splats, 2))
    for index in np.ndindex(expected.shape):
        sides = []
        for side in (eps, -eps):
            p.means2d[index] += side
            image, _, _ = reference.composite(p, everything, 16, 12, BACKGROUND, smooth=True, tile_height=12)
            p.means2d[index] -= side
            sides.append(np.sum(ADJOINT * image))
        expected[index] = (sides[0] - sides[1]) / (2 * eps)
    probe = [dr.zeros(mi.Float, splats.n_splats) for _ in range(2)]
    dr.enable_grad(probe)
    gradients_of(splats, image_loss, options(splats, **SMOOTH_OPTIONS), probe)
    got = np.stack(read(map(dr.grad, probe)), -1)
    assert_gradients_equal({"means2d": got}, {"means2d": expected})


# Forward mode

@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_forward_mode_along_random_directions_equals_differences(negative_transmittance):
    splats = small_model(3)
    choices = options(splats, depth=True, negative_transmittance=negative_transmittance, **SMOOTH_OPTIONS)
    for seed in range(3):
        directions = random_directions(splats, seed)
        expected = pushed_differences(
            splats, CAMERA, directions, depth=True, negative_transmittance=negative_transmittance
        )
        assert_gradients_equal(pushed(splats, CAMERA, directions, choices), expected)


@pytest.mark.parametrize("name", RAW_PARAMETERS)
def test_forward_mode_along_single_entries_of_a_parameter_equals_differences(name):
    splats = small_model(3)
    shape, choices = getattr(splats, name).shape, options(splats, depth=True, **SMOOTH_OPTIONS)
    for row in (0, shape[0] // 2, shape[0] - 1):
        direction = np.zeros(shape, np.float32)
        direction[(row, *np.random.default_rng(row).integers(shape[1:]))] = 1
        expected = pushed_differences(splats, CAMERA, {name: direction}, depth=True)
        got = pushed(splats, CAMERA, {name: direction}, choices)
        table = mismatches(got, expected)
        assert not table, f"row {row}\n{table}"


# With cutoffs

def test_with_cutoffs_gradients_equal_differences_where_nothing_crosses_one():
    """Steps are so small that no pixel of this scene crosses a cutoff; those beyond a cutoff contribute nothing."""
    splats = small_model(seed=4)
    hard = reference.loss_gradients(splats, CAMERA, ADJOINT, background=BACKGROUND, smooth=False, eps=1e-7)
    assert_gradients_equal(gradients_of(splats, image_loss, options(splats)), hard)


@every_pair(cutoffs=[{}, SMOOTH_OPTIONS], size=[(60, 0), (60, 0.5), (400, 0.5)], negative_transmittance=[True, False])
def test_forward_and_reverse_mode_are_adjoint(cutoffs, size, negative_transmittance):
    """<δimage, J v> = <Jᵀ δimage, v>, for one parameter at a time; opaque enough that walks end early.

    The other parameters have tangents of 0, so that one set of kernels is enough.
    """
    n, dog_share = size
    splats = small_model(n=n, seed=1, dog_share=dog_share)
    splats.logit_opacities += 2
    choices = options(splats, negative_transmittance=negative_transmittance, **cutoffs)
    gradients, directions = gradients_of(splats, image_loss, choices), random_directions(splats, 7)
    assert set(gradients) == set(directions)
    for name, direction in directions.items():
        along = {other: direction if other == name else 0 * values for other, values in directions.items()}
        tangent = pushed(splats, CAMERA, along, choices)
        forward = ADJOINT * (tangent["image"] + tangent["T"][..., None] * BACKGROUND)
        reverse = gradients[name] * direction
        scale = np.abs(forward).sum() + np.abs(reverse).sum()
        assert abs(forward.sum() - reverse.sum()) < 1e-3 * scale, name


def test_gradients_stay_right_when_the_number_of_primitives_grows_and_shrinks():
    """Derivative kernels are recorded once and replayed for every N."""
    models = {n: small_model(n=n, seed=n) for n in (40, 300, 2000)}
    choices = options(models[40])
    first = {n: gradients_of(models[n], image_loss, choices) for n in (40, 300, 2000)}
    for n in (2000, 40, 300, 40, 2000):
        again = gradients_of(models[n], image_loss, choices)
        for name, expected in first[n].items():
            np.testing.assert_allclose(again[name], expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())


def test_gradients_of_two_renders_add_up():
    """Of the same parameters, by a caller who does no more than rasterise twice: every entry, DoG ones too."""
    splats = small_model(2)
    cameras = [DeviceCamera.upload(camera) for camera in (CAMERA, tilted_camera(16, 12, f=20.0))]

    def gradients(seen: list[DeviceCamera]) -> dict[str, np.ndarray]:
        params = attached(splats)
        for camera in seen:
            dr.backward(image_loss(rasterize(params, camera, options(splats))))
        return read_gradients(params, RAW_PARAMETERS)

    first, second, both = gradients(cameras[:1]), gradients(cameras[1:]), gradients(cameras)
    for name in RAW_PARAMETERS:
        largest = np.abs(both[name]).max()
        assert np.abs(first[name]).max() > 0.1 * largest > 0
        np.testing.assert_allclose(both[name], first[name] + second[name], atol=1e-5 * largest, err_msg=name)


def test_primitives_that_are_not_seen_have_zero_gradients():
    splats = small_model(n=12)
    splats.means[::2, 2] *= -1  # behind
    splats.logit_opacities[1] = -20  # too faint
    got = gradients_of(splats, image_loss, options(splats))
    for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs"):
        assert not got[name][::2].any() and not got[name][1].any(), name
        assert got[name][3:].any()
