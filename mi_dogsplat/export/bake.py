"""Differences of Gaussians as plain Gaussians, for formats that know no negative lobes.

A DoG primitive draws g(s) - f_a g(F s), g(s) a Gaussian with scales s, peak 1, times its opacity. It becomes the one
Gaussian a g(r s) that is nearest to it in the mean of squares. Up to a constant, per axis,

    <g(p), g(q)> = p q √2 / √(p² + q²)

A picture shows two of the three axes. Along each axis there is a view of the other two, whose products count as much as
the area s_j s_k that it shows, and <., .> is the sum over the three. For given ratios r the best
a = <g(r s), DoG> / <g(r s), g(r s)> leaves the error

    |DoG|² - <g(r s), DoG>² / <g(r s), g(r s)>

whose second term is made as large as it can be, one axis after the other.

Measured (docs/export_details.md) this keeps far more than dropping the pseudo-Gaussian, lowering the peak, or matching
moments; and ``refine.py`` brings back most of the rest. What colours vary by and cuts stay where they are in space.
"""

from __future__ import annotations

import numpy as np

from ..scene.curvatures import ENTRIES
from ..scene.row_groups import ALONG_AXES
from ..scene.splats import Array, Splats

RATIOS = np.geomspace(0.2, 3.0, 136)  # of scales, tried per axis: in steps of 2 %
SWEEPS = 4  # over the axes
ROWS = 16_384  # primitives at a time, which bounds the memory
SMALLEST, LARGEST = 1e-4, 1 - 1e-4  # opacity


def baked(splats: Splats) -> Splats:
    """The model with each DoG primitive replaced by the Gaussian nearest to it; N plain Gaussians."""
    plain, dog = splats.plain(), splats.dog_index
    wider = np.ones((splats.n_splats, 3), np.float32)  # r
    for start in range(0, splats.n_dog, ROWS):
        rows = slice(start, start + ROWS)
        scales = splats.scales[dog[rows]]
        ratios, factors = nearest_gaussians(splats.dog_opacities[rows], splats.dog_scales[rows], scales)
        opacities = np.clip(splats.opacities[dog[rows]] * factors, SMALLEST, LARGEST)
        wider[dog[rows]] = ratios
        plain.logit_opacities[dog[rows]] = np.log(opacities / (1 - opacities))
    plain.log_scales += np.log(wider)
    for name, group in ALONG_AXES.items():
        values = getattr(plain, name)
        values *= wider[getattr(plain, group.index)].reshape(values.shape[:2] + (1,) * (values.ndim - 2))
    of_curved = wider[plain.curvature_index]
    plain.brightness_curvatures *= np.stack([of_curved[:, a] * of_curved[:, b] for a, b in ENTRIES], axis=1)
    plain.view_shifts /= wider[plain.shift_index][:, :, None]  # which are in standard deviations
    return plain


def nearest_gaussians(f_a: Array, F: Array, scales: Array) -> tuple[Array, Array]:
    """Ratios r of scales [M, 3] and factors a on opacities [M] of the Gaussians nearest to DoG.

    Args:
        f_a: [M] share of the pseudo-Gaussians in the opacities.
        F: [M, 3] their scales, as ratios.
        scales: [M, 3] of the primaries, in any unit: what matters is how they differ.
    """
    f_a, F = f_a.astype(np.float64)[:, None], F.astype(np.float64)
    areas = _areas(scales.astype(np.float64))
    ratios: list[Array] = [np.ones((len(F), 1)) for _ in range(3)]  # [M, 1] each
    for axis in [0, 1, 2] * SWEEPS:
        tried = [RATIOS[None] if k == axis else ratios[k] for k in range(3)]
        with_dog, with_itself = _products(tried, f_a, F, areas)  # [M, ratios]
        gain = np.where(with_dog > 0, with_dog**2 / with_itself, -1)
        ratios[axis] = RATIOS[gain.argmax(axis=1)][:, None]
    with_dog, with_itself = _products(ratios, f_a, F, areas)
    return np.concatenate(ratios, axis=1), np.maximum(with_dog / with_itself, 0)[:, 0]


def _areas(scales: Array) -> Array:
    """Shares [M, 3] of the areas that views along each axis show of ellipsoids of ``scales`` [M, 3]."""
    largest = scales.max(axis=1, keepdims=True)
    relative = np.clip(scales / np.where(largest > 0, largest, 1), 1e-6, 1)
    areas = 1 / relative
    return areas / areas.sum(axis=1, keepdims=True)


def _products(ratios: list[Array], f_a: Array, F: Array, areas: Array) -> tuple[Array, Array]:
    """<g(r s), DoG> and <g(r s), g(r s)> [M, C] of ratios [M or 1, C or 1] along three axes."""
    with_primary = _seen([_overlap(r, np.ones(1)) for r in ratios], areas)
    with_pseudo = _seen([_overlap(r, F[:, k : k + 1]) for k, r in enumerate(ratios)], areas)
    return with_primary - f_a * with_pseudo, _seen(ratios, areas)


def _seen(along: list[Array], areas: Array) -> Array:
    """Sum over the views of the product over the two axes that each shows: [M, C] of [M or 1, C or 1] per axis."""
    x, y, z = along
    return areas[:, :1] * y * z + areas[:, 1:2] * x * z + areas[:, 2:] * x * y


def _overlap(p: Array, q: Array) -> Array:
    """∫ exp(-x²/2p²) exp(-x²/2q²) dx, over √π."""
    return p * q * np.sqrt(2) / np.sqrt(p * p + q * q)
