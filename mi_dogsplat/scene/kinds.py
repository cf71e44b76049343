"""How many primitives of a model are of each kind, in words."""

from __future__ import annotations

from collections.abc import Mapping

from ..support.wording import count, in_words
from .splats import Splats

COUNTED = {
    "n_dog": "of them DoG",
    "n_slopes": "with slopes",
    "n_curvatures": "with curvatures",
    "n_cuts": "with a cut",
    "n_second_cuts": "with a second cut",
    "n_shifts": "with shifts",
}
"""Kinds of primitives, by the names of their numbers in models and files of a run."""


def kinds(numbers: Mapping[str, object]) -> str:
    """``1,200 of them DoG, 300 with slopes, 40 with a cut, 30 with a second cut``.

    Nothing is said of a kind whose number is None, unless it is DoG.
    """
    said = [name for name in COUNTED if name == "n_dog" or numbers.get(name) is not None]
    return ", ".join(f"{count(numbers.get(name))} {COUNTED[name]}" for name in said)


def kinds_of(splats: Splats) -> str:
    """Those of a model; nothing of kinds that it has not, unless it is DoG."""
    return kinds({name: getattr(splats, name) or None for name in COUNTED} | {"n_dog": splats.n_dog})


def varying(splats: Splats) -> str:
    """By what colours vary over primitives: ``slopes``, ``curvatures``, both of them, or nothing."""
    rows = {"slopes": splats.n_slopes, "curvatures": splats.n_curvatures}
    return in_words([name for name, number in rows.items() if number])
