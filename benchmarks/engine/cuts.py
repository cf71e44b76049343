"""What it costs that planes cut primitives off: the same model with cuts and without, with DoG and slopes and without.

``python -m benchmarks cuts`` on the points of fern as training starts, or ``--model point_cloud.ply --scene fern`` on a
trained model. ``kinds.py`` says what the rows and columns are.
"""

from __future__ import annotations

from collections.abc import Sequence

from .kinds import as_it_is, compare, dog, with_curvatures, with_cuts, with_slopes, with_two_cuts

KINDS = {
    "plain": as_it_is,
    "cuts": with_cuts,
    "two cuts": with_two_cuts,
    "DoG": dog,
    "DoG, cuts": lambda splats: with_cuts(dog(splats)),
    "DoG, slopes": lambda splats: with_slopes(dog(splats)),
    "DoG, slopes, cuts": lambda splats: with_cuts(with_slopes(dog(splats))),
    "DoG, slopes, two cuts": lambda splats: with_two_cuts(with_slopes(dog(splats))),
    "DoG, slopes, curvatures, two cuts": lambda splats: with_two_cuts(with_curvatures(with_slopes(dog(splats)))),
}


def main(flags: Sequence[str]) -> None:
    compare(flags, "cuts", __doc__, KINDS)
