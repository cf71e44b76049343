"""One variant for the whole suite. mi_dogsplat comes before mitsuba: it chooses the LLVM that Dr.Jit loads.

Before both comes what decides how many threads they start.
"""

import gc
import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import core_shares
import mi_dogsplat  # noqa: F401
import mitsuba as mi
import pytest
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.support.cores import usable_cores
from mi_dogsplat.support.llvm import find_llvm

VARIANT = os.environ.get("DOGSPLAT_TEST_VARIANT", "llvm_ad_rgb")
mi.set_variant(VARIANT)
WITHOUT_OPTIX = {"DRJIT_LIBCUDA_PATH", "DOGSPLAT_TEST_WITHOUT_OPTIX"} & set(os.environ)
WORKERS = core_shares.WORKERS


@pytest.hookimpl(optionalhook=True)  # unknown where pytest-xdist is not installed
def pytest_xdist_auto_num_workers() -> int:
    """``pytest -n auto``: one for each core that may be used."""
    return usable_cores()


def pytest_configure() -> None:
    """As many threads as a process has cores: threads that wait spin, and two on one core take twice as long as one.

    Ctrl-C interrupts, which tests press: a shell lets what it runs in the background ignore it.
    """
    import drjit as dr

    dr.set_thread_count(max(1, dr.thread_count() // max(1, WORKERS)))
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is collected stays to the end: Python looks through all else alone for what is not needed any more."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """In parallel, where a file is the work of one process, files with many slow tests are given out first."""
    if WORKERS:
        slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
        items.sort(key=lambda item: -slow[item.path])


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call():
    """What a machine with a GPU may lack: OptiX, without which no scene is loaded; LLVM, which some tests compare with.

    A stand-in for the driver of CUDA (scripts/gpu/test_cuda.sh) has no OptiX either.
    """
    try:
        return (yield)
    except Exception as error:
        if WITHOUT_OPTIX and "Could not initialize OptiX" in str(error):
            pytest.skip("loads a scene: needs OptiX, which is not there")
        if VARIANT.startswith("cuda") and "LLVM" in str(error) and find_llvm() is None:
            pytest.skip("compares with LLVM, which is not there")
        raise


@pytest.fixture(autouse=True)
def _variant():
    """A test that changes the variant does not disturb the next one."""
    yield
    if mi.variant() != VARIANT:
        mi.set_variant(VARIANT)


@pytest.fixture
def ordered():
    """For tests of equal bits after training: skips where these depend on the order of threads."""
    if not lanes_add_in_turn(mi.variant()):
        pytest.skip("this backend adds the gradients of a tile with atomics, in any order")


@pytest.fixture
def all_cores() -> Iterator[None]:
    """For tests of what threads at the same time could spoil: a thread for each core, and four at least."""
    import drjit as dr

    before = dr.thread_count()
    with core_shares.on_all_cores():
        dr.set_thread_count(max(4, len(core_shares.ALL_CORES)))
        yield
        dr.set_thread_count(before)


@pytest.fixture
def two_threads() -> Iterator[None]:
    """For tests that have Mitsuba write or read OpenEXR: with one thread Mitsuba 3.9 waits for ever there."""
    import drjit as dr

    before = dr.thread_count()
    dr.set_thread_count(max(2, before))
    yield
    dr.set_thread_count(before)


@pytest.fixture
def small_blocks(monkeypatch):
    """For tests with many kernels, where blocks do not matter: a lane has the pixels that it has on CUDA, and takes a
    primitive an iteration. Such kernels are compiled in half the time.
    """
    from dataclasses import replace

    from mi_dogsplat.engine.geometry import Blocks

    blocks = replace(Blocks.of_backend(), width=4, height=2, unroll=1, adapts=False)
    monkeypatch.setattr(Blocks, "of_backend", lambda: blocks)


@pytest.fixture
def fresh_recordings():
    """For tests of what a call launches: nothing of the calls before is known to frozen functions."""
    from lean_calls import forget_recordings

    forget_recordings()


@pytest.fixture(scope="session")
def data(tmp_path_factory) -> Iterator[Path]:
    """The tiny data set, opaque. All tests of all processes share it, and none writes to it."""
    from shared_folder import unchanged_folder
    from tiny_data import write_tiny_data

    yield from unchanged_folder(tmp_path_factory.getbasetemp(), "tiny", write_tiny_data)


@pytest.fixture(scope="session")
def alpha_data(tmp_path_factory) -> Iterator[Path]:
    """The same with transparent pictures."""
    from shared_folder import unchanged_folder
    from tiny_data import write_tiny_data

    base = tmp_path_factory.getbasetemp()
    yield from unchanged_folder(base, "tiny_alpha", lambda folder: write_tiny_data(folder, alpha=True))


@pytest.fixture(scope="session")
def model(tmp_path_factory) -> Iterator[Path]:
    """The file of the model that its pictures show. All tests of all processes share it, and none writes beside it."""
    from shared_folder import unchanged_folder
    from tiny_data import write_tiny_model

    for folder in unchanged_folder(tmp_path_factory.getbasetemp(), "tiny_model", write_tiny_model):
        yield folder / "model.ply"


@pytest.fixture(autouse=True, scope="session")
def _without_waiting_for_the_disk():
    """Nothing that a test writes has to outlast a power cut, and for each file that has to a disk takes some 5 ms."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(autouse=True, scope="session")
def _without_the_users_cache(tmp_path_factory):
    """What is measured does not depend on whether this machine has the weights of LPIPS."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield
