"""Stage 1 against its float64 twin: primitives on the image plane."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.activations import softplus
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.rows import NO_ROW
from mi_dogsplat.engine.screen_kernels import LOG2_E, Kernels
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.row_groups import OWN_AXES
from mi_dogsplat.scene.splats import Splats
from read_together import read
from same_numbers import assert_same_numbers
from splat_scenes import make_camera, make_splats, random_splats, rounded, tilted_camera


def engine(splats: Splats, camera: Camera, near_clip=0.2, sh_degree=None, antialiased=False):
    device_camera = DeviceCamera.upload(camera, near_clip)
    degree = splats.sh_degree if sh_degree is None else sh_degree
    return project(upload(splats), device_camera, sh_degree=degree, antialiased=antialiased)


def columns(*values: Any) -> np.ndarray:
    return np.stack([np.asarray(v) for v in values], -1).astype(float)


def conics(k: Kernels) -> np.ndarray:
    """[R, 3] as the twin has them: d^T conic d / 2 in nats."""
    ux, uy, vy = (v.numpy().astype(float) for v in (k.ux, k.uy, k.vy))
    return 2 * columns(ux * ux, ux * uy, uy * uy + vy * vy) / LOG2_E


def assert_close(got: np.ndarray, expected: np.ndarray, name: str):
    """Within 1e-4, relative to the largest entry of the row where that is above 1; conics always relative."""
    rows = np.abs(expected).reshape(len(expected), -1).max(1)
    scale = rows if "conic" in name else np.maximum(rows, 1)
    error = np.abs(got - expected).reshape(len(expected), -1).max(1)
    assert (error <= 1e-4 * scale).all(), f"{name}: {(error / scale).max():.2g} at row {(error / scale).argmax()}"


def assert_same(splats: Splats, camera: Camera, **choices):
    ours, twin = engine(splats, camera, **choices), reference.project(splats, camera, **choices)
    seen = twin.visible
    np.testing.assert_array_equal(ours.visible.numpy(), seen)
    assert seen.any()

    def check(name, got, expected):
        assert_close(got[seen], expected[seen], name)

    check("means2d", columns(ours.x, ours.y), twin.means2d)
    check("depths", columns(ours.depth), twin.depths[:, None])
    check("conics", conics(ours.kernels), twin.conics)
    check("opacities", 2 ** columns(ours.kernels.lo), twin.opacities[:, None])
    check("variances", columns(ours.kernels.variance_x, ours.kernels.variance_y), twin.cov2d[:, [0, 2]])
    check("colors", columns(*ours.colors), twin.colors)
    if not splats.n_dog:
        assert ours.pseudo is None and ours.dog_row is None
        return
    expected_rows = np.full(splats.n_splats, NO_ROW, np.uint32)
    expected_rows[splats.dog_index] = np.arange(splats.n_dog)
    np.testing.assert_array_equal(ours.dog_row, expected_rows)
    at = splats.dog_index[seen[splats.dog_index]]  # visible DoG primitives
    k, row = ours.pseudo, expected_rows[at]
    assert k is not None
    assert_close(conics(k)[row], twin.pseudo_conics[at], "pseudo conics")
    assert_close(2 ** columns(k.lo)[row], twin.pseudo_opacities[at, None], "pseudo opacities")
    assert_close(columns(k.variance_x, k.variance_y)[row], twin.pseudo_cov2d[at][:, [0, 2]], "pseudo variances")


@pytest.mark.parametrize("dog_share", [0, 0.5])
@pytest.mark.parametrize("antialiased", [False, True])
def test_random_primitives_project_as_in_the_twin(dog_share, antialiased):
    splats = rounded(random_splats(300, dog_share=dog_share))
    assert_same(splats, tilted_camera(), antialiased=antialiased)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_every_sh_degree_projects_as_in_the_twin_and_may_be_evaluated_lower(degree):
    splats = rounded(random_splats(80, seed=degree, degree=degree))
    for sh_degree in range(degree + 1):
        assert_same(splats, tilted_camera(), sh_degree=sh_degree)


@pytest.mark.parametrize("cx, cy", [(5.3, 41.0), (-20.0, 10.0), (90.0, 60.5)])
def test_the_principal_point_may_lie_anywhere_even_outside_the_image(cx, cy):
    assert_same(rounded(random_splats(200, seed=2)), tilted_camera(cx=cx, cy=cy))


def test_far_outside_the_image_the_linearisation_is_clamped_as_in_the_twin():
    splats = random_splats(200, seed=4)
    splats.means = splats.means * [12, 12, 0.5]
    camera = tilted_camera(cx=20)
    p = reference.project(rounded(splats), camera)
    outside = p.visible & (np.abs(p.means2d[:, 0] - 32) > 80)
    assert outside.sum() > 50
    assert_same(rounded(splats), camera)


def test_far_from_the_origin_a_camera_is_where_it_is_and_not_where_float32_has_it():
    splats, there = random_splats(60, seed=5), np.array([1e6, -2e6, 3e5])
    splats.means = np.round(4 * splats.means) / 4 + there  # as float32 has them
    assert_same(rounded(splats), make_camera(w2c=affine(np.eye(3), -(there + [0.03, 0.04, -0.05]))))


def test_needles_and_specks_project_as_in_the_twin():
    splats = random_splats(200, seed=6)
    splats.log_scales = np.log(10.0) * np.random.default_rng(1).uniform(-6, 1, (200, 3))
    for antialiased in (False, True):
        assert_same(rounded(splats), tilted_camera(f=500.0), antialiased=antialiased)


def test_quaternions_of_any_length_are_accepted_and_zero_is_the_identity():
    splats = random_splats(60)
    splats.quats = splats.quats * 10.0 ** np.random.default_rng(0).uniform(-30, 30, (60, 1))
    splats.quats[0] = 0
    assert_same(rounded(splats), tilted_camera())


def test_only_finite_primitives_in_front_of_the_near_plane_are_visible():
    splats = rounded(make_splats([[0, 0, z] for z in (0.25, 0.26, -1, 0, 1, 1, 1e5)], dog=[0, 1, 4]))
    for near_clip in (0.0, 0.125, 0.25, 0.5):
        assert_same(splats, make_camera(), near_clip=near_clip)
    broken = rounded(make_splats(np.tile([0.1, 0, 2], (14, 1)), dog=[2, 3, 6, 7, 8, 11]))
    broken.means[0, 1] = np.nan
    broken.means[1] = np.inf
    broken.log_scales[2, 0] = np.inf
    broken.log_scales[3] = np.nan
    broken.quats[4, 2] = np.nan
    broken.logit_opacities[5] = np.nan
    broken.dog_log_scales[2, 1] = np.nan
    broken.dog_log_scales[3, 0] = -np.inf
    broken.dog_logit_opacities[4] = np.nan
    broken.means[9, 0] = 3e38  # pixels that are no float
    broken.means[10] = 0, 0, 1e-37  # nor is their number per unit of the world
    broken.means[13] = 0, 0, 3e37  # nor a normal one
    visible = engine(broken, make_camera(), near_clip=0.0).visible.numpy()
    assert np.flatnonzero(visible).tolist() == [11, 12]


def test_what_varies_over_a_primitive_is_finite_or_it_is_not_visible():
    splats = rounded(make_splats(np.tile([0.1, 0, 2], (6, 1))))
    rows = {name: np.full((6, *shape), 0.1) for group in OWN_AXES for name, shape in group.arrays.items()}
    for k, values in enumerate(rows.values()):
        values[k].flat[-1] = np.nan
    splats = Splats(**vars(splats) | rows | {group.index: np.arange(6) for group in OWN_AXES})
    splats.log_scales[5] = 100  # which is no float either, and is as long as the longest axis
    assert engine(splats, make_camera()).visible.numpy().tolist() == [False] * 4 + [True] * 2


def test_logits_of_any_size_stay_finite_in_value_and_derivative():
    splats = rounded(make_splats(np.tile([0.1, 0, 2], (6, 1)), dog=range(6)))
    splats.logit_opacities[:] = splats.dog_logit_opacities[:] = [-1e30, -200, -20, 20, 200, 1e30]
    params = upload(splats)
    dr.enable_grad(params["logit_opacities"], params["dog_logit_opacities"])
    p = project(params, DeviceCamera.upload(make_camera()), sh_degree=0)
    assert p.pseudo is not None
    np.testing.assert_allclose(dr.detach(p.kernels.lo).numpy()[1:5],
                               [-200 * LOG2_E, -20 * LOG2_E, 0, 0], rtol=1e-6, atol=1e-6)
    dr.backward(dr.sum(p.kernels.lo + p.pseudo.lo))
    for name in ("logit_opacities", "dog_logit_opacities"):
        assert np.isfinite(dr.grad(params[name]).numpy()).all(), name


def test_a_scale_that_is_no_float_has_a_tangent_of_zero():
    splats = rounded(make_splats([[0.1, 0, 2], [0, 0.1, 2]], dog=[0, 1]))
    splats.log_scales[0] = 100
    params = upload(splats)
    dr.enable_grad(params["log_scales"])
    p = project(params, DeviceCamera.upload(make_camera()), sh_degree=0)
    dr.set_grad(params["log_scales"], 1)
    assert p.pseudo is not None and p.visible.numpy().all()
    values = [p.kernels.ux, p.kernels.vy, p.pseudo.ux, p.pseudo.vy]
    huge, other = np.transpose(dr.forward_to(values))
    assert not huge.any() and (other < 0).all()


@pytest.mark.parametrize("antialiased", [False, True])
def test_the_larger_a_primitive_the_less_its_derivatives_depend_on_its_size(antialiased):
    """Where the low-pass filter is nothing, the logarithms of its numbers are linear in those of its scales. At a
    quaternion of (0, 0, 0, 1), which has derivatives as any other."""
    sizes = np.arange(6, 15, 2)  # natural logarithms; the determinant of the largest is 2^100 px⁴
    splats = rounded(make_splats(np.tile([0.1, 0.05, 2], (5, 1)), dog=range(5)))
    splats.log_scales[:] = sizes[:, None] + [0, 0.3, -0.2]
    params = upload(splats)
    dr.enable_grad(params["log_scales"], params["quats"])
    p = project(params, DeviceCamera.upload(make_camera()), sh_degree=0, antialiased=antialiased)
    assert p.pseudo is not None
    dr.backward(dr.log(p.kernels.ux) + p.kernels.uy / p.kernels.ux + dr.log(p.pseudo.ux) + p.kernels.lo)
    for gradient, width in zip(read(dr.grad(params[name]) for name in ("log_scales", "quats")), (3, 4), strict=True):
        rows = gradient.reshape(5, width)
        assert np.abs(rows).max() > 0.1
        np.testing.assert_allclose(rows, np.broadcast_to(rows[0], rows.shape), rtol=1e-3, atol=1e-4)


def test_the_derivative_of_softplus_is_the_sigmoid_at_zero_too():
    x = mi.Float([-30, -1, 0, -0.0, 1e-30, 1, 30])
    dr.enable_grad(x)
    dr.backward(dr.sum(softplus(x)))
    # CUDA takes e^x as 2^(x log2 e): half an ulp of that product, 43 at -30, is a factor of 1 + 1.3e-6
    rtol = 1e-6 if array_types().is_llvm else 2.5e-6
    np.testing.assert_allclose(dr.grad(x).numpy(), 1 / (1 + np.exp(-dr.detach(x).numpy())), rtol=rtol)


def test_a_primitive_on_the_camera_centre_has_a_finite_colour_and_derivative():
    splats = rounded(make_splats([[0, 0, 0], [0, 0, 1]]))
    splats.sh_coeffs = np.zeros((2, 16, 3), np.float32)
    params = upload(splats)
    dr.enable_grad(params["means"])
    p = project(params, DeviceCamera.upload(make_camera(), 0.0), sh_degree=3)
    dr.backward(dr.sum(p.colors[0] + p.x + p.kernels.ux))
    assert np.isfinite(dr.grad(params["means"]).numpy()).all()
    assert np.isfinite(np.array(p.colors[0])).all()


def test_sh_split_into_its_constant_part_and_the_rest_gives_the_same_colours():
    splats = rounded(random_splats(50))
    whole = engine(splats, tilted_camera()).colors
    params = upload(splats)
    params["sh_dc"] = mi.Float(splats.sh_coeffs[:, 0].ravel())
    rest = splats.sh_coeffs.copy()
    rest[:, 0] = np.nan  # not used
    params["sh_rest"] = mi.Float(rest.ravel())
    del params["sh_coeffs"]
    for degree in (0, 3):
        ours = project(params, DeviceCamera.upload(tilted_camera()), sh_degree=degree).colors
        theirs = whole if degree else engine(splats, tilted_camera(), sh_degree=0).colors
        assert_same_numbers(columns(*ours), columns(*theirs))


def test_a_degree_of_which_no_coefficients_are_stored_is_an_error():
    params = upload(rounded(random_splats(6, degree=2)))
    params["sh_coeffs"] = mi.Float(np.zeros(6 * 8 * 3))
    with pytest.raises(ValueError, match="SH degree 2 needs 9 coefficients per channel, sh_coeffs has 8"):
        project(params, DeviceCamera.upload(make_camera()), sh_degree=2)


def test_the_device_camera_has_the_numbers_of_the_host_camera():
    camera = tilted_camera(cx=20.0, cy=30.0)
    device = DeviceCamera.upload(camera, 0.3)
    np.testing.assert_allclose(columns(device.position)[..., 0].ravel(), camera.position, rtol=1e-6)
    assert (device.width, device.height, device.near_clip[0]) == (64, 48, np.float32(0.3))
