"""How a parallel run of the suite shares the cores."""

import json
import os
import subprocess
import sys
from pathlib import Path

import core_shares
import drjit as dr
import pytest

HELPERS = Path(core_shares.__file__).parent
LINUX = hasattr(os, "sched_setaffinity")
PROGRAM = "import core_shares, os; print(sorted(os.sched_getaffinity(0)))"


def cores_of(worker: str, count: int) -> list[int]:
    """Those of a process that is this worker of so many."""
    environment = os.environ | {"PYTEST_XDIST_WORKER": worker, "PYTEST_XDIST_WORKER_COUNT": str(count)}
    code = f"import os; os.sched_setaffinity(0, {core_shares.ALL_CORES}); {PROGRAM}"
    done = subprocess.run([sys.executable, "-c", code], cwd=HELPERS, env=environment, capture_output=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.skipif(not LINUX, reason="only Linux lets a process choose its cores")
def test_each_worker_has_a_core_of_its_own_where_there_are_as_many():
    every = sorted(core_shares.ALL_CORES)
    assert [cores_of(f"gw{k}", len(every)) for k in range(len(every))] == [[core] for core in every]
    assert cores_of(f"gw{len(every)}", len(every)) == [every[0]]  # in the place of one that died
    assert cores_of("gw0", len(every) + 1) == every


@pytest.mark.skipif(not LINUX, reason="only Linux lets a process choose its cores")
def test_a_test_may_have_all_cores_for_its_threads():
    before, threads = os.sched_getaffinity(0), dr.thread_count()
    with core_shares.on_all_cores():
        dr.set_thread_count(threads + 1)
        of_threads = {frozenset(os.sched_getaffinity(int(task.name))) for task in core_shares.THREADS.iterdir()}
        assert of_threads == {frozenset(core_shares.ALL_CORES)}
        dr.set_thread_count(threads)
    assert os.sched_getaffinity(0) == before


@pytest.mark.skipif(not LINUX, reason="only Linux lets a process choose its cores")
def test_a_thread_that_ends_meanwhile_does_not_matter(monkeypatch, tmp_path):
    (tmp_path / str(2**22 + 1)).touch()  # beyond the largest number that Linux gives
    monkeypatch.setattr(core_shares, "THREADS", tmp_path)
    with core_shares.on_all_cores():
        pass
