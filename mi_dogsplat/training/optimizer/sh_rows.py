"""How the optimizer holds view-dependent colour, in one array or in groups of rows, and which primitive is in which.

A uniform model has one array ``sh_rest`` [N, K, 3], none at degree 0. A mixed one has ``sh1_coeffs``, ``sh2_coeffs``,
``sh3_coeffs``, a row for each primitive of that degree, padded as ``engine/sh_groups.py`` reads them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import mitsuba as mi
import numpy as np

from ...engine.parameters import device_array
from ...engine.sh_groups import ROW_COEFFICIENTS, padded_rows
from ...scene.row_groups import SH, Array, selected
from ...scene.splats import Splats
from .adam import Entry, forget, to_host

SH_ROW_SIZE = {SH[degree].names[0]: 3 * coefficients for degree, coefficients in ROW_COEFFICIENTS.items()}
SH_INDEX = {group.names[0]: group.index for group in SH.values()}
"""Name of a group's coefficients to that of its index."""


class ShRows:
    """Which primitives are in which group: none in a uniform model.

    ``chosen``: degrees are not those that the training began with, so that its state has to say what they are.
    """

    def __init__(self, indices: Mapping[str, Array], chosen: bool):
        self.indices = {name: np.array(index, np.uint32) for name, index in indices.items() if len(index)}
        self.chosen = chosen
        self.params = {name: device_array(index, mi.UInt32) for name, index in self.indices.items()}
        """Arrays for ``rasterize``."""

    @staticmethod
    def of(splats: Splats, chosen: bool) -> ShRows:
        """Those of a model."""
        return ShRows({name: getattr(splats, name) for name in SH_INDEX.values()}, chosen or splats.mixed_sh)

    @property
    def degree(self) -> int:
        """The highest one of a group, 0 without groups."""
        return max((degree for degree, group in SH.items() if group.index in self.indices), default=0)

    def primitives(self, name: str) -> Array:
        """[M] of the rows of a group's coefficients."""
        return self.indices.get(SH_INDEX[name], np.zeros(0, np.uint32))

    def rearranged(self, index: Array, n: int) -> tuple[ShRows, dict[str, Array]]:
        """After primitive r has become a copy of ``index[r]``, of ``n``: (the rows, old rows of each group's array)."""
        new = {name: selected(of_group, n, index) for name, of_group in self.indices.items()}
        old_rows = {name: new[of_group][1] for name, of_group in SH_INDEX.items() if of_group in new}
        return ShRows({name: found for name, (found, _) in new.items()}, self.chosen), old_rows

    def regrouped(
        self, adam: mi.ad.Adam, bands: Collection[str], n: int, degrees: Array, rate: float
    ) -> tuple[ShRows, dict[str, int]]:
        """Put the arrays ``bands`` of ``n`` primitives, with their moments, into the groups of other degrees.

        Bands that are new are zero; ``rate`` is the step size of them if there were none. Returns (the rows, sizes of
        the rows of each array). Raises ``ValueError`` for another number of degrees, or for what is no degree.
        """
        held = {name: Entry.of(adam, name) for name in bands}

        def moved(part: str) -> Splats:
            nothing, arrays = np.zeros((n, 3)), {name: to_host(getattr(e, part)) for name, e in held.items()}
            sh = sh_arrays(nothing, arrays, self.indices)
            return Splats(nothing, nothing, np.zeros((n, 4)), np.zeros(n), **sh).with_sh_degrees(degrees)

        model, m, v = (moved(part) for part in ("value", "m", "v"))
        for name in held:
            forget(adam, name)
        values, first, second = (bands_of(part) for part in (model, m, v))
        for name, value in values.items():
            adam[name] = device_array(value)
            adam.set_learning_rate({name: rate})
            entry = Entry.of(adam, name)
            like = next(iter(held.values()), entry)  # they have all taken the same steps
            moments = {"m": device_array(first[name]), "v": device_array(second[name])}
            replace(entry, t=like.t, rate=like.rate, **moments).put(adam, name)
        return ShRows.of(model, chosen=True), row_sizes(values, n)

    def state(self) -> dict[str, Array]:
        """What ``of_state`` needs; nothing for a model that has the degrees it began with."""
        none = np.zeros(0, np.uint32)
        return {name: self.indices.get(name, none).copy() for name in SH_INDEX.values()} if self.chosen else {}

    @staticmethod
    def of_state(saved: Mapping[str, Array]) -> ShRows:
        """The rows in the state of an optimizer."""
        found = {name: saved[name] for name in SH_INDEX.values() if name in saved}
        return ShRows(found, bool(found))


def bands_of(splats: Splats) -> dict[str, Array]:
    """The arrays with the bands above the constant one, as the optimizer holds them: rows of ``row_sizes``."""
    if splats.mixed_sh:
        groups = {name: getattr(splats, name) for name in SH_INDEX}
        return {name: padded_rows(values) for name, values in groups.items() if len(values)}
    return {"sh_rest": splats.sh_coeffs} if splats.sh_degree else {}


def row_sizes(bands: Mapping[str, Array], n: int) -> dict[str, int]:
    """Floats in a row of each of these arrays, of ``n`` primitives."""
    return {name: SH_ROW_SIZE.get(name) or values.size // n for name, values in bands.items()}


def sh_arrays(dc: Array, bands: Mapping[str, Array], indices: Mapping[str, Array]) -> dict[str, Array]:
    """The arrays of ``Splats``.

    Args:
        dc: [N, 3] the constant part.
        bands: flat arrays, as of ``bands_of``; what else there is is not looked at.
        indices: of the groups.
    """
    n = len(dc)
    sh: dict[str, np.ndarray] = {"sh_coeffs": dc.reshape(n, 1, 3)}
    if "sh_rest" in bands:
        sh["sh_coeffs"] = np.concatenate([sh["sh_coeffs"], bands["sh_rest"].reshape(n, -1, 3)[:, 1:]], axis=1)
    for degree, group in SH.items():
        (name,) = group.names
        if name in bands:
            sh[name] = bands[name].reshape(-1, ROW_COEFFICIENTS[degree], 3)[:, : (degree + 1) ** 2 - 1]
            sh[group.index] = indices[group.index]
    return sh


def check_bands(saved: Mapping[str, Array], own: Mapping[str, int], n: int) -> None:
    """Raise ``ValueError`` unless the state of ``n`` primitives has the SH degree of this optimizer, or says its own.

    Args:
        own: sizes of the rows that the optimizer has, as of ``row_sizes``.
    """
    rows, names = ShRows.of_state(saved), [name for name in ("sh_rest", *SH_INDEX) if name in saved]
    if rows.chosen:
        sizes = {name: len(rows.primitives(name)) * size for name, size in SH_ROW_SIZE.items()}
        wrong = [name for name, size in sizes.items() if np.size(saved.get(name, ())) != size]
        wrong += ["sh_rest"] if np.size(saved.get("sh_rest", ())) not in [3 * n * k for k in (0, 4, 9, 16)] else []
    else:
        wrong = [name for name, size in own.items() if np.size(saved.get(name, ())) != n * size]
        wrong += [name for name in names if name not in own]
    if wrong:
        raise ValueError(f"SplatOptimizer.restore: {wrong} of the state does not fit this SH degree")
