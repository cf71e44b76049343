"""How many primitives of a model are of each kind, in words."""

from __future__ import annotations

from ..support.wording import count
from .splats import Splats


def kinds(n_dog: object, n_slopes: object, n_cuts: object, n_second_cuts: object) -> str:
    """``1,200 of them DoG, 300 with slopes, 40 with a cut, 30 with a second``; nothing about a kind that is None."""
    of_kind = (n_slopes, "with slopes"), (n_cuts, "with a cut"), (n_second_cuts, "with a second")
    others = [(n, what) for n, what in of_kind if n is not None]
    return ", ".join(f"{count(n)} {what}" for n, what in ((n_dog, "of them DoG"), *others))


def kinds_of(splats: Splats) -> str:
    """Those of a model; nothing about slopes or cuts where there are none."""
    return kinds(splats.n_dog, splats.n_slopes or None, splats.n_cuts or None, splats.n_second_cuts or None)
