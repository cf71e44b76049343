"""Regions that are wrong beyond what is usual: a high threshold finds them, and a low one says how far they reach."""

import numpy as np
import pytest
from mi_dogsplat.masking.regions import FLOOR, LEAST_AREA, MARGIN, RIM, unusual

SHAPE = 100, 120


def errors(*patches: tuple[slice, slice, float]) -> np.ndarray:
    """Such that the ratio is 1 but for the patches, which have theirs."""
    ratio = np.ones(SHAPE)
    for rows, columns, value in patches:
        ratio[rows, columns] = value
    return (ratio * (0.05 + FLOOR) - FLOOR).astype(np.float32)


def found(*patches, times=4.0) -> np.ndarray:
    return unusual(errors(*patches), np.full(SHAPE, 0.05, np.float32), times)


def test_a_region_is_found_and_widened_by_the_margin():
    assert round(MARGIN * SHAPE[1]) == 1
    expected = np.zeros(SHAPE, bool)
    expected[29:51, 40:60] = expected[30:50, 39:61] = True  # without corners
    np.testing.assert_array_equal(found((slice(30, 50), slice(40, 60), 4.2)), expected)


def test_a_region_reaches_as_far_as_it_is_half_as_wrong():
    weak, strong = (slice(30, 50), slice(40, 60), 4 * RIM + 0.1), (slice(35, 37), slice(45, 47), 4.1)
    assert not found(weak).any()
    np.testing.assert_array_equal(found(weak, strong), found((slice(30, 50), slice(40, 60), 4.2)))
    elsewhere = (slice(70, 90), slice(40, 60), 4 * RIM + 0.1)
    np.testing.assert_array_equal(found(weak, strong, elsewhere), found(weak, strong))
    assert not found((slice(30, 50), slice(40, 60), 4 * RIM - 0.1), strong)[40:].any()


def test_where_the_error_is_usual_nothing_is_found():
    error = errors((slice(30, 50), slice(40, 60), 9))
    assert not unusual(error, error, 4.0).any()


@pytest.mark.parametrize(("side", "is_found"), [(4, False), (5, True)])
def test_small_regions_are_chance(side, is_found):
    assert 4 * 4 < LEAST_AREA * SHAPE[0] * SHAPE[1] < 5 * 5
    assert found((slice(30, 30 + side), slice(40, 40 + side), 9)).any() == is_found


def test_small_errors_say_nothing():
    """A tenth of a percent is ten times as much as a hundredth, and nothing that anybody sees."""
    error = np.full(SHAPE, 1e-4, np.float32)
    error[30:50, 40:60] = 1e-3
    assert not unusual(error, np.full(SHAPE, 1e-4, np.float32), 2.0).any()
