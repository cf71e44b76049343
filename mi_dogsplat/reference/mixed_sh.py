"""Models whose primitives have SH degrees of their own, for the twins: padded with zeros to the highest degree.

Such a model has `sh_coeffs` [N, 1, 3] and, for each degree d = 1, 2, 3 that there is, the primitives `sh<d>_index` [M]
with `sh<d>_coeffs` [M, (d + 1)^2 - 1, 3]. A model that has no such arrays is uniform.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..scene.splats import Splats


def sh_groups(splats: Splats) -> dict[int, np.ndarray]:
    """Primitives of the groups that there are, by degree."""
    indices = {degree: np.asarray(getattr(splats, f"sh{degree}_index", ()), np.int64) for degree in (1, 2, 3)}
    return {degree: index for degree, index in indices.items() if index.size}


def group_names(splats: Splats) -> tuple[str, ...]:
    """Names of the coefficients of the groups that there are."""
    return tuple(f"sh{degree}_coeffs" for degree in sh_groups(splats))


def padded_sh(splats: Splats) -> np.ndarray:
    """[N, K, 3] of the highest degree that there is, zero where a primitive has none; float64."""
    sh, groups = np.asarray(splats.sh_coeffs, np.float64), sh_groups(splats)
    if not groups:
        return sh
    padded = np.zeros((len(sh), (max(groups) + 1) ** 2, 3))
    padded[:, :1] = sh
    for degree, index in groups.items():
        padded[index, 1 : (degree + 1) ** 2] = getattr(splats, f"sh{degree}_coeffs")
    return padded


def unpadded_sh(padded: np.ndarray, splats: Splats) -> dict[str, np.ndarray]:
    """What `padded_sh` has put together, by name: of values for all coefficients [N, K, 3] those that exist."""
    groups = sh_groups(splats)
    of_all = padded if not groups else padded[:, :1]
    of_groups = {f"sh{degree}_coeffs": padded[index, 1 : (degree + 1) ** 2] for degree, index in groups.items()}
    return {"sh_coeffs": of_all} | of_groups
