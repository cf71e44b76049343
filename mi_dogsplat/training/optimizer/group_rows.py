"""Rows that only some primitives have, of DoG, slopes, cuts and so on: whose they are, on the host and on the device.

Their arrays are in Adam, under the names of the group. On the device a primitive can lose its row without a wait.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.parameters import device_array, rows_of_splats
from ...engine.rows import NO_ROW
from ...scene.row_groups import BESIDE_COLORS, DOG, RowGroup, row_of_splats
from ...scene.splats import Splats
from .adam import Moved, gather

SPARSE_ROW_SIZE = {name: math.prod(shape) for group in BESIDE_COLORS for name, shape in group.arrays.items()}
NOBODY = np.zeros(0, np.uint32)
SPARSE_ROW = {name: group.row for group in BESIDE_COLORS for name in group.names}
"""Name of an array to that of the rows [N] of the primitives in it."""


class GroupRows:
    """The rows of a group: ``index`` [M] of their primitives, strictly increasing, of ``n`` primitives."""

    def __init__(self, group: RowGroup, index: np.ndarray, n: int):
        self.group, self.index, self.n = group, np.array(index, np.uint32), n
        self.dropped = False
        if len(self.index):
            self.on_device = device_array(self.index, mi.UInt32)
            self.row = rows_of_splats(self.index, n)  # [N] of each primitive, or NO_ROW

    @staticmethod
    def of(splats: Splats) -> dict[str, GroupRows]:
        """Those of a model, by the names of their indices."""
        return {group.index: GroupRows(group, getattr(splats, group.index), splats.n_splats) for group in BESIDE_COLORS}

    @staticmethod
    def of_state(saved: Mapping[str, np.ndarray]) -> dict[str, GroupRows]:
        """Those in the state of an optimizer."""
        n = np.size(saved["logit_opacities"])
        return {group.index: GroupRows(group, saved.get(group.index, NOBODY), n) for group in BESIDE_COLORS}

    @property
    def row_size(self) -> dict[str, int]:
        """Floats in a row of each array."""
        return {name: SPARSE_ROW_SIZE[name] for name in self.group.names}

    @property
    def params(self) -> dict:
        """Arrays for ``rasterize``; none without a row."""
        return {self.group.index: self.on_device, self.group.row: self.row} if len(self.index) else {}

    @property
    def state(self) -> dict[str, np.ndarray]:
        """What ``of_state`` needs beside the arrays; that there is no DoG is said, too."""
        said = len(self.index) or self.group is DOG
        return {self.group.index: self.index.copy()} if said else {}

    def drop(self, drop: mi.Bool) -> None:
        """Take the rows of the primitives ``drop`` [N] from them on the device, at once."""
        self.row = dr.select(drop, NO_ROW, self.row)
        dr.eval(self.row)
        self.dropped = True

    def of_splats(self) -> np.ndarray:
        """[N] row of each primitive, or -1."""
        return row_of_splats(self.index, self.n)

    def swept(self, adam: mi.ad.Adam) -> GroupRows:
        """Without the rows that were dropped. Waits for the device if some may have been."""
        if not self.dropped:
            return self
        self.dropped = False
        keep = np.flatnonzero(self.row.numpy()[self.index] != NO_ROW)
        return self if len(keep) == len(self.index) else self._gathered(adam, keep, self.index[keep], self.n)

    def rearranged(self, adam: mi.ad.Adam, index: np.ndarray, fresh: np.ndarray) -> GroupRows:
        """After primitive r has become a copy of ``index[r]``; one that is ``fresh`` has no row."""
        if not len(self.index):
            return GroupRows(self.group, self.index, len(index))
        row_of_new = np.where(fresh, -1, self.of_splats()[index])
        having = np.flatnonzero(row_of_new >= 0)
        return self._gathered(adam, row_of_new[having], having, len(index))

    def replaced(
        self, adam: mi.ad.Adam, index: np.ndarray, values: Mapping[str, np.ndarray], rates: Mapping[str, float]
    ) -> GroupRows:
        """Rows for exactly the primitives ``index`` [M]; those that had one keep their moments.

        Args:
            values: of each array of the group, [M] or [M, …].
            rates: step sizes of arrays that are new.
        """
        if len(index) == 0:
            return self._gathered(adam, np.zeros(0, int), index, self.n)
        old_row = self.of_splats()[np.asarray(index, np.int64)]  # [M] or -1
        moved = Moved.of(np.maximum(old_row, 0), old_row < 0)
        for name in self.group.names:
            known = name in adam
            if known:
                gather(adam, name, moved, SPARSE_ROW_SIZE[name])
            adam[name] = device_array(np.broadcast_to(values[name], (len(index), *self.group.arrays[name])))
            if not known:
                adam.set_learning_rate({name: rates[name]})
        return GroupRows(self.group, index, self.n)

    def _gathered(self, adam: mi.ad.Adam, rows: np.ndarray, index: np.ndarray, n: int) -> GroupRows:
        moved = Moved.of(rows, np.zeros(len(rows), bool))
        for name in [name for name in self.group.names if name in adam]:
            gather(adam, name, moved, SPARSE_ROW_SIZE[name])
        return GroupRows(self.group, index, n)


def group_arrays(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of ``Splats`` of the groups that have rows.

    Args:
        values: indices and flat arrays, as in the state of an optimizer; what else there is is not looked at.
    """
    found: dict[str, np.ndarray] = {}
    for group in BESIDE_COLORS:
        index = values.get(group.index, NOBODY)
        if len(index):
            arrays = {name: values[name].reshape(len(index), *shape) for name, shape in group.arrays.items()}
            found |= {group.index: index, **arrays}
    return found


def check_groups(saved: Mapping[str, np.ndarray]) -> None:
    """Raise ``ValueError`` unless the arrays of a state have a row for each entry of their indices."""
    for group in BESIDE_COLORS:
        m = np.size(saved.get(group.index, NOBODY))
        if wrong := [name for name in group.names if np.size(saved.get(name, ())) != m * SPARSE_ROW_SIZE[name]]:
            raise ValueError(f"SplatOptimizer.restore: {wrong} of the state does not fit its {m} rows of {group.index}")
