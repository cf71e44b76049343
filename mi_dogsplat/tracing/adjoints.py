"""From the adjoint of an alpha to those of the parameters of its kernels, and the other way.

A kernel is 2^(lo - Q) with Q = |M x|², x the offset where that is least on the ray. Since it is least, x may be taken
as constant: ∂Q/∂M = 2 (M x) xᵀ and ∂Q/∂μ = -2 Mᵀ M x. Of the pseudo-Gaussian the same holds with F⁻¹ M, at its own x.

A colour that varies, and cuts, need more, as the point itself moves (``own_axes.py``). A cut multiplies both kernels
by g, so that the adjoint of ln g is the sum of those of their logarithms; a second one has the same. Where the place of
a primitive depends on the ray, μ is that on the ray, which is linear in what the primitive has for it (``shifts.py``).
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..engine.arrays import array_types
from ..engine.cuts import ROW as NORMAL
from ..engine.cuts import by_plane
from ..engine.geometry import MAX_ALPHA
from ..engine.rows import read_row
from ..engine.screen_kernels import LN2
from .kernels import Kernel, RayMeeting
from .own_axes import moved, pulled
from .row_tables import columns_of, table, wide
from .shifts import add_adjoints as add_to_shifts
from .shifts import moved_by
from .tree import CUT_ROW, NONE, Tree, rows_of
from .tree import PSEUDO_ROW as TREE_PSEUDO_ROW
from .varying import add_adjoints, along, beyond_centre, by_point
from .vectors import dot

ROW = 16  # floats: M, μ, lo; three are free
PSEUDO_ROW = 4  # floats: F⁻¹, lo_p


class Adjoints:
    """Sums of adjoints over all rays, to which the walks add."""

    def __init__(self, tree: Tree):
        Float = array_types().Float
        self.tree = tree
        self.rows = dr.zeros(Float, tree.n_leaves * ROW)
        m = dr.width(tree.pseudo) // TREE_PSEUDO_ROW if tree.pseudo is not None else 0
        self.pseudo = dr.zeros(Float, m * PSEUDO_ROW) if m else None
        self.sh = dr.zeros(Float, dr.width(tree.sh))
        self.slopes, self.curvatures, self.shifts = (
            values and values.zeros() for values in (tree.slopes, tree.curvatures, tree.shifts)
        )
        self.normals = [dr.zeros(Float, dr.width(plane.rows)) for plane in tree.planes]

    def add_alpha(self, met: RayMeeting, δα: Any, active: Any) -> None:
        """Of the kernels of what is met."""
        types = array_types()
        δlog = δvalue = _unlimited(met.primary, δα, active)
        lo, pull = LN2 * δvalue, [-2 * LN2 * δvalue * y for y in met.primary.inside]
        M = [p * x for p in pull for x in met.primary.offset]
        if met.pseudo is not None:
            is_dog = active & met.is_dog
            δvalue = _unlimited(met.pseudo, -δα, is_dog)
            δlog, δpseudo = δlog + δvalue, LN2 * δvalue
            y = met.pseudo.inside
            inverse = [-2 * δpseudo * dr.square(a) / f for a, f in zip(y, met.inverse_factors, strict=True)]
            more = [-2 * δpseudo * a * f for a, f in zip(y, met.inverse_factors, strict=True)]
            M = [m + p * x for m, (p, x) in zip(M, ((p, x) for p in more for x in met.pseudo.offset), strict=True)]
            pull = [a + b for a, b in zip(pull, more, strict=True)]
            dr.scatter_add(self.pseudo, types.Quad(*inverse, δpseudo), met.dog_row, is_dog, mode=dr.ReduceMode.Local)
        if met.cuts:
            of_cuts, more = self._add_cuts(met, δlog, active)
            M = [a + b for a, b in zip(M, of_cuts, strict=True)]
            pull = [a + b for a, b in zip(pull, more, strict=True)]
        self._add_to_kernel(met, M, pull, lo, active)

    def _add_cuts(self, met: RayMeeting, δlog: Any, active: Any) -> tuple[list, list]:
        """Of the normals; returns what the point of the ray adds (``pulled``). ``δlog``: adjoint of ln g, of each."""
        assert met.point
        types, δw = array_types(), [0, 0, 0]
        for normals, cut in zip(self.normals, met.cuts, strict=True):
            δ = δlog * cut.falls
            row = types.Quad(*(δ * w for w in met.point.w), types.Float(0))
            dr.scatter_add(normals, row, met.splat, active & cut.here, mode=dr.ReduceMode.Local)
            δw = [a + δ * n for a, n in zip(δw, cut.normal, strict=True)]
        return pulled(met.point, met.primary.offset, δw)

    def _add_to_kernel(self, met: RayMeeting, M: list, pull: list, lo: Any, active: Any) -> None:
        """``pull``: adjoint of M x, x the offset from μ."""
        types = array_types()
        mean = [-dot(pull, [row[c] for row in met.M]) for c in range(3)]
        if met.shift and self.shifts:
            add_to_shifts(self.shifts, met.shift, mean, active)
        leaf = met.leaf - self.tree.first_leaf
        row = types.Floats([*M, *mean, lo, *[types.Float(0)] * 3])
        dr.scatter_add(self.rows, row, leaf, active, mode=dr.ReduceMode.Local)

    def add_colors(self, met: RayMeeting, δcolors: list, basis: list, active: Any) -> None:
        """Of three channels of radiance."""
        Float, Quad = array_types().Float, array_types().Quad
        values, stride = [b * δ for b in basis for δ in δcolors], self.tree.sh_row
        size = 1 if stride % 4 else 4  # whole rows of four at once
        values += [Float(0)] * (-len(values) % size)
        for first in range(0, len(values), size):
            part = Quad(*values[first : first + 4]) if size == 4 else values[first]
            at = dr.fma(met.splat, stride // size, first // size)
            dr.scatter_add(self.sh, part, at, active, mode=dr.ReduceMode.Local)

    def add_beyond_centre(self, met: RayMeeting, δcolors: list, active: Any) -> None:
        """Of three channels of what the colour has beyond that of its centre."""
        assert met.varying and met.point
        add_adjoints(self, met.varying, met.point.w, δcolors, active)
        δw = [dot(axis, δcolors) for axis in by_point(self.tree, met.varying, met.point.w, active)]
        M, pull = pulled(met.point, met.primary.offset, δw)
        self._add_to_kernel(met, M, pull, array_types().Float(0), active & met.varying.here)

    def of_columns(self) -> tuple[list, Any, dict[str, list]]:
        """(of ``Primitives.kernel``, of ``sh``, of each of ``SPARSE``)"""
        types, tree = array_types(), self.tree
        dr.eval(self.rows, self.pseudo, self.slopes, self.curvatures, self.normals, self.shifts, self.sh)
        n, splat = dr.width(tree.sh) // tree.sh_row, tree.splat_from_leaf
        leaf = dr.arange(types.UInt, tree.n_leaves)
        kernel = []
        for k in range(13):
            column = dr.zeros(types.Float, n)
            dr.scatter(column, dr.gather(types.Float, self.rows, dr.fma(leaf, ROW, k)), splat, splat != NONE)
            kernel.append(column)
        dr.eval(kernel)  # what AD adds to a column while its scatter still waits may be lost: docs/performance/traps.md
        sparse = {
            "pseudo": [] if self.pseudo is None else columns_of(self.pseudo, PSEUDO_ROW, 4),
            "slopes": self.slopes.columns() if self.slopes else [],
            "curvatures": self.curvatures.columns() if self.curvatures else [],
            "normals": [column for normals, plane in zip(self.normals, tree.planes, strict=True)
                        for column in columns_of(normals, CUT_ROW, NORMAL, plane.index)],
            "shifts": self.shifts.columns() if self.shifts else [],
        }
        return kernel, self.sh, sparse


class Tangents:
    """Tangents of all parameters, which the walks read."""

    def __init__(self, tree: Tree, kernel: list, sh: Any, sparse: dict[str, list]):
        types = array_types()
        n = dr.width(tree.sh) // tree.sh_row
        self.tree, self.sh = tree, wide(sh, dr.width(tree.sh))
        self.rows, self.pseudo = table([wide(c, n) for c in kernel], ROW), None
        if tree.pseudo is not None:
            m = dr.width(tree.pseudo) // TREE_PSEUDO_ROW
            self.pseudo = table([wide(c, m) for c in sparse["pseudo"]], PSEUDO_ROW)
        self.slopes = tree.slopes and tree.slopes.tangents(sparse["slopes"])
        self.curvatures = tree.curvatures and tree.curvatures.tangents(sparse["curvatures"])
        self.shifts = tree.shifts and tree.shifts.tangents(sparse["shifts"])
        self.normals = []
        for plane, normal in zip(tree.planes, by_plane(sparse["normals"], NORMAL), strict=True):
            columns = [wide(c, dr.width(plane.index)) for c in normal]
            self.normals.append(rows_of([*columns, types.Float(0)], plane.index, n))
        dr.eval(self.rows, self.pseudo, self.slopes, self.curvatures, self.normals, self.shifts, self.sh)

    def of_alpha(self, met: RayMeeting, active: Any) -> Any:
        M, mean, lo = self._of_kernel(met, active)

        def of_inside(kernel: Kernel) -> list:
            return [dot(δ, kernel.offset) - dot(m, mean) for δ, m in zip(M, met.M, strict=True)]

        δQ = 2 * dot(met.primary.inside, of_inside(met.primary))
        δcuts = self._of_cuts(met, M, of_inside(met.primary), active)
        δα = _unlimited(met.primary, LN2 * (lo - δQ) + δcuts, active)
        if met.pseudo is None:
            return δα
        is_dog = active & met.is_dog
        *inverse, lo = read_row(self.pseudo, met.dog_row, PSEUDO_ROW, 4, is_dog)
        y, f = met.pseudo.inside, met.inverse_factors
        δy = [a * b + δ * c / a for a, b, δ, c in zip(f, of_inside(met.pseudo), inverse, y, strict=True)]
        return δα - _unlimited(met.pseudo, LN2 * (lo - 2 * dot(y, δy)) + δcuts, is_dog)

    def _of_cuts(self, met: RayMeeting, M: list, inside: list, active: Any) -> Any:
        """Of the sum of ln g. ``M``, ``inside``: tangents of M, and of M x of the primary where x stays."""
        δlog = 0
        for normals, cut in zip(self.normals, met.cuts, strict=True):
            assert met.point
            here = active & cut.here
            δnormal = read_row(normals, met.splat, CUT_ROW, NORMAL, here)
            δlog += cut.falls * (dot(δnormal, met.point.w) + dot(cut.normal, moved(met.point, inside, M, here)))
        return δlog

    def of_beyond_centre(self, met: RayMeeting, active: Any) -> list:
        """Of what the colour has beyond that of its centre, three channels."""
        assert met.varying and met.point
        w, here = met.point.w, active & met.varying.here
        M, mean, _ = self._of_kernel(met, here)
        inside = [dot(δ, met.primary.offset) - dot(m, mean) for δ, m in zip(M, met.M, strict=True)]
        of_point = along(moved(met.point, inside, M, here), by_point(self.tree, met.varying, w, active))
        of_values = beyond_centre(self, met.varying, w, active)
        return [a + b for a, b in zip(of_point, of_values, strict=True)]

    def _of_kernel(self, met: RayMeeting, active: Any) -> tuple[list, list, Any]:
        """(M, μ on the ray, lo)"""
        row = read_row(self.rows, met.splat, ROW, 13, active)
        mean = row[9:12]
        if met.shift and self.shifts:
            mean = [a + b for a, b in zip(mean, moved_by(self.shifts, met.shift, active), strict=True)]
        return [row[0:3], row[3:6], row[6:9]], mean, row[12]

    def of_colors(self, met: RayMeeting, basis: list, active: Any) -> list:
        values = read_row(self.sh, met.splat, self.tree.sh_row, 3 * len(basis), active)
        return [sum(b * values[3 * k + channel] for k, b in enumerate(basis)) for channel in range(3)]


def _unlimited(kernel: Kernel, δ: Any, active: Any) -> Any:
    """The value times ``δ``, 0 where it is limited."""
    return dr.select(active & (kernel.value < MAX_ALPHA), kernel.value * δ, 0)
