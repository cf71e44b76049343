"""A model as NumPy arrays: the raw values of a 3DGS file, and what Blender shows of them.

Nothing here knows Blender, so it can be tested with any Python. Raw values (``log_``, ``logit_``) are what files hold;
every other name is activated. DoG values have a row for every primitive; those of a plain Gaussian mean nothing. So
have slopes, of colours that vary over their primitive, curvatures, of a brightness that curves over it, cuts and second
cuts, of planes that cut one off, and shifts, of a place that depends on the view, where any primitive has them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]


@dataclass(frozen=True)
class RowGroup:
    """What only some primitives have: the names of its two arrays in a ``Model``, and the shape of a row."""

    has: str
    values: str
    shape: tuple[int, ...]

    def of_none(self, n: int) -> dict[str, NDArray]:
        """Both arrays where none of ``n`` primitives has any."""
        return {self.has: np.zeros(n, bool), self.values: np.zeros((n, 0, *self.shape[1:]), np.float32)}

    def of_some(self, n: int, index: NDArray, rows: NDArray) -> dict[str, NDArray]:
        """Both arrays where those of ``index`` have these rows, which may be of any shape."""
        has, values = np.zeros(n, bool), np.zeros((n, *self.shape), np.float32)
        has[index], values[index] = True, rows.reshape(-1, *self.shape)
        return {self.has: has, self.values: values}


SLOPES = RowGroup("has_slopes", "color_slopes", (3, 3))
CURVATURES = RowGroup("has_curvatures", "brightness_curvatures", (6,))
CUTS = RowGroup("has_cuts", "cut_normals", (3,))
SECOND_CUTS = RowGroup("has_second_cuts", "second_cut_normals", (3,))
SHIFTS = RowGroup("has_shifts", "shifts", (4, 3))
PLANES = (CUTS, SECOND_CUTS)  # each with or without the other
ALONG_AXES = (SLOPES, *PLANES)  # values per standard deviation along the axes, which come first
GROUPS = (SLOPES, CURVATURES, *PLANES, SHIFTS)


@dataclass(eq=False)
class Model:
    """N primitives, float32."""

    means: Array  # [N, 3]
    log_scales: Array  # [N, 3]
    quats: Array  # [N, 4] w, x, y, z; any non-zero length
    logit_opacities: Array  # [N]
    sh_coeffs: Array  # [N, K, 3] with K = (degree + 1)²
    is_dog: NDArray[np.bool_]  # [N]
    dog_logit_opacities: Array  # [N] logit of f_a: the pseudo-Gaussian has opacity f_a a
    dog_log_scales: Array  # [N, 3] log of F: the pseudo-Gaussian has scales F s
    has_slopes: NDArray[np.bool_]  # [N]
    color_slopes: Array  # [N, 3, 3] of the colour per standard deviation: axis, channel; [N, 0, 3] where none has any
    has_curvatures: NDArray[np.bool_]  # [N]
    brightness_curvatures: Array  # [N, 6] xx, yy, zz, xy, xz, yz of Q: brighter by ½ wᵀ Q w; [N, 0] where none has any
    has_cuts: NDArray[np.bool_]  # [N]
    cut_normals: Array  # [N, 3] along the axes, per standard deviation; [N, 0] where none has any
    has_second_cuts: NDArray[np.bool_]  # [N]
    second_cut_normals: Array  # [N, 3] or [N, 0], as of the others
    has_shifts: NDArray[np.bool_]  # [N]
    shifts: Array  # [N, 4, 3] A, and the mean view v̄: seen along v it moves by A (Rᵀ v - v̄), in standard deviations

    @property
    def n_splats(self) -> int:
        """N."""
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """0..3."""
        return (1, 4, 9, 16).index(self.sh_coeffs.shape[1])

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """[N]: whether all is finite that every primitive has."""
        flat = self.sh_coeffs.reshape(self.n_splats, 3 * self.sh_coeffs.shape[1])
        dense = self.means, self.log_scales, self.quats, self.logit_opacities[:, None], flat
        return np.logical_and.reduce([np.isfinite(values).all(axis=1) for values in dense])

    def select(self, which: NDArray) -> Model:
        """The primitives of a mask [N] or of indices, in their order."""
        return Model(*(getattr(self, field.name)[which] for field in fields(self)))

    def with_degree(self, degree: int) -> Model:
        """The same model without the bands of spherical harmonics above ``degree``."""
        return replace(self, sh_coeffs=self.sh_coeffs[:, : (degree + 1) ** 2])


def concatenate(models: list[Model]) -> Model:
    """One model of several; missing bands of spherical harmonics, slopes and so on are filled up with zeros."""
    columns = {field.name: [getattr(model, field.name) for model in models] for field in fields(Model)}
    for name in ("sh_coeffs", *(group.values for group in GROUPS)):
        k = max(values.shape[1] for values in columns[name])
        columns[name] = [_padded(values, k) for values in columns[name]]
    return Model(**{name: np.concatenate(parts) for name, parts in columns.items()})


def _padded(values: Array, k: int) -> Array:
    """[N, k, ...] of values [N, up to k, ...]."""
    return np.pad(values, [(0, k - values.shape[1] if axis == 1 else 0) for axis in range(values.ndim)])


def sigmoid(x: Array) -> Array:
    """Never overflows."""
    e = np.exp(-np.abs(x))
    return np.where(x >= 0, 1, e) / (1 + e)


def logit(p: Array) -> Array:
    """Inverse of the sigmoid; 0 and 1 become the nearest numbers that a file can hold."""
    p = np.clip(p.astype(np.float64), 1e-12, 1 - 1e-7)
    return (np.log(p) - np.log1p(-p)).astype(np.float32)


def positive_log(x: Array) -> Array:
    """Logarithm of lengths, whose sign says nothing; 0 becomes the smallest one that is shown."""
    return np.log(np.maximum(np.abs(x), np.float32(1e-12)))


def normalized(quats: Array) -> Array:
    """Quaternions [N, 4] of unit length; zero becomes the identity."""
    norm = np.linalg.norm(quats, axis=1, keepdims=True)
    unit = np.divide(quats, norm, out=np.zeros_like(quats), where=norm > 0)
    unit[norm[:, 0] == 0, 0] = 1
    return unit


def importance(model: Model) -> NDArray[np.float64]:
    """How much a primitive is likely to be seen, [N]: opacity times the area of its largest cross-section."""
    scales = np.sort(np.exp(model.log_scales.astype(np.float64)), axis=1)
    return sigmoid(model.logit_opacities).astype(np.float64) * scales[:, 1] * scales[:, 2]
