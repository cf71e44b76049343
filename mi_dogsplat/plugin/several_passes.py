"""Renders of several samples per pixel: the mean of passes, and its derivatives in both modes.

Passes are drawn some after others, and of those that are done sums are kept: memory does not grow with their number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.arrays import backward
from .film import develop
from .filter import Filter, normalized
from .samples import Sample


@dataclass
class SeveralPasses:
    """Those of a render.

    images: planes of the film's channels of each of some passes; with how many pixels around the film's window; and
        whether they are wanted for their AD graph only.
    together: how many passes are asked for at a time.
    apart: as of ``Filter``.
    """

    film: Any  # mi.Film
    aov_names: list[str]
    passes: list[Sample]
    images: Callable[[list[Sample], int, bool], list[list[mi.Float]]]
    together: int
    apart: bool

    def __post_init__(self) -> None:
        self._filter = Filter(self.film, self.apart)
        self._places = self._filter.places(self.passes)

    def planes(self, on_pass: Callable[[int, int], None] | None) -> list[mi.Float]:
        """Means. ``on_pass`` is called after passes with the number of those that are done, and of all."""
        totals, done = [], 0
        for group in self._groups():
            for sums in self._sums(group, derivative=False):
                totals = _added(totals, sums)
            done += len(group)
            if on_pass:
                dr.sync_thread()
                on_pass(done, len(self.passes))
        return normalized(totals)

    def tangent(self) -> mi.TensorXf:
        """Of the developed image, by forward mode."""
        totals = []
        for group in self._groups():
            for sums in self._sums(group, derivative=True):
                totals = _added(totals, [*tangents(sums)[:-1], *dr.detach(sums)])
        n = len(totals) // 2
        planes = normalized(totals[n:])
        dr.enable_grad(planes)
        dr.set_grad(planes, normalized([*totals[:n], totals[-1]]))
        return tangents(develop(self.film, self.aov_names, planes, derivative=True))

    def backward(self, grad_in: Any, n_planes: int, params: dict) -> None:
        """From the adjoint of the developed image to gradients: the mean is linear in the passes.

        params: what all passes are drawn from, attached or not.
        """
        adjoints = self._adjoints(grad_in, n_planes)
        for group in self._groups():
            with dr.isolate_grad():  # what all passes share is derived once, at the end
                values = [plane for sums in self._sums(group, derivative=True) for plane in sums[:-1]]
                backward(values, adjoints * len(group))
            dr.eval([dr.grad(value) for value in params.values() if dr.grad_enabled(value)])

    def _adjoints(self, grad_in: Any, n_planes: int) -> list[mi.Float]:
        """Those of the sums, the same for each pass."""
        pixels: Any = dr.prod(self.film.crop_size())
        planes = [dr.zeros(mi.Float, pixels) for _ in range(n_planes)]
        dr.enable_grad(planes)
        backward([develop(self.film, self.aov_names, planes, derivative=True)], [grad_in])
        weights: Any = sum(self._filter.spread([], sample)[0] for sample in self._places)
        adjoints = normalized([*dr.grad(planes), weights])
        dr.eval(adjoints)
        return adjoints

    def _groups(self) -> Iterator[list[Sample]]:
        """Passes that are drawn together."""
        for k in range(0, len(self._places), self.together):
            yield self._places[k : k + self.together]

    def _sums(self, group: list[Sample], derivative: bool) -> Iterator[list[mi.Float]]:
        """Of each, what ``Filter.spread`` returns."""
        images = self.images(group, self._filter.border, derivative)
        for image, sample in zip(images, group, strict=True):
            yield self._filter.spread(image, sample)


def tangents(values: Any) -> Any:
    """What parameters say of them. Those of what a parameter was computed to stay for the next render of its graph."""
    dr.forward_to(values, flags=dr.ADFlag.ClearEdges | dr.ADFlag.AllowNoGrad)
    return dr.grad(values)


def _added(totals: list, values: list) -> list:
    totals = [a + b for a, b in zip(totals, values, strict=True)] if totals else values
    dr.eval(totals)
    return totals
