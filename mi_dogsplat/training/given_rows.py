"""Rows that a recipe may give to all primitives, beside DoG: slopes, curvatures, cuts and shifts."""

from __future__ import annotations

from .strategy.cut_activation import begun_second_cuts, shown_cuts
from .strategy.row_activation import GivenRows
from .strategy.shift_activation import begun_shifts, shown_shifts
from .strategy.slope_activation import shown_slopes

KINDS = (
    GivenRows("slopes", shown_slopes),
    GivenRows("curvatures", shown_slopes),
    GivenRows("cuts", shown_cuts),
    GivenRows("second_cuts", shown_cuts, begun_second_cuts),
    GivenRows("shifts", shown_shifts, begun_shifts),
)
GIVEN = {rows.name: rows for rows in KINDS}
"""By the field of ``Recipe`` that is its rule; in the order in which they come."""
