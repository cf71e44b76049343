"""How many primitives of a model are of each kind, in words."""

from __future__ import annotations

from ..support.wording import count
from .splats import Splats


def kinds(n_dog: object, n_slopes: object, n_cuts: object) -> str:
    """``1,200 of them DoG, 300 with slopes, 40 with a cut``; nothing about a kind whose number is None."""
    others = [(n, what) for n, what in ((n_slopes, "with slopes"), (n_cuts, "with a cut")) if n is not None]
    return ", ".join(f"{count(n)} {what}" for n, what in ((n_dog, "of them DoG"), *others))


def kinds_of(splats: Splats) -> str:
    """Those of a model; nothing about slopes or cuts where there are none."""
    return kinds(splats.n_dog, splats.n_slopes or None, splats.n_cuts or None)
