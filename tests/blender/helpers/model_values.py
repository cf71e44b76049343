"""Numbers of models, compared bit by bit, or by what they mean after a motion."""

import numpy as np

from blender_addon.files.model import Model, normalized
from blender_addon.files.sh import sh_basis


def assert_equal(found: Model, expected: Model) -> None:
    """Bit by bit."""
    for name in vars(expected):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name


def assert_moved(found: Model, raw: Model, matrix: np.ndarray) -> None:
    """Oracle: covariance M Σ Mᵀ, and a colour that is the same from the direction that turned along."""
    linear = matrix[:3, :3]
    assert np.allclose(found.means, raw.means @ linear.T + matrix[:3, 3], atol=1e-4)
    assert np.allclose(covariances(found), linear @ covariances(raw) @ linear.T, rtol=1e-3, atol=1e-5)
    directions = some_directions(raw)
    turned = directions @ (linear / np.cbrt(abs(np.linalg.det(linear)))).T
    assert np.allclose(colors(found, turned), colors(raw, directions), atol=1e-4)
    assert np.array_equal(found.is_dog, raw.is_dog)
    assert np.array_equal(found.dog_logit_opacities[raw.is_dog], raw.dog_logit_opacities[raw.is_dog])


def some_directions(model: Model) -> np.ndarray:
    """Unit vectors [N, 3], one for each splat."""
    directions = np.random.default_rng(1).normal(size=model.means.shape)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def colors(model: Model, directions: np.ndarray) -> np.ndarray:
    """What each splat shows in a direction, [N, 3], without the half that files leave out."""
    basis = sh_basis(directions, model.sh_degree)
    return np.einsum("nk,nkc->nc", basis, model.sh_coeffs.astype(float))


def covariances(model: Model) -> np.ndarray:
    """[N, 3, 3] of the primitives."""
    w, x, y, z = normalized(model.quats).astype(float).T
    axes = np.stack([
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1)], 1)  # fmt: skip
    scaled = axes * np.exp(model.log_scales.astype(float))[:, None, :]
    return scaled @ scaled.transpose(0, 2, 1)
