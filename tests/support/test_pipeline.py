"""Work in threads has the results, the order and the errors of work one by one."""

import signal
import threading
import time

import pytest
from mi_dogsplat.support import pipeline
from mi_dogsplat.support.pipeline import pipelined
from threadpoolctl import threadpool_info

MAIN = threading.main_thread()


@pytest.fixture(params=[1, 2, 5], ids=lambda cores: f"{cores} cores")
def cores(request, monkeypatch):
    monkeypatch.setattr(pipeline, "usable_cores", lambda: request.param)
    return request.param


def test_results_come_in_the_order_of_the_pieces_whichever_is_ready_first(cores):
    def slow_at_first(k: int) -> int:
        time.sleep(0.02 if k % 5 == 0 else 0)
        return k * k

    assert pipelined(slow_at_first, range(20)) == [k * k for k in range(20)]
    assert pipelined(slow_at_first, []) == []


def test_pieces_are_made_by_who_calls_and_one_core_has_no_other_thread(cores):
    makers, workers = set(), set()

    def pieces():
        for k in range(10):
            makers.add(threading.current_thread())
            yield k

    pipelined(lambda k: workers.add(threading.current_thread()), pieces())
    assert makers == {MAIN} and (workers == {MAIN}) == (cores == 1) and len(workers) <= cores


def test_blas_has_one_thread_meanwhile_and_as_many_as_before_afterwards(cores):
    def threads(_: object = None) -> set[int]:
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    before = threads()
    assert before and set.union(*pipelined(threads, range(6))) == (before if cores == 1 else {1})
    assert threads() == before


def test_no_more_pieces_are_there_than_workers_and_one(cores, monkeypatch):
    monkeypatch.setattr(pipeline, "MOST_WORKERS", 3)
    made, done, ahead = 0, [], []

    def pieces():
        nonlocal made
        for k in range(20):
            made += 1
            ahead.append(made - len(done))
            yield k

    def work(k: int) -> None:
        time.sleep(0.002)
        done.append(k)

    pipelined(work, pieces())
    assert len(done) == 20 and max(ahead) <= min(cores, 3) + 1


@pytest.mark.parametrize(("free", "workers"), [(None, 4), (10_000, 4), (800, 3), (500, 1), (10, 1)])
def test_where_memory_is_scarce_there_are_fewer_workers(monkeypatch, free, workers):
    """Half of what is free holds the pieces of all workers, and the one that is made meanwhile."""
    monkeypatch.setattr(pipeline, "usable_cores", lambda: 4)
    monkeypatch.setattr(pipeline, "available_memory", lambda: free)
    seen, together = set(), threading.Barrier(workers, timeout=5)

    def work(k: int) -> None:
        seen.add(threading.current_thread())
        if workers > 1:
            together.wait()

    pipelined(work, range(4 * workers), 100)
    assert len(seen) == workers


@pytest.mark.parametrize("where", ["work", "pieces"])
def test_an_error_reaches_the_caller_when_what_has_begun_is_done_and_ends_the_rest(cores, where):
    begun, done = [], []

    def pieces():
        for k in range(100):
            if where == "pieces" and k == 4:
                raise OSError("disk full")
            yield k

    def work(k: int) -> None:
        begun.append(k)
        if where == "work" and k == 4:
            raise OSError("disk full")
        time.sleep(0.01)
        done.append(k)

    with pytest.raises(OSError, match="disk full"):
        pipelined(work, pieces())
    left = len(begun)
    assert left < 20 and set(begun) - set(done) <= {4}  # nothing is half done
    time.sleep(0.05)
    assert len(begun) == left


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX")
def test_ctrl_c_ends_it_and_waits_for_what_has_begun(cores):
    begun, done = [], []

    def work(k: int) -> None:
        begun.append(k)
        time.sleep(0.02)
        done.append(k)

    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(KeyboardInterrupt):
            pipelined(work, range(1000))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert len(done) < 100 and (cores == 1 or sorted(done) == sorted(begun))
