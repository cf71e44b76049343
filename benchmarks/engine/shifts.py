"""What places cost that depend on the view: the same model with shifts and without, with DoG and without.

``python -m benchmarks shifts`` on the points of fern as training starts, or ``--model point_cloud.ply --scene fern`` on
a trained model. ``kinds.py`` says what the rows and columns are. Pixels know nothing of shifts: all that they cost is
in the projection, once for each primitive.
"""

from __future__ import annotations

from collections.abc import Sequence

from .kinds import as_it_is, compare, dog, with_shifts

KINDS = {
    "plain": as_it_is,
    "shifts": with_shifts,
    "DoG": dog,
    "DoG, shifts": lambda splats: with_shifts(dog(splats)),
}


def main(flags: Sequence[str]) -> None:
    compare(flags, "shifts", __doc__, KINDS)
