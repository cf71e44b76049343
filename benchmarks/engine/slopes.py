"""What colours cost that vary over their primitive: the same model with slopes and without, with DoG and without.

``python -m benchmarks slopes`` on the points of fern as training starts, or ``--model point_cloud.ply --scene fern`` on
a trained model. ``kinds.py`` says what the rows and columns are.
"""

from __future__ import annotations

from collections.abc import Sequence

from .kinds import as_it_is, compare, dog, with_curvatures, with_slopes

KINDS = {
    "plain": as_it_is,
    "slopes": with_slopes,
    "curvatures": with_curvatures,
    "DoG": dog,
    "DoG, slopes": lambda splats: with_slopes(dog(splats)),
    "DoG, slopes, curvatures": lambda splats: with_curvatures(with_slopes(dog(splats))),
}


def main(flags: Sequence[str]) -> None:
    compare(flags, "slopes", __doc__, KINDS)
