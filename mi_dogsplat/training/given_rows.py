"""Rows that a recipe may give to all primitives, beside DoG: slopes, curvatures, cuts and shifts."""

from __future__ import annotations

from typing import NamedTuple

from ..scene.row_groups import CURVATURES, CUTS, SECOND_CUTS, SHIFTS, SLOPES, RowGroup
from .strategy.cut_activation import CutActivation, CutControl, SecondCutActivation, SecondCutControl
from .strategy.row_activation import RowActivation, RowControl
from .strategy.shift_activation import ShiftActivation, ShiftControl
from .strategy.slope_activation import CurvatureActivation, CurvatureControl, SlopeActivation, SlopeControl


class Given(NamedTuple):
    """Whose rows they are, what gives them, and what leaves them out."""

    group: RowGroup
    activation: type[RowActivation]
    control: type[RowControl]


GIVEN = {
    "slopes": Given(SLOPES, SlopeActivation, SlopeControl),
    "curvatures": Given(CURVATURES, CurvatureActivation, CurvatureControl),
    "cuts": Given(CUTS, CutActivation, CutControl),
    "second_cuts": Given(SECOND_CUTS, SecondCutActivation, SecondCutControl),
    "shifts": Given(SHIFTS, ShiftActivation, ShiftControl),
}
"""By the field of ``Recipe`` that is its rule; in the order in which they come."""
