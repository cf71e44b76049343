"""What draws viewports in the background: how good a picture may be, and which are drawn at all; times are injected."""

import threading
import time

import numpy as np
import pytest

from blender_addon.package.served import RendererError
from blender_addon.viewport.pace import LEVELS, REST, SPARE, TARGET, Level, Pace
from blender_addon.viewport.stream import Stream

SECONDS = 60.0  # that a picture may take on a busy machine


def drawn(pace, seconds, times, now=0.0):
    """So many pictures of which each takes ``seconds`` when all is drawn, and half for each further level."""
    for _ in range(times):
        pace.moved(now)
        level = pace.level(now)
        pace.took(level, seconds * 0.6 ** LEVELS.index(level))
    return LEVELS.index(pace.level(now))


def test_a_view_that_moves_is_drawn_as_well_as_there_is_time_for():
    assert drawn(Pace(), 0.9 * TARGET, 20) == 0
    slow = Pace()
    found = drawn(slow, 4 * TARGET, 20)
    assert SPARE * TARGET < 4 * TARGET * 0.6**found <= TARGET
    assert drawn(slow, 4 * TARGET, 1) == found  # it stays there
    assert drawn(slow, 0.1 * TARGET, 20) == 0  # and comes back
    assert drawn(slow, 1e6, 30) == len(LEVELS) - 1


def test_one_slow_picture_and_those_of_another_level_change_little():
    pace = Pace()
    assert drawn(pace, 1000.0, 1) == 2
    pace.took(LEVELS[0], 1000.0)  # was on its way
    assert LEVELS.index(pace.level(0.0)) == 2


def test_everything_is_due_at_rest():
    pace = Pace()
    drawn(pace, 10.0, 5, now=100.0)
    assert not pace.rests(100.0 + 0.9 * REST) and pace.level(100.0 + 0.9 * REST) != Level()
    assert pace.rests(100.0 + REST) and pace.level(100.0 + REST) == Level()
    pace.moved(101.0)
    assert pace.level(101.0) != Level()


def test_levels_only_get_cheaper():
    costs = [level.pixels**2 * level.splats for level in LEVELS]
    assert costs == sorted(costs, reverse=True) and LEVELS[0] == (1, 1)


class Slow:
    """Draws when it is let."""

    def __init__(self):
        self.go, self.requests = threading.Semaphore(0), []

    def draw(self, request, left):
        self.requests.append(request["name"])
        for step in range(request.get("steps", 1)):
            assert self.go.acquire(timeout=SECONDS)
            if request["name"] == "bad":
                raise RendererError("no such\nthing")
            yield (step + 1) / request.get("steps", 1), np.full((1, 1, 4), step)
            if left():
                return


def until(condition):
    end = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.001)


def test_views_that_were_overtaken_are_never_drawn():
    slow = Slow()
    stream = Stream(slow.draw)
    stream.ask({"name": "first"}, 1)
    until(lambda: slow.requests)
    for name in ("second", "third", "last"):
        stream.ask({"name": name}, name)
    assert stream.frame is None and stream.busy()
    slow.go.release()
    until(lambda: stream.frame and stream.frame.tag == 1)
    slow.go.release()
    until(lambda: stream.frame.tag == "last")
    until(lambda: not stream.busy())
    assert slow.requests == ["first", "last"] and stream.news == 2
    stream.close()


def test_a_picture_that_gets_better_is_left_for_another_view():
    slow, closed = Slow(), []
    stream = Stream(slow.draw, lambda: closed.append(True))
    stream.ask({"name": "good", "steps": 100}, None)
    for news in (1, 2):
        slow.go.release()
        until(lambda news=news: stream.news == news)
    assert stream.frame.share == pytest.approx(0.02)
    stream.ask({"name": "other"}, None)
    slow.go.release()
    slow.go.release()
    until(lambda: stream.frame.share == 1)
    assert slow.requests == ["good", "other"]
    stream.close()
    until(lambda: closed)


def test_an_error_is_one_line_until_there_is_a_picture_again():
    slow = Slow()
    stream = Stream(slow.draw)
    stream.ask({"name": "bad"}, None)
    slow.go.release()
    until(lambda: stream.error)
    assert stream.error == "no such thing" and stream.frame is None and stream.news == 1
    stream.ask({"name": "good"}, None)
    slow.go.release()
    until(lambda: stream.frame)
    assert stream.error == ""
    stream.close()
