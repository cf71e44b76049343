"""Stage 3, *composite*: blend every pixel's primitives front to back.

Notation (Kerbl et al. 2023, Sec. 6; DoG as in the method paper, Sec. 3.3)
    p      log2 of a kernel's value at a pixel, lo - u² - v²,  u = ux dx + uy dy,  v = vy dy
    α      min(.99, 2^p), for a DoG primitive min(.99, 2^p) - min(.99, 2^p'), ignored where |α| < 1/255
    T      transmittance in front of the primitive; T ← T (1 - α), the walk ends before T would fall below 1e-4, or,
           behind very many negative α, exceed 2^30
    C      Σ c α T, for each feature c (the colour channels, and depth if asked for); a colour with slopes is
           c + gx dx + gy dy (``slopes.py``), one whose brightness curves has more (``curvatures.py``)
    2^p    and 2^p' are those times g of a primitive that a plane cuts off (``cuts.py``)

``walk.py`` says how it runs.
"""

from __future__ import annotations

import drjit as dr

from ..arrays import array_types
from ..bands import PreparedView, WalkableView
from ..frozen import frozen
from .pixels import Planes, planes_of
from .walk import Meeting, Walk


def composite(view: WalkableView) -> Planes:
    """Blend."""
    *features, T = planes_of(view.walked(_composite, []), view.settings.n_features + 1)
    return Planes(features, T)


def composite_over(view: WalkableView, background: float) -> list:
    """The planes of the features over a grey level."""
    blended = composite(view)
    level = dr.opaque(array_types().Float, background)
    return [dr.fma(blended.T, level, plane) for plane in blended.features]


@frozen
def _composite(view: PreparedView, above: list) -> list:
    if view.lists.dog is None:
        return _blended(Walk(view, blends_only=True), above)
    # few tiles have a DoG primitive: the others do not pay for its branch
    plain = _blended(Walk(view, dog=False, blends_only=True), above)
    return _blended(Walk(view, dog=True, blends_only=True), plain)


def _blended(walk: Walk, written: list) -> list:
    """Interleaved planes, new ones or those that are ``written`` already, but for the pixels that are walked."""
    features = range(walk.settings.n_features)

    def step(meeting: Meeting, T: list, C: list) -> None:
        alpha, values = walk.alphas(meeting).values, walk.features(meeting)
        for k in range(walk.pixels.count):
            weight, T[k], goes_on = walk.advance(alpha[k], T[k], meeting, k)
            for f in features:
                c = C[f][k]
                C[f][k] = dr.select(goes_on, dr.fma(weight, values[f][k], c), c)

    T, C = walk.run(step, [walk.pixels.zeros() for _ in features], "composite")
    return walk.pixels.write([*C, [dr.abs(t) for t in T]], written, walk.walked)
