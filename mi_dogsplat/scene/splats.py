"""The model: raw parameters of all primitives as NumPy arrays.

Raw values are what is stored, trained and written; properties without ``log_``/``logit_`` are activated.
The DoG part is sparse: row ``j`` of the ``dog_*`` arrays belongs to primitive ``dog_index[j]``, every other
primitive is a plain Gaussian and pays nothing for it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAX_SH_DEGREE = 3
Array = NDArray[Any]


def _no_rows(*shape: int, dtype: type = np.float32):
    return field(default_factory=lambda: np.zeros((0, *shape), dtype))


@dataclass(eq=False)
class Splats:
    """N Gaussian primitives, M of which are Differences of Gaussians.

    Arrays become contiguous float32 (``dog_index``: uint32) and their shapes are checked once, here. Raises
    ``ValueError`` that names both sides of a mismatch. Of the values only ``dog_index`` is looked at.
    """

    means: Array
    """[N, 3] world space"""
    log_scales: Array
    """[N, 3] log of the standard deviation in world units"""
    quats: Array
    """[N, 4] x, y, z, w; any non-zero length"""
    logit_opacities: Array
    """[N]"""
    sh_coeffs: Array
    """[N, K, 3] with K = (degree + 1)^2"""
    dog_index: Array = _no_rows(dtype=np.uint32)
    """[M] strictly increasing"""
    dog_logit_opacities: Array = _no_rows()
    """[M] logit of f_a: the pseudo-Gaussian has opacity f_a * opacity"""
    dog_log_scales: Array = _no_rows(3)
    """[M, 3] log of F: the pseudo-Gaussian has scales F * scales"""

    def __post_init__(self):
        for name in self.__dataclass_fields__:
            if name != "dog_index":
                setattr(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float32))

        if self.means.ndim != 2 or self.means.shape[1] != 3:
            raise ValueError(f'Splats: "means" has shape {list(self.means.shape)}, expected [N, 3]')
        n = self.n_splats
        if self.sh_coeffs.ndim != 3 or self.sh_coeffs.shape[1] not in (1, 4, 9, 16):
            shape = list(self.sh_coeffs.shape)
            raise ValueError(f'Splats: "sh_coeffs" has shape {shape}, expected [N, 1/4/9/16, 3]')
        k = self.sh_coeffs.shape[1]
        rows = {"log_scales": (3,), "quats": (4,), "logit_opacities": (), "sh_coeffs": (k, 3)}
        for name, tail in rows.items():
            self._check(name, (n, *tail), '"means"', n)

        self.dog_index = _as_dog_index(self.dog_index, n)
        m = self.n_dog
        for name, tail in {"dog_logit_opacities": (), "dog_log_scales": (3,)}.items():
            self._check(name, (m, *tail), '"dog_index"', m)

    def _check(self, name: str, expected: tuple[int, ...], other: str, other_rows: int):
        shape = getattr(self, name).shape
        if shape == expected:
            return
        if shape[1:] == expected[1:] and len(shape) == len(expected):
            rows = f'"{name}" has {shape[0]} rows, {other} has {other_rows}'
            raise ValueError(f"Splats: {rows}; both need one row per primitive")
        raise ValueError(f'Splats: "{name}" has shape {list(shape)}, expected {list(expected)}')

    @classmethod
    def empty(cls, sh_degree: int) -> Splats:
        """A model without primitives. Raises ``ValueError`` unless ``sh_degree`` is 0..3."""
        if not 0 <= sh_degree <= MAX_SH_DEGREE:
            raise ValueError(f"Splats.empty: sh_degree is {sh_degree}, expected 0..{MAX_SH_DEGREE}")
        return cls(
            means=np.zeros((0, 3)),
            log_scales=np.zeros((0, 3)),
            quats=np.zeros((0, 4)),
            logit_opacities=np.zeros(0),
            sh_coeffs=np.zeros((0, (sh_degree + 1) ** 2, 3)),
        )

    @property
    def n_splats(self) -> int:
        """N, the number of primitives."""
        return self.means.shape[0]

    @property
    def n_dog(self) -> int:
        """M, the number of primitives that are DoG."""
        return self.dog_index.shape[0]

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0..3."""
        return (1, 4, 9, 16).index(self.sh_coeffs.shape[1])

    @property
    def scales(self) -> Array:
        """[N, 3] standard deviations in world units."""
        return _exp(self.log_scales)

    @property
    def opacities(self) -> Array:
        """[N] in 0..1."""
        return _sigmoid(self.logit_opacities)

    @property
    def dog_opacities(self) -> Array:
        """[M] f_a in 0..1."""
        return _sigmoid(self.dog_logit_opacities)

    @property
    def dog_scales(self) -> Array:
        """[M, 3] F > 0."""
        return _exp(self.dog_log_scales)

    def select(self, which: ArrayLike) -> Splats:
        """The primitives ``which``, a mask [N] or indices in any order (repeats allowed); DoG rows go along.

        Raises ``ValueError`` for a mask of another length, ``IndexError`` for an index out of range.
        """
        chosen = np.asarray(which)
        if chosen.size == 0 and chosen.dtype != bool:
            chosen = chosen.astype(np.int64)  # an empty Python list arrives as float64
        if chosen.dtype == bool and chosen.shape != (self.n_splats,):
            raise ValueError(f'Splats.select: mask {list(chosen.shape)}, "means" has {self.n_splats} rows')
        old_from_new = np.arange(self.n_splats)[chosen]  # [N'] plain indices, whatever came in

        dog_row_from_splat = np.full(self.n_splats, -1)
        dog_row_from_splat[self.dog_index] = np.arange(self.n_dog)
        dog_row_from_new = dog_row_from_splat[old_from_new]  # [N'] or -1
        dog_index = np.flatnonzero(dog_row_from_new >= 0)  # [M'] increasing by construction
        dog_rows = dog_row_from_new[dog_index]
        return Splats(
            means=self.means[old_from_new],
            log_scales=self.log_scales[old_from_new],
            quats=self.quats[old_from_new],
            logit_opacities=self.logit_opacities[old_from_new],
            sh_coeffs=self.sh_coeffs[old_from_new],
            dog_index=dog_index,
            dog_logit_opacities=self.dog_logit_opacities[dog_rows],
            dog_log_scales=self.dog_log_scales[dog_rows],
        )

    def plain(self) -> Splats:
        """All N primitives as plain Gaussians: the primaries, without what their pseudo-Gaussians subtract."""
        names = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")
        return Splats(**{name: getattr(self, name).copy() for name in names})

    def only_dog(self) -> Splats:
        """The M primitives that are DoG, alone."""
        return self.select(self.dog_index)

    def only_gaussians(self) -> Splats:
        """The N - M primitives that are plain Gaussians, alone."""
        is_gaussian = np.ones(self.n_splats, bool)
        is_gaussian[self.dog_index] = False
        return self.select(is_gaussian)


def _as_dog_index(index: ArrayLike, n_splats: int) -> Array:
    """``index`` as uint32 [M]; raises ``ValueError`` unless it increases strictly within 0..n_splats-1."""
    index = np.asarray(index)
    if index.ndim != 1 or (index.size and index.dtype.kind not in "iu"):
        raise ValueError(f'Splats: "dog_index" is {index.dtype} {list(index.shape)}, expected integers [M]')
    if index.size:
        low, high = int(index.min()), int(index.max())
        if low < 0 or high >= n_splats:
            raise ValueError(f'Splats: "dog_index" spans {low} to {high}, "means" has {n_splats} rows')
        if np.any(index[1:] <= index[:-1]):
            raise ValueError('Splats: "dog_index" is not strictly increasing; sort it, each primitive once')
    return np.ascontiguousarray(index, dtype=np.uint32)


def _exp(x: Array) -> Array:
    with np.errstate(over="ignore"):  # inf is the right answer for a scale beyond float32
        return np.exp(x)


def _sigmoid(x: Array) -> Array:
    """Accurate to full relative precision at both ends, never overflows."""
    e = np.exp(-np.abs(x))
    return np.where(x >= 0, 1, e) / (1 + e)
