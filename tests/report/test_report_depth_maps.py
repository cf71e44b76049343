"""What is told of depth maps where metrics.json says less than a run does."""

import pytest
from mi_dogsplat.report.depth_maps import told_of_depth_maps


@pytest.mark.parametrize(
    ("depths", "told"),
    [
        (None, None),
        ({}, None),
        ({"views": "many", "used": 3}, None),
        ({"views": 1234, "used": 3}, "3 of 1,234 training views, depth"),
        ({"views": 4, "used": 3, "inverse": True, "error": "much"}, "3 of 4 training views, inverse depth"),
        (
            {"views": 4, "used": 3, "inverse": False, "error": 0.0213},
            "3 of 4 training views, depth, median error 2.1 % at the sparse points",
        ),
    ],
)
def test_depth_maps_are_told_as_far_as_they_are_known(depths, told):
    assert told_of_depth_maps({} if depths is None else {"depths": depths}) == told
