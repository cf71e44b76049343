"""What only some splats have, slopes and so on: its names, and what it does at places and in views."""

import numpy as np

from blender_addon.files.model import Model, normalized
from blender_addon.files.rotation import rotations

VALUES = {"slopes": "color_slopes", "curvatures": "brightness_curvatures", "cuts": "cut_normals",
          "second_cuts": "second_cut_normals", "shifts": "shifts"}  # fmt: skip
ATTRIBUTES = {
    "slopes": [f"dog:slope_{axis}" for axis in "xyz"],
    "curvatures": ["dog:curvature_squares", "dog:curvature_products"],
    "cuts": ["dog:cut_normal"],
    "second_cuts": ["dog:second_cut_normal"],
    "shifts": [*(f"dog:shift_{axis}" for axis in "xyz"), "dog:mean_view"],
}
WORDS = {"slopes": "50 with slopes", "curvatures": "50 with curvatures", "cuts": "50 with a cut",
         "second_cuts": "50 with a second cut", "shifts": "50 with shifts"}  # fmt: skip
MATRIX = [[0, 3, 4], [3, 1, 5], [4, 5, 2]]  # of curvatures: which of them its entries are


def columns(model: Model) -> np.ndarray:
    """[N, 3, 3]: standard deviations along the axes of each primitive, in the world."""
    return rotations(normalized(model.quats).astype(float)) * np.exp(model.log_scales.astype(float))[:, None]


def who(model: Model, kind: str) -> np.ndarray:
    """[N]: which splats have them."""
    return getattr(model, f"has_{kind}")


def shown_at(model: Model, kind: str, points: np.ndarray) -> np.ndarray:
    """Of those that have some, at points [M, P, 3] of the world: what they add to colours, or what a cut leaves."""
    rows = who(model, kind)
    w = np.linalg.solve(columns(model)[rows][:, None], (points - model.means[rows][:, None])[..., None])[..., 0]
    values = getattr(model, VALUES[kind])[rows].astype(float)
    if kind == "curvatures":
        return np.einsum("mpa,mab,mpb->mp", w, values[:, MATRIX], w) / 2
    along = np.einsum("mpa,ma...->mp...", w, values)
    return along if kind == "slopes" else (1 + np.exp(-4)) / (1 + np.exp(-4 - along))


def points_in(model: Model, kind: str) -> np.ndarray:
    """[M, 7, 3] places within some standard deviations of each that has some."""
    rows = who(model, kind)
    w = np.random.default_rng(2).normal(size=(rows.sum(), 7, 3))
    return model.means[rows][:, None] + np.einsum("mka,mpa->mpk", columns(model)[rows], w)


def moves_along(model: Model, views: np.ndarray) -> np.ndarray:
    """[V, P, 3] how far from their centres those with shifts stand, seen along unit vectors [P, 3]."""
    rows = who(model, "shifts")
    axes, values = rotations(normalized(model.quats[rows]).astype(float)), model.shifts[rows].astype(float)
    own = np.einsum("pk,vka->vpa", views, axes) - values[:, None, 3]
    return np.einsum("vka,vab,vpb->vpk", columns(model)[rows], values[:, :3], own)


def assert_taken_along(found: Model, raw: Model, kind: str, matrix: np.ndarray) -> None:
    """Oracle: a place shows what it did before it was moved."""
    assert np.array_equal(who(found, kind), who(raw, kind))
    if kind == "shifts":
        return assert_shifts_taken_along(found, raw, matrix[:3, :3])
    points = points_in(raw, kind)
    expected = shown_at(raw, kind, points)
    assert expected.std() > 0.2
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.allclose(shown_at(found, kind, moved), expected, atol=1e-3)


def assert_shifts_taken_along(found: Model, raw: Model, linear: np.ndarray) -> None:
    """Oracle: the moves of before, seen along the directions of before, as far as a matrix can tell these."""
    views = np.random.default_rng(4).normal(size=(20, 3))
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    expected = moves_along(raw, views @ nearest_views(linear).T) @ linear.T
    assert expected.std() > 0.01 * np.cbrt(abs(np.linalg.det(linear)))
    assert np.abs(moves_along(found, views) - expected).max() < 1e-3 * np.abs(expected).max()


def nearest_views(linear: np.ndarray) -> np.ndarray:
    """K [3, 3]: a unit vector d is K d, nearly, before a map A [3, 3], exactly A⁻¹ d / |A⁻¹ d|.

    By least squares over a spiral of directions, each of which has as much of the sphere to itself.
    """
    k = np.arange(100_000)
    z, angle = 1 - (2 * k + 1) / len(k), np.pi * (3 - np.sqrt(5)) * k
    radius = np.sqrt(1 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    before = np.linalg.solve(linear, directions.T).T
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    return np.linalg.lstsq(directions, before, rcond=None)[0].T
