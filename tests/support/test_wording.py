"""Numbers as people read them."""

import numpy as np
import pytest
from mi_dogsplat.support import wording


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.04, "0.0 s"), (59.9, "59.9 s"), (59.97, "1 min 00 s"), (302.4, "5 min 02 s"), (3599.4, "59 min 59 s"),
        (3600, "1 h 00 min"), (7385, "2 h 03 min"),
    ],
)
def test_durations_use_the_unit_that_fits(seconds, words):
    assert wording.duration(seconds) == words


def test_times_are_plotted_in_the_unit_of_the_longest():
    assert [wording.time_unit(s) for s in (179, 180, 10_799, 10_800)] == [("s", 1), *[("min", 60)] * 2, ("h", 3600)]


@pytest.mark.parametrize(
    ("n_bytes", "words"),
    [
        (12, "12 bytes"),
        (2300, "2.3 kB"),
        (9_170_000, "9.17 MB"),
        (999_900, "1 MB"),
        (734e6, "734 MB"),
        (2.4e9, "2.4 GB"),
    ],
)
def test_sizes_use_powers_of_a_thousand(n_bytes, words):
    assert wording.file_size(n_bytes) == words


def test_counts_have_separators():
    assert wording.count(312400) == "312,400"


@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), "12", True])
def test_what_is_no_finite_number_is_a_dash(value):
    assert {
        wording.fixed(value, 2),
        wording.count(value),
        wording.duration(value),
        wording.file_size(value),
    } == {wording.MISSING}


def test_numpy_numbers_count_as_numbers():
    assert wording.fixed(np.float32(1.5), 1) == "1.5" and wording.count(np.int64(1200)) == "1,200"


@pytest.mark.parametrize(
    ("names", "words"), [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_names_are_listed_as_people_do(names, words):
    assert wording.in_words(names) == words


def test_a_noun_is_in_the_plural_but_for_one():
    assert [wording.counted(n, "primitive") for n in (0, 1, 2, 312_400)] == [
        "0 primitives", "1 primitive", "2 primitives", "312,400 primitives"
    ]  # fmt: skip
