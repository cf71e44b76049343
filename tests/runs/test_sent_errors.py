"""Exceptions of the package go from process to process, as those of a pool's workers do, and are copied."""

import copy
import pickle
import signal
from pathlib import Path

import pytest
from mi_dogsplat.runs.stopping import Stopped
from mi_dogsplat.support.errors import DataError


def sent(error):
    return pickle.loads(pickle.dumps(error))


@pytest.mark.parametrize("way", [sent, copy.copy, copy.deepcopy])
@pytest.mark.parametrize("path", ["a.ply", Path("a.ply")])
def test_an_error_of_bad_input_arrives_as_it_was(way, path):
    arrived = way(DataError(path, "has no\nvertices; none", "export it again"))
    assert type(arrived) is DataError
    assert str(arrived) == "a.ply: has no vertices; none; export it again"
    assert arrived.path == Path("a.ply")


@pytest.mark.parametrize("way", [sent, copy.copy, copy.deepcopy])
def test_a_stop_arrives_with_its_line_and_signal(way):
    arrived = way(Stopped("stopped after step 3 of 9", signal.SIGTERM))
    assert type(arrived) is Stopped
    assert (str(arrived), arrived.signal_number) == ("stopped after step 3 of 9", signal.SIGTERM)
