"""The model: raw parameters of all primitives as NumPy arrays.

Raw values are what is stored, trained and written; properties without ``log_``/``logit_`` are activated.
Some parts are sparse (``row_groups.py``): row ``j`` of the ``dog_*`` arrays belongs to primitive ``dog_index[j]``,
every other primitive is a plain Gaussian and pays nothing for it. So it is with colours that vary over their primitive
(docs/slopes.md, docs/curvatures.md), with primitives that planes cut off (docs/cuts.md) or whose place depends on the
view (docs/shifts.md), and with colours that vary with the direction: a model is uniform, all primitives of one SH
degree, or mixed, with a group for each degree above 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..support.classes import require_class
from ..support.wording import counted
from .curvatures import mean_brightness
from .opacity import sigmoid
from .row_groups import (
    CURVATURES,
    DOG,
    GROUPS,
    MAX_SH_DEGREE,
    PLANES,
    SECOND_CUTS,
    SH,
    SHIFTS,
    SLOPES,
    Array,
    RowGroup,
    checked_index,
    in_several,
    selected,
)
from .sh_basis import C0, SH_SIZES, sh_degree_of

DENSE = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")
"""Arrays with a row for every primitive."""
_NO_REAL_NUMBERS = "cmMOSU"
"""Kinds of NumPy's types: complex numbers, times, objects such as None, texts."""


def _no_rows(*shape: int, dtype: type = np.float32):
    return field(default_factory=lambda: np.zeros((0, *shape), dtype))


def _numbers(name: str, values: Any) -> Array:
    """As contiguous float32. NumPy itself would make nan of None, and drop what is imaginary."""
    try:
        found = np.asarray(values)
    except ValueError:
        raise ValueError(f'Splats: "{name}" has rows of different lengths') from None
    if found.dtype.kind in _NO_REAL_NUMBERS:
        raise ValueError(f'Splats: "{name}" is an array of {found.dtype}, expected real numbers')
    return np.ascontiguousarray(found, dtype=np.float32)


