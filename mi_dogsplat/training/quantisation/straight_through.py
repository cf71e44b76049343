"""A model as its file will say it, on the device: every number on its grid, gradients as if there were none.

The derivative of rounding is 0 or nothing. Straight-through estimation (Bengio et al. 2013) takes that of the identity:
the picture is that of the file, and the parameters move as if they had been drawn themselves, until they cross over to
another value of the grid.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.parameters import device_array
from ...engine.sh_groups import padded_rows
from ...formats.grids import FileGrids, Grid, Palette
from ...scene.row_groups import SH


class DeviceGrid:
    """A grid on the device, in tables whose sizes are powers of two, so that similar ones have one kernel."""

    def __init__(self, grid: Grid):
        self.last = 2 ** len(grid.cuts).bit_length() - 1  # index; there are no more cuts than this
        more = self.last + 1 - len(grid.cuts)
        self.cuts = dr.detach(device_array(np.append(grid.cuts, np.full(more, np.inf))))
        self.values = dr.detach(device_array(np.append(grid.values, np.full(more - 1, grid.values[-1]))))

    def __call__(self, x: mi.Float) -> mi.Float:
        """``Grid.snap`` of an array without derivatives."""
        index = dr.binary_search(0, self.last, lambda i: dr.gather(mi.Float, self.cuts, i) <= x)
        return dr.gather(mi.Float, self.values, mi.UInt32(index))


class BandRows:
    """The rows of an array of bands as entries of a palette: of all primitives, or of those of a degree."""

    def __init__(self, palette: Palette, name: str):
        degree = {group.names[0]: degree for degree, group in SH.items()}.get(name)
        if degree is None:  # all K coefficients, the first of them unused
            entries, labels = np.pad(palette.entries, ((0, 0), (1, 0), (0, 0))), palette.labels
        else:
            entries = padded_rows(palette.entries[:, : (degree + 1) ** 2 - 1])
            labels = palette.labels[palette.degrees[palette.labels] == degree]
        self.row_size, self.width = entries[0].size, entries[0].size * len(labels)
        self.entries, self.labels = dr.detach(device_array(entries)), device_array(labels, mi.UInt32)

    def __call__(self) -> mi.Float:
        """The array, row-major."""
        i = dr.arange(mi.UInt32, self.width)
        row = i // dr.opaque(mi.UInt32, self.row_size)
        label = dr.gather(mi.UInt32, self.labels, row)
        return dr.gather(mi.Float, self.entries, dr.fma(label, self.row_size, i - row * self.row_size))


class StraightThrough:
    """What is rendered instead of the parameters of the optimizer."""

    def __init__(self, grids: FileGrids, palette: Palette, bands: Collection[str]):
        """``bands``: which arrays the parameters have for them (``SplatOptimizer.bands``)."""
        self.means = [DeviceGrid(grid) for grid in grids.means]
        self.flat = {name: DeviceGrid(getattr(grids, name)) for name in ("log_scales", "logit_opacities", "sh_dc")}
        self.three = DeviceGrid(grids.three)
        self.bands = {name: BandRows(palette, name) for name in bands}

    def __call__(self, params: dict) -> dict:
        """The parameters with the numbers of the file; gradients go to those that are given.

        The bits are those that are read back from a file, but for the largest component of a quaternion: the root
        of what the others leave is taken in single precision here, which makes 1 ulp.
        """
        raw = {name: dr.detach(params[name]) for name in ("means", "quats", *self.flat)}
        snapped = {name: grid(raw[name]) for name, grid in self.flat.items()}
        snapped["means"] = self._means(raw["means"])
        snapped["quats"] = self._quats(raw["quats"])
        snapped |= {name: rows() for name, rows in self.bands.items()}
        dr.eval(snapped)
        return params | {name: dr.replace_grad(value, params[name]) for name, value in snapped.items()}

    def _means(self, flat: mi.Float) -> mi.Float:
        axes = dr.unravel(mi.Point3f, flat)
        return _flat(mi.Point3f(*(grid(x) for grid, x in zip(self.means, axes, strict=True))))

    def _quats(self, flat: mi.Float) -> mi.Float:
        """``smallest_three``, their grid, and the largest component with its sign."""
        q = list(dr.unravel(mi.Vector4f, flat))
        length = dr.sqrt(dr.fma(q[0], q[0], dr.fma(q[1], q[1], dr.fma(q[2], q[2], dr.square(q[3])))))
        q = [x / length for x in q]
        largest, rest = dr.abs(q[0]), mi.UInt32(0)
        for k in (1, 2, 3):
            more = dr.abs(q[k]) > largest
            largest, rest = dr.select(more, dr.abs(q[k]), largest), dr.select(more, k, rest)
        found = [dr.select(rest == k, 0, self.three(x)) for k, x in enumerate(q)]
        left = dr.sqrt(dr.maximum(mi.Float(0), 1 - dr.squared_norm(mi.Vector4f(*found))))
        return _flat(mi.Vector4f(*(dr.select(rest == k, dr.copysign(left, q[k]), found[k]) for k in range(4))))


def _flat(rows: Any) -> mi.Float:
    return cast(mi.Float, dr.ravel(rows))
