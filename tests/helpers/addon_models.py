"""Models of the package as the Blender add-on has them: what only some primitives have takes a row of each."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.scene.row_groups import SHIFTS, RowGroup
from mi_dogsplat.scene.splats import Splats
from own_axes_models import KINDS
from shifted_models import with_shifts
from splat_scenes import axis_rotation

ROTATION = axis_rotation([1, -2, 0.7], 2.1)[0]
SHEAR = np.array([[1.2, 0.5, 0], [0, 0.7, -0.3], [0.1, 0, 2.0]])
MAPS = {"turn": 1.7 * ROTATION, "mirror": -0.4 * ROTATION, "shear": SHEAR, "stretch": np.diag([1.0, 1.2, 3.0])}


@dataclass(frozen=True)
class AddonKind:
    """A kind of rows: the arrays of its group in the package are one in the add-on."""

    word: str
    """``slopes`` and so on, as in files"""
    name: str
    """of the values in a model of the add-on"""
    shape: tuple[int, ...]
    """of a row of these"""
    group: RowGroup
    having: Callable[..., Splats]
    """the model with them in each ``every``-th primitive from ``first`` on"""

    @property
    def has(self) -> str:
        """Name of the array [N] that says which primitives have them."""
        return f"has_{self.word}"

    def index(self, splats: Splats) -> np.ndarray:
        return getattr(splats, self.group.index)

    def values(self, splats: Splats) -> np.ndarray:
        """[M, *shape]"""
        arrays = [getattr(splats, name).reshape(len(self.index(splats)), -1) for name in self.group.names]
        return np.concatenate(arrays, axis=1).reshape(-1, *self.shape)

    def of_package(self, model: Any) -> dict[str, np.ndarray]:
        """The arrays of the group, of a model of the add-on."""
        which = getattr(model, self.has)
        if not which.any():
            return {}
        sizes = [int(np.prod(shape)) for shape in self.group.arrays.values()]
        parts = np.split(getattr(model, self.name)[which].reshape(which.sum(), -1), np.cumsum(sizes)[:-1], axis=1)
        values = zip(self.group.arrays.items(), parts, strict=True)
        return {self.group.index: np.flatnonzero(which)} | {name: v.reshape(-1, *shape) for (name, shape), v in values}


ADDON_KINDS = (
    *(AddonKind(kind.word, kind.name, kind.shape, kind.group, kind.having) for kind in KINDS),
    AddonKind("shifts", "shifts", (4, 3), SHIFTS, with_shifts),
)
EACH_ADDON_KIND = pytest.mark.parametrize("kind", ADDON_KINDS, ids=lambda kind: kind.word)


def as_model(addon, splats):
    """The same primitives as the add-on has them: a row of each kind for each, quaternions w, x, y, z."""
    n, dog = splats.n_splats, splats.dog_index
    is_dog, logits, scales = np.zeros(n, bool), np.zeros(n, np.float32), np.zeros((n, 3), np.float32)
    is_dog[dog], logits[dog], scales[dog] = True, splats.dog_logit_opacities, splats.dog_log_scales
    values = splats.means, splats.log_scales, splats.quats[:, [3, 0, 1, 2]], splats.logit_opacities, splats.sh_coeffs
    rows: dict[str, np.ndarray] = {}
    for kind in ADDON_KINDS:
        index, (first, *rest) = kind.index(splats), kind.shape
        rows |= {kind.has: np.zeros(n, bool), kind.name: np.zeros((n, first * bool(len(index)), *rest), np.float32)}
        if len(index):
            rows[kind.has][index], rows[kind.name][index] = True, kind.values(splats)
    return addon("files.model").Model(*values, is_dog, logits, scales, **rows)
