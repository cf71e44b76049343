"""What CUDA's driver is asked for the memory of a GPU, and what is made of its answers."""

import ctypes

import pytest
from mi_dogsplat.support import device_memory
from mi_dogsplat.support.device_memory import free_device_memory

FREE = 5 * 2**30


class Driver:
    """Answers as CUDA's does; ``fails`` names a function that says that it failed."""

    def __init__(self, fails: str = ""):
        self.fails, self.entered, self.retained = fails, 0, 0

    def _answer(self, name: str, does=lambda: None) -> int:
        if name == self.fails:
            return 2
        does()
        return 0

    def cuInit(self, flags) -> int:
        return self._answer("cuInit")

    def cuDeviceGet(self, device, number: int) -> int:
        return self._answer("cuDeviceGet")

    def cuDevicePrimaryCtxRetain(self, context, device) -> int:
        return self._answer("cuDevicePrimaryCtxRetain", lambda: self._count("retained", 1))

    def cuDevicePrimaryCtxRelease_v2(self, device) -> int:
        return self._answer("cuDevicePrimaryCtxRelease_v2", lambda: self._count("retained", -1))

    def cuCtxPushCurrent_v2(self, context) -> int:
        return self._answer("cuCtxPushCurrent_v2", lambda: self._count("entered", 1))

    def cuCtxPopCurrent_v2(self, context) -> int:
        return self._answer("cuCtxPopCurrent_v2", lambda: self._count("entered", -1))

    def cuMemGetInfo_v2(self, free, total) -> int:
        assert self.retained == self.entered == 1
        return self._answer("cuMemGetInfo_v2", lambda: setattr(free._obj, "value", FREE))

    def _count(self, name: str, n: int) -> None:
        setattr(self, name, getattr(self, name) + n)


CALLS = ["cuInit", "cuDeviceGet", "cuDevicePrimaryCtxRetain", "cuCtxPushCurrent_v2", "cuMemGetInfo_v2"]


@pytest.mark.parametrize("fails", ["", *CALLS])
def test_it_is_what_the_driver_says_and_unknown_where_a_call_fails(monkeypatch, fails):
    driver = Driver(fails)
    monkeypatch.setattr(ctypes, "CDLL", lambda path: driver)
    assert free_device_memory() == (None if fails else FREE)
    assert driver.entered == driver.retained == 0  # the context of before is back


def test_without_a_driver_or_with_one_that_cannot_tell_it_is_unknown(monkeypatch):
    monkeypatch.setenv("DRJIT_LIBCUDA_PATH", "/nowhere/libcuda.so")
    assert free_device_memory() is None
    monkeypatch.setattr(device_memory.ctypes, "CDLL", lambda path: object())
    assert free_device_memory() is None