@dataclass(eq=False)
class Splats:
    """N Gaussian primitives, M of which are Differences of Gaussians.

    Arrays become contiguous float32 (indices: uint32) and their shapes are checked once, here. Raises ``ValueError``
    that names both sides of a mismatch. Of the values only the indices are looked at.

    Methods that return a model return one that shares no memory with this one: either may be changed in place.
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
    """[N, K, 3] with K = (degree + 1)^2: what every primitive has; K is 1 in a mixed model"""
    dog_index: Array = _no_rows(dtype=np.uint32)
    """[M] strictly increasing"""
    dog_logit_opacities: Array = _no_rows()
    """[M] logit of f_a: the pseudo-Gaussian has opacity f_a * opacity"""
    dog_log_scales: Array = _no_rows(3)
    """[M, 3] log of F: the pseudo-Gaussian has scales F * scales"""
    slope_index: Array = _no_rows(dtype=np.uint32)
    """[S] strictly increasing: the primitives whose colour varies linearly over them"""
    color_slopes: Array = _no_rows(3, 3)
    """[S, 3, 3] the change of their colour per standard deviation along each axis of their own: axis, channel"""
    curvature_index: Array = _no_rows(dtype=np.uint32)
    """[B] strictly increasing: the primitives whose brightness curves over them"""
    brightness_curvatures: Array = _no_rows(6)
    """[B, 6] its second derivatives per standard deviation along their axes, the same for all channels: xx, yy, zz, xy,
    xz, yz"""
    cut_index: Array = _no_rows(dtype=np.uint32)
    """[C] strictly increasing: the primitives that a plane cuts off"""
    cut_normals: Array = _no_rows(3)
    """[C, 3] normals of these planes towards what is kept, along the primitives' own axes and per standard deviation;
    their length is how steep the cut is"""
    second_cut_index: Array = _no_rows(dtype=np.uint32)
    """[C2] strictly increasing: the primitives that a second plane cuts off"""
    second_cut_normals: Array = _no_rows(3)
    """[C2, 3] normals of these planes, as of the others"""
    shift_index: Array = _no_rows(dtype=np.uint32)
    """[V] strictly increasing: the primitives whose place depends on the view"""
    view_shifts: Array = _no_rows(3, 3)
    """[V, 3, 3] by how many standard deviations along each axis of their own they move when the direction from which
    they are seen changes by 1 along each of these axes: axis of the move, axis of the direction"""
    mean_views: Array = _no_rows(3)
    """[V, 3] the direction, along their own axes, from which they are seen where they are stored; at most 1 long"""
    sh1_index: Array = _no_rows(dtype=np.uint32)
    """[M1] strictly increasing: the primitives of degree 1, in a mixed model"""
    sh1_coeffs: Array = _no_rows(3, 3)
    """[M1, 3, 3] their coefficients without the constant one"""
    sh2_index: Array = _no_rows(dtype=np.uint32)
    """[M2] of degree 2"""
    sh2_coeffs: Array = _no_rows(8, 3)
    """[M2, 8, 3]"""
    sh3_index: Array = _no_rows(dtype=np.uint32)
    """[M3] of degree 3"""
    sh3_coeffs: Array = _no_rows(15, 3)
    """[M3, 15, 3]"""

    def __post_init__(self):
        for name in self.__dataclass_fields__:
            if not name.endswith("_index"):
                setattr(self, name, _numbers(name, getattr(self, name)))

        if self.means.ndim != 2 or self.means.shape[1] != 3:
            raise ValueError(f'Splats: "means" has shape {list(self.means.shape)}, expected [N, 3]')
        n = self.n_splats
        if self.sh_coeffs.ndim != 3 or self.sh_coeffs.shape[1] not in SH_SIZES:
            shape = list(self.sh_coeffs.shape)
            raise ValueError(f'Splats: "sh_coeffs" has shape {shape}, expected [N, 1/4/9/16, 3]')
        k = self.sh_coeffs.shape[1]
        rows = {"log_scales": (3,), "quats": (4,), "logit_opacities": (), "sh_coeffs": (k, 3)}
        for name, tail in rows.items():
            self._check(name, (n, *tail), '"means"', n)

        for group in GROUPS:
            index = checked_index(group.index, getattr(self, group.index), n)
            setattr(self, group.index, index)
            for name, tail in group.arrays.items():
                self._check(name, (len(index), *tail), f'"{group.index}"', len(index))
        self._check_sh_groups(k)

    def _check_sh_groups(self, k: int):
        indices = [getattr(self, group.index) for group in SH.values()]
        if k > 1 and self.mixed_sh:
            raise ValueError(f'Splats: "sh_coeffs" has {k} coefficients; beside groups of SH degrees it has 1')
        if (twice := in_several(indices)) is not None:
            names = ", ".join(f'"{group.index}"' for group in SH.values())
            raise ValueError(f"Splats: primitive {twice} is in more than one of {names}; it has one degree")

    def _check(self, name: str, expected: tuple[int, ...], other: str, other_rows: int):
        shape = getattr(self, name).shape
        if shape == expected:
            return
        if shape[1:] == expected[1:] and len(shape) == len(expected):
            rows = f'"{name}" has {counted(shape[0], "row")}, {other} has {other_rows}'
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
    def n_slopes(self) -> int:
        """S, the number of primitives whose colour varies over them."""
        return self.slope_index.shape[0]

    @property
    def n_curvatures(self) -> int:
        """B, the number of primitives whose brightness curves over them."""
        return self.curvature_index.shape[0]

    @property
    def n_cuts(self) -> int:
        """C, the number of primitives that a plane cuts off."""
        return self.cut_index.shape[0]

    @property
    def n_second_cuts(self) -> int:
        """C2, the number of primitives that a second plane cuts off."""
        return self.second_cut_index.shape[0]

    @property
    def n_shifts(self) -> int:
        """V, the number of primitives whose place depends on the view."""
        return self.shift_index.shape[0]

    @property
    def is_varied(self) -> Array:
        """[N] bool, whether its colour varies over it, by slopes or curvatures."""
        return self._is_in(SLOPES, CURVATURES)

    @property
    def is_cut(self) -> Array:
        """[N] bool, whether a plane cuts it off, one or the other."""
        return self._is_in(*PLANES)

    def _is_in(self, *groups: RowGroup) -> Array:
        found = np.zeros(self.n_splats, bool)
        for group in groups:
            found[getattr(self, group.index)] = True
        return found

    @property
    def sh_degree(self) -> int:
        """The highest degree of spherical harmonics that a primitive has, 0..3."""
        of_groups = [degree for degree, group in SH.items() if len(getattr(self, group.index))]
        return max([sh_degree_of(self.sh_coeffs.shape[1]), *of_groups])

    @property
    def mixed_sh(self) -> bool:
        """Whether primitives have degrees of their own, in groups."""
        return any(len(getattr(self, group.index)) for group in SH.values())

    @property
    def sh_degrees(self) -> Array:
        """[N] int, the degree of each primitive."""
        degrees = np.full(self.n_splats, sh_degree_of(self.sh_coeffs.shape[1]))
        for degree, group in SH.items():
            degrees[getattr(self, group.index)] = degree
        return degrees

    @property
    def scales(self) -> Array:
        """[N, 3] standard deviations in world units."""
        return _exp(self.log_scales)

    @property
    def opacities(self) -> Array:
        """[N] in 0..1."""
        return sigmoid(self.logit_opacities)

    @property
    def dog_opacities(self) -> Array:
        """[M] f_a in 0..1."""
        return sigmoid(self.dog_logit_opacities)

    @property
    def dog_scales(self) -> Array:
        """[M, 3] F > 0."""
        return _exp(self.dog_log_scales)

    def select(self, which: ArrayLike) -> Splats:
        """The primitives ``which``, a mask [N] or indices in any order (repeats allowed); rows of groups go along.

        Raises ``ValueError`` for a mask of another length and for indices that are no list, ``IndexError`` for an index
        out of range.
        """
        chosen = np.asarray(which)
        if chosen.size == 0 and chosen.dtype != bool:
            chosen = chosen.astype(np.int64)  # an empty Python list arrives as float64
        if chosen.dtype == bool and chosen.shape != (self.n_splats,):
            raise ValueError(f'Splats.select: mask {list(chosen.shape)}, "means" has {counted(self.n_splats, "row")}')
        if chosen.ndim != 1:
            raise ValueError(f"Splats.select: indices {list(chosen.shape)}, expected [N']; one alone is [i]")
        old_from_new = np.arange(self.n_splats)[chosen]  # [N'] plain indices, whatever came in

        arrays = {name: getattr(self, name)[old_from_new] for name in DENSE}
        for group in GROUPS:
            index, rows = selected(getattr(self, group.index), self.n_splats, old_from_new)
            arrays |= {group.index: index, **{name: getattr(self, name)[rows] for name in group.arrays}}
        return Splats(**arrays)

    def joined(self, *others: Splats) -> Splats:
        """One model of this one and others: the N + N' + ... primitives in this order, each with all its rows.

        Each primitive keeps its SH degree. Of uniform models of one degree the result is uniform, else it is mixed, and
        its ``uniform_sh()`` is padded to the highest degree. Models without primitives have no say in that.

        Raises ``ValueError`` for what is no ``Splats``.
        """
        remedy = "those of a Model are model.splats, those of a list are Splats.joined(*models)"
        for k, other in enumerate(others, 1):
            require_class(f"Splats.joined: model {k}", other, Splats, remedy)
        parts = [part for part in (self, *others) if part.n_splats] or [self]
        if len({part.sh_coeffs.shape[1] for part in parts}) > 1:
            parts = [part._in_groups_of_sh() for part in parts]
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in DENSE}
        firsts = np.cumsum([0, *(part.n_splats for part in parts[:-1])])  # of each part, its row in the whole
        for group in GROUPS:
            indices = [getattr(part, group.index) + first for part, first in zip(parts, firsts, strict=True)]
            arrays[group.index] = np.concatenate(indices)
            arrays |= {name: np.concatenate([getattr(part, name) for part in parts]) for name in group.names}
        return Splats(**arrays)

    def _in_groups_of_sh(self) -> Splats:
        """The same, mixed: of a uniform model above degree 0 all primitives are in the group of its degree."""
        degree = sh_degree_of(self.sh_coeffs.shape[1])
        if degree == 0:
            return self
        group, (name,) = SH[degree], SH[degree].names
        rows = {group.index: np.arange(self.n_splats), name: self.sh_coeffs[:, 1:]}
        return replace(self, sh_coeffs=self.sh_coeffs[:, :1], **rows)

    def plain(self) -> Splats:
        """All N primitives as plain Gaussians: the primaries, without what their pseudo-Gaussians subtract."""
        return self._without(DOG)

    def without_slopes(self) -> Splats:
        """All N primitives in their mean colours, the same all over each of them: without curvatures, too."""
        return self._flat(SLOPES, CURVATURES)

    def without_curvatures(self) -> Splats:
        """All N primitives as bright as on average, but for their slopes."""
        return self._flat(CURVATURES)

    def _flat(self, *groups: RowGroup) -> Splats:
        """Without these groups, curvatures among them; their average brightness stays."""
        flat = self._without(*groups)
        average = mean_brightness(self.brightness_curvatures, self.log_scales[self.curvature_index])
        flat.sh_coeffs[self.curvature_index, 0] += average[:, None] / C0
        return flat

    def without_cuts(self) -> Splats:
        """All N primitives without their planes: what these took away comes back. The nearest whole primitives are made
        by ``scene.whole.whole``."""
        return self._without(*PLANES)

    def without_second_cuts(self) -> Splats:
        """All N primitives, cut off by one plane at most."""
        return self._without(SECOND_CUTS)

    def without_shifts(self) -> Splats:
        """All N primitives where they are on average over the views of their training, whatever the view."""
        return self._without(SHIFTS)

    def _without(self, *groups: RowGroup) -> Splats:
        left_out = [name for group in groups for name in (group.index, *group.names)]
        return Splats(**{name: values.copy() for name, values in vars(self).items() if name not in left_out})

    def uniform_sh(self, degree: int | None = None) -> Splats:
        """The model with one SH degree for all primitives; what is missing is zero.

        Args:
            degree: 0..3; coefficients above are dropped. None: ``sh_degree``, with which nothing changes in pictures.

        Raises ``ValueError`` for what is no degree.
        """
        degree = self.sh_degree if degree is None else _checked_degree(degree, "uniform_sh")
        if not self.mixed_sh and degree == self.sh_degree:
            return self._without()
        k = (degree + 1) ** 2
        padded = np.zeros((self.n_splats, k, 3), np.float32)
        of_all = self.sh_coeffs[:, :k]
        padded[:, : of_all.shape[1]] = of_all
        for group in SH.values():
            coeffs = getattr(self, group.names[0])
            padded[getattr(self, group.index), 1 : 1 + coeffs.shape[1]] = coeffs[:, : k - 1]
        return replace(self._without(*SH.values()), sh_coeffs=padded)

    def with_sh_degrees(self, degrees: ArrayLike) -> Splats:
        """The model with a degree for each primitive; coefficients above it are dropped, missing ones are zero.

        Args:
            degrees: [N] 0..3. If they are all equal the result is uniform, else it is mixed.

        Raises ``ValueError`` for another number of degrees, or for what is no degree.
        """
        chosen = np.asarray(degrees)
        if chosen.shape != (self.n_splats,):
            shape = list(chosen.shape)
            raise ValueError(f'Splats.with_sh_degrees: degrees {shape}, "means" has {counted(self.n_splats, "row")}')
        highest = max((_checked_degree(degree, "with_sh_degrees") for degree in np.unique(chosen)), default=0)
        if not len(chosen) or np.all(chosen == highest):
            return self.uniform_sh(highest if len(chosen) else None)
        whole = self.uniform_sh(highest)
        groups: dict[str, Array] = {}
        for degree in range(1, highest + 1):
            index, (name,) = np.flatnonzero(chosen == degree), SH[degree].names
            groups |= {SH[degree].index: index, name: whole.sh_coeffs[index, 1 : (degree + 1) ** 2]}
        return replace(whole, sh_coeffs=whole.sh_coeffs[:, :1], **groups)

    def only_dog(self) -> Splats:
        """The M primitives that are DoG, alone."""
        return self.select(self.dog_index)

    def only_gaussians(self) -> Splats:
        """The N - M primitives that are plain Gaussians, alone."""
        is_gaussian = np.ones(self.n_splats, bool)
        is_gaussian[self.dog_index] = False
        return self.select(is_gaussian)


def _checked_degree(degree: float, method: str) -> int:
    if degree not in range(MAX_SH_DEGREE + 1):
        raise ValueError(f"Splats.{method}: an SH degree is {degree}, expected 0..{MAX_SH_DEGREE}")
    return int(degree)


def _exp(x: Array) -> Array:
    with np.errstate(over="ignore"):  # inf is the right answer for a scale beyond float32
        return np.exp(x)
