"""What docs/derivatives.md shows of every kind of parameter, held to a tolerance.

Per pixel and per entry: ``test_gradients.py``, ``test_mitsuba_derivatives.py``, ``test_pose.py``.
"""

import numpy as np
import pytest

from benchmarks.numerics.derivative_cases import Case, broad_splats, cases, twin_image
from benchmarks.numerics.derivatives import FILMS, TWIN_SPP, Film, derived, differences, rough_splats, twin_difference

BROAD, ROUGH = broad_splats(), rough_splats()
FILTERED, NARROW = Film("luminance", "gaussian", 3), Film("luminance", "tent", 3)
CASES = pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)


@pytest.mark.slow
@CASES
def test_both_modes_equal_differences_of_the_twin_or_of_mi_render_itself(case: Case):
    if case.twin:
        expected, tolerance = twin_difference(case, ROUGH), 1e-3
        got = derived(case, FILMS[0], ROUGH, TWIN_SPP if case.least_spp > 1 else 1)
    else:
        expected, apart = differences(case, FILMS[0], BROAD)
        got, tolerance = derived(case, FILMS[0], BROAD), 1e-2
        assert apart < tolerance * abs(expected)
    np.testing.assert_allclose(got, expected, rtol=tolerance)


@pytest.mark.slow
@CASES
def test_both_modes_equal_differences_over_filtered_samples_on_a_film_that_converts_colours(case: Case):
    # Mitsuba compiles the derivative of a sky once for each pixel that a sample adds to: 16 with the one filter, which
    # takes seconds, and 4 with the other
    film = NARROW if case.sky == "envmap" or case.name.startswith("`radiance`") else FILTERED
    expected, apart = differences(case, film, BROAD)
    assert apart < 1e-2 * abs(expected)
    np.testing.assert_allclose(derived(case, film, BROAD), expected, rtol=1e-2)


def test_the_names_of_all_cases_differ_and_each_moves_its_twin():
    assert len({case.name for case in cases()}) == len(cases())
    for case in cases():
        if case.twin and case.sensor == "perspective":
            unmoved = twin_image(case.model(ROUGH))
            np.testing.assert_allclose(case.twin(ROUGH, 0.0), unmoved, atol=1e-12)
            assert np.abs(case.twin(ROUGH, 0.01) - unmoved).max() > 1e-6
