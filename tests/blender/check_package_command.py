"""How the checks ask the package: what has not answered in time is ended, and they say where it was."""

import time

import pytest
from package_command import by_package

HANGS = """
import sys, time
print("begun", file=sys.stderr)
def wait_for_ever():
    time.sleep(600)
wait_for_ever()
"""


def test_what_the_package_prints_comes_back():
    assert by_package("import json, sys; print(json.dumps(sys.argv[1:]))", "a", "b") == ["a", "b"]


def test_a_process_that_hangs_is_ended_and_named():
    begun = time.monotonic()
    with pytest.raises(RuntimeError, match=r"(?s)no answer after 4 seconds.*--of.*begun.*wait_for_ever"):
        by_package(HANGS, "--of", "ours", seconds=4)
    assert time.monotonic() - begun < 120


def test_a_process_that_fails_says_why():
    with pytest.raises(RuntimeError, match="status 1.*(?s:.)*it is gone"):
        by_package("raise OSError('it is gone')")
