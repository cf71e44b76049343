"""Models on the device: what is uploaded, and several models as one."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.parameters import (
    RAW,
    RAW_DOG,
    concatenate,
    device_array,
    device_bytes,
    rows_of_splats,
    upload,
)
from mi_dogsplat.engine.rows import NO_ROW
from mi_dogsplat.scene.splats import Splats
from splat_scenes import random_splats, rounded


def test_uploaded_arrays_are_the_model_row_by_row():
    splats = rounded(random_splats(20, degree=2))
    params = upload(splats)
    assert set(params) == {*RAW, *RAW_DOG, "dog_index", "dog_row"}
    for name in (*RAW, *RAW_DOG, "dog_index"):
        np.testing.assert_array_equal(params[name].numpy(), getattr(splats, name).ravel(), err_msg=name)


def test_a_model_of_plain_gaussians_has_no_dog_arrays():
    assert set(upload(rounded(random_splats(5, dog_share=0)))) == set(RAW)
    assert dr.width(upload(Splats.empty(3))["means"]) == 0


def test_a_later_change_of_the_host_arrays_does_not_reach_the_device():
    splats = rounded(random_splats(40))
    params = upload(splats)
    expected = {name: getattr(splats, name).copy() for name in RAW}
    for name in RAW:
        getattr(splats, name)[:] = 7
    for name in RAW:
        np.testing.assert_array_equal(params[name].numpy(), expected[name].ravel(), err_msg=name)


@pytest.mark.parametrize("dtype, kind", [(None, np.float32), (mi.UInt32, np.uint32), ("bytes", np.uint8)])
@pytest.mark.parametrize("shape", [(), (0,), (5,), (4, 3), (2, 3, 5)])
def test_an_array_of_any_order_and_type_is_flat_on_the_device_row_by_row(shape, dtype, kind):
    values = np.random.default_rng(0).integers(0, 200, shape[::-1]).astype(np.int64).T
    found = device_array(values, device_bytes() if dtype == "bytes" else dtype)
    np.testing.assert_array_equal(found.numpy(), np.ravel(values).astype(kind))


def test_dog_rows_invert_the_index():
    np.testing.assert_array_equal(rows_of_splats(np.array([1, 4], np.uint32), 5), [NO_ROW, 0, NO_ROW, NO_ROW, 1])
    np.testing.assert_array_equal(rows_of_splats(np.zeros(0, np.uint32), 2), [NO_ROW, NO_ROW])


def test_one_model_is_passed_through():
    params = upload(rounded(random_splats(4)))
    joined, size = concatenate([params], [16])
    assert joined is params and size == 16


def test_joined_models_are_their_rows_in_turn_with_lower_sh_degrees_padded():
    models = [rounded(random_splats(n, seed=n, degree=degree, dog_share=share))
              for n, degree, share in ((4, 1, 0.5), (3, 3, 0), (5, 0, 0.8))]
    joined, size = concatenate([upload(m) for m in models], [m.sh_coeffs.shape[1] for m in models])
    assert size == 16
    for name in ("means", "log_scales", "quats", "logit_opacities", *RAW_DOG):
        expected = np.concatenate([getattr(m, name) for m in models])
        np.testing.assert_array_equal(joined[name].numpy(), expected.ravel(), err_msg=name)
    sh = joined["sh_coeffs"].numpy().reshape(12, 16, 3)
    for m, rows in zip(models, np.split(sh, [4, 7]), strict=True):
        k = m.sh_coeffs.shape[1]
        np.testing.assert_array_equal(rows[:, :k], m.sh_coeffs)
        assert not rows[:, k:].any()
    index = np.concatenate([models[0].dog_index, models[2].dog_index + 7])
    np.testing.assert_array_equal(joined["dog_index"].numpy(), index)
    np.testing.assert_array_equal(joined["dog_row"].numpy(), rows_of_splats(index, 12).numpy())


def test_models_without_primitives_are_left_out_of_a_joined_one():
    empty, params = upload(Splats.empty(3)), upload(rounded(random_splats(4, degree=1)))
    joined, size = concatenate([empty, params, empty], [16, 4, 16])
    assert joined is params and size == 4
    assert dr.width(concatenate([empty, empty], [16, 16])[0]["means"]) == 0


def test_joining_passes_gradients_to_every_part():
    parts = [upload(rounded(random_splats(n, seed=n, degree=degree))) for n, degree in ((3, 0), (4, 2))]
    for p in parts:
        dr.enable_grad(p["sh_coeffs"], p["means"])
    joined, _ = concatenate(parts, [1, 9])
    weights = {name: np.arange(dr.width(joined[name]), dtype=np.float32) for name in ("sh_coeffs", "means")}
    sums = [dr.sum(joined[name] * mi.Float(w)) for name, w in weights.items()]
    dr.backward(sums[0] + sums[1])
    np.testing.assert_array_equal(dr.grad(parts[1]["means"]).numpy(), weights["means"][9:])
    rows = weights["sh_coeffs"].reshape(7, 9, 3)
    np.testing.assert_array_equal(dr.grad(parts[0]["sh_coeffs"]).numpy(), rows[:3, :1].ravel())
    np.testing.assert_array_equal(dr.grad(parts[1]["sh_coeffs"]).numpy(), rows[3:].ravel())
