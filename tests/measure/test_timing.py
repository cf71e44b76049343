"""Timing in turns."""

import pytest
from mi_dogsplat.measure.timing import milliseconds_in_turn


def test_jobs_take_turns_after_one_warm_up_each():
    calls: list[str] = []
    times = milliseconds_in_turn({name: lambda name=name: calls.append(name) for name in "ab"}, 3)
    assert "".join(calls) == "ab" + "ab" * 3 and set(times) == {"a", "b"}


def test_the_time_of_a_job_is_its_median_without_the_warm_up(monkeypatch):
    ticks = iter([0.0, 0.010, 1.0, 1.500, 2.0, 2.020])  # start and end of three rounds
    monkeypatch.setattr("time.perf_counter", lambda: next(ticks))
    assert milliseconds_in_turn({"a": lambda: None}, 3) == {"a": pytest.approx(20)}
