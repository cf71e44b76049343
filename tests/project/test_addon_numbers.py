"""What the add-on has a copy of, as it runs without the package: both give the same numbers.

Its ``__init__.py`` needs Blender; its files of numbers do not, and are imported past it.
"""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from mi_dogsplat.scene.linear_map import sh_projection
from mi_dogsplat.scene.sh_basis import sh_basis_table
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.srgb import linear_to_srgb, srgb_to_linear
from splat_scenes import axis_rotation, random_splats, rounded

ADDON = Path(__file__).parents[2] / "blender_addon"
ROTATION = axis_rotation([1, -2, 0.7], 2.1)[0]
SHEAR = np.array([[1.2, 0.5, 0], [0, 0.7, -0.3], [0.1, 0, 2.0]])
MAPS = {"turn": 1.7 * ROTATION, "mirror": -0.4 * ROTATION, "shear": SHEAR, "stretch": np.diag([1.0, 1.2, 3.0])}


@pytest.fixture(scope="module")
def addon():
    """``addon("files.sh")`` is that module."""
    package = ModuleType("blender_addon")
    package.__path__ = [str(ADDON)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "blender_addon", package)
        yield lambda name: importlib.import_module(f"blender_addon.{name}")
        for name in [name for name in sys.modules if name.startswith("blender_addon.")]:
            del sys.modules[name]


def as_model(addon, splats):
    """The same primitives as the add-on has them: a row of DoG values for each, quaternions w, x, y, z."""
    n, dog = splats.n_splats, splats.dog_index
    is_dog, logits, scales = np.zeros(n, bool), np.zeros(n, np.float32), np.zeros((n, 3), np.float32)
    is_dog[dog], logits[dog], scales[dog] = True, splats.dog_logit_opacities, splats.dog_log_scales
    values = splats.means, splats.log_scales, splats.quats[:, [3, 0, 1, 2]], splats.logit_opacities, splats.sh_coeffs
    return addon("files.model").Model(*values, is_dog, logits, scales)


@pytest.mark.parametrize("name", MAPS)
def test_a_transform_makes_the_same_of_a_model(addon, name):
    """Similarities, and maps that are none (``linear_map.py`` of both)."""
    matrix, splats = np.eye(4), rounded(random_splats(40, seed=7))
    matrix[:3, :3], matrix[:3, 3] = MAPS[name], (0.4, -0.3, 0.2)
    expected = transformed(splats, matrix)
    got = addon("files.transform").transformed(as_model(addon, splats), matrix)
    wanted = as_model(addon, expected)
    for field in ("means", "log_scales", "sh_coeffs", "dog_logit_opacities"):
        np.testing.assert_allclose(getattr(got, field), getattr(wanted, field), rtol=1e-5, atol=2e-6, err_msg=field)
    dog = wanted.is_dog
    np.testing.assert_allclose(got.dog_log_scales[dog], wanted.dog_log_scales[dog], rtol=1e-5, atol=2e-6)
    both = (model.quats / np.linalg.norm(model.quats, axis=1, keepdims=True) for model in (got, wanted))
    np.testing.assert_allclose(np.abs(np.einsum("nk,nk->n", *both)), 1, atol=1e-5)  # q and -q are one rotation


@pytest.mark.parametrize("degree", range(4))
def test_spherical_harmonics_and_their_projection_are_the_same(addon, degree):
    directions = np.random.default_rng(3).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = addon("files.sh").sh_basis(directions, degree)
    np.testing.assert_allclose(basis, sh_basis_table(directions, degree), atol=1e-14)
    projection = addon("files.linear_map").sh_projection(SHEAR, degree)
    np.testing.assert_allclose(projection, sh_projection(SHEAR, degree), atol=1e-13)


def test_the_srgb_curve_is_the_same(addon):
    srgb, values = addon("files.srgb"), np.linspace(0, 3, 3001)
    np.testing.assert_allclose(srgb.encoded(values), linear_to_srgb(values), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(srgb.decoded(values), srgb_to_linear(values), rtol=1e-5, atol=1e-7)
    step = 1e-6
    slope = (srgb.decoded(values + step) - srgb.decoded(values - step)) / (2 * step)
    np.testing.assert_allclose(srgb.decoded_slope(values), slope, rtol=1e-3)
