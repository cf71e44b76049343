"""The numbers that a file can hold, as tables, and the model that is read back from a file, without writing one.

A format stores a code of some bits. A *grid* lists what its codes stand for, or every so many of them: SPZ and SOG
compress their codes, and fewer different ones take fewer bytes. Readers notice nothing. How coarse a grid may be is
measured in docs/quantisation.md.

View-dependent colours are entries of a *palette*, many primitives to one. SOG has a palette; in SPZ equal rows that
follow each other compress to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.scales import finite_scales
from ..scene.splats import Array, Splats
from .packing import from_smallest_three, smallest_three
from .palette import centred, lloyd, nearest_entries, palette
from .symmetries import nearest_to_identity

LLOYD_ROUNDS = 3  # more gain little
MOST_ENTRIES = 8192  # of a palette, for each SH degree, unless a file has room for more
SMALL = 10  # per cent of the primitives that are smaller than what steps of positions are measured by


@dataclass(frozen=True)
class Steps:
    """How far the values of each grid are apart."""

    position: float = 1 / 8  # at most, in middle scales of a primitive that is small (``Extents.small``)
    log_scale: int = 1  # sixteenths
    rotation: int = 1  # 1 / (127.5 √2); odd, as SOG has no zero
    opacity: int = 3  # 255ths; a divisor of 255
    color: int = 1  # of f_dc: 1 / 38.25 in SPZ, 1 / 40 in SOG
    sh: int = 4  # 128ths
    entries: float = 1 / 4  # of the palette, for each primitive


@dataclass(frozen=True)
class Extents:
    """What grids have to cover."""

    low: Array  # [3] of the positions
    high: Array  # [3]
    small: float  # middle scale that all but ``SMALL`` per cent exceed
    small_at_1: float  # the same of scales over 1 + |x|, the largest of the coordinates
    log_scales: tuple[float, float]
    dc: tuple[float, float]
    linear: bool = False  # colours are radiance, in units of white

    @property
    def numbers(self) -> Array:
        """All of them, [12] float64, and one more of linear colours."""
        linear = [1.0] if self.linear else []
        return np.concatenate([self.low, self.high, [self.small, self.small_at_1], self.log_scales, self.dc, linear])

    @classmethod
    def from_numbers(cls, x: Array) -> Extents:
        """The extents with these ``numbers``."""
        small, small_at_1, *bounds = x[6:].tolist()
        return cls(x[:3], x[3:6], small, small_at_1, (bounds[0], bounds[1]), (bounds[2], bounds[3]), len(bounds) > 4)

    @classmethod
    def of(cls, splats: Splats, linear: bool = False) -> Extents:
        """Those of a model, of linear colours in units of white."""
        middle = np.sort(splats.log_scales.astype(np.float64), axis=1)[:, 1]  # [N]
        at_1 = middle - np.log1p(np.abs(splats.means).max(axis=1))
        scales, dc = splats.log_scales, splats.sh_coeffs[:, 0]
        return cls(
            low=splats.means.min(axis=0).astype(np.float64),
            high=splats.means.max(axis=0).astype(np.float64),
            small=float(finite_scales(np.percentile(middle, SMALL))),
            small_at_1=float(finite_scales(np.percentile(at_1, SMALL))),
            log_scales=(float(scales.min()), float(scales.max())),
            dc=(float(dc.min()), float(dc.max())),
            linear=linear,
        )


@dataclass(frozen=True)
class Grid:
    """``values`` [C], increasing; a number becomes the one in whose interval it lies, between two ``cuts`` [C - 1].

    Both are float32, so that comparing and looking up gives the same bits here and on a device.
    """

    values: Array
    cuts: Array

    @classmethod
    def of(cls, values: Array, cuts: Array | None = None) -> Grid:
        """A grid of increasing values, cut half-way between them unless told where."""
        values = np.asarray(values, np.float64)
        cuts = (values[1:] + values[:-1]) / 2 if cuts is None else np.asarray(cuts, np.float64)
        return cls(values.astype(np.float32), cuts.astype(np.float32))

    def snap(self, x: Array) -> Array:
        """The value for each of ``x``, float32 of its shape."""
        return self.values[np.searchsorted(self.cuts, np.asarray(x, np.float32), side="right")]


@dataclass(frozen=True)
class Palette:
    """SH without the first coefficient; primitives of different degrees share no entry."""

    entries: Array  # [P, K - 1, 3], zero above the degree of
    degrees: Array  # [P] its primitives
    labels: Array  # [N] entry of each primitive


@dataclass(frozen=True)
class FileGrids:
    """The grids of a model in a format; ``three`` is that of the smallest three components of a quaternion."""

    means: tuple[Grid, Grid, Grid]
    log_scales: Grid
    three: Grid
    logit_opacities: Grid
    sh_dc: Grid
    sh_rest: Grid

    def palette(
        self,
        splats: Splats,
        share: float,
        weights: Array | None = None,
        before: Palette | None = None,
        rounds: int = LLOYD_ROUNDS,
        most: int = MOST_ENTRIES,
    ) -> Palette:
        """A palette of ``share`` entries for each primitive.

        Args:
            weights: [N] how much an error of each primitive's colour counts, positive; None: all alike.
            before: the palette of the same primitives, with the same bands, before they moved. Its entries follow
                those that have them, and each primitive gets the nearest.
            rounds: of Lloyd's algorithm for a new one; 0 is fast and as good for an estimate of a file's size.
            most: entries of a new one, for each SH degree.
        """
        degrees, whole = splats.sh_degrees, splats.uniform_sh().sh_coeffs[:, 1:]
        w = np.ones(len(whole)) if weights is None else weights
        found, of_entries, labels = [], [], np.zeros(len(whole), np.int64)
        for degree in np.unique(degrees):
            rows, used = np.flatnonzero(degrees == degree), (degree + 1) ** 2 - 1
            rest, nearest, entries = whole[rows, :used].reshape(len(rows), 3 * used), 0, np.zeros((1, 0), np.float32)
            if used:
                if before:
                    old = np.flatnonzero(before.degrees == degree)
                    entries = before.entries[old, :used].reshape(-1, 3 * used)
                    entries = centred(rest, np.searchsorted(old, before.labels[rows]), entries, w[rows])
                    nearest = nearest_entries(rest, entries)
                else:
                    nearest, entries = palette(rest, int(np.clip(round(share * len(rows)), 1, most)), w[rows])
                    if rounds:
                        nearest, entries = lloyd(rest, entries, w[rows], rounds)
            labels[rows] = nearest + len(of_entries)
            of_entries += [degree] * len(entries)
            on_grid = self.sh_rest.snap(entries.reshape(len(entries), used, 3))
            found.append(np.pad(on_grid, ((0, 0), (0, whole.shape[1] - used), (0, 0))))
        return Palette(np.concatenate(found), np.array(of_entries), labels)

    def snap(self, splats: Splats, colors: Palette) -> Splats:
        """A model of plain Gaussians as its file will say it."""
        turned = nearest_to_identity(splats)
        largest, three = smallest_three(turned.quats.astype(np.float64))
        means = [grid.snap(x) for grid, x in zip(self.means, splats.means.T, strict=True)]
        dc = self.sh_dc.snap(splats.sh_coeffs[:, :1])
        whole = Splats(
            means=np.stack(means, axis=1),
            log_scales=self.log_scales.snap(turned.log_scales),
            quats=from_smallest_three(largest, self.three.snap(three)),
            logit_opacities=self.logit_opacities.snap(splats.logit_opacities),
            sh_coeffs=np.concatenate([dc, colors.entries[colors.labels]], axis=1),
        )
        return whole.with_sh_degrees(splats.sh_degrees) if splats.mixed_sh else whole
