"""Directions from which a model was seen before a linear map, as far as a matrix can tell them."""

import numpy as np


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
