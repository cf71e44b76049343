"""How much memory the GPU has to give: asked of CUDA's driver, as neither Dr.Jit nor Mitsuba tells."""

from __future__ import annotations

import ctypes
import os
import sys

DRIVER = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"


def free_device_memory() -> int | None:
    """Free bytes of the first device, which is Dr.Jit's; None where the driver does not say.

    What other programs take of it counts as taken.
    """
    device, context, free, total = ctypes.c_int(), ctypes.c_void_p(), ctypes.c_size_t(), ctypes.c_size_t()
    try:
        driver = ctypes.CDLL(os.environ.get("DRJIT_LIBCUDA_PATH") or DRIVER)
        ask, enter, leave = driver.cuMemGetInfo_v2, driver.cuCtxPushCurrent_v2, driver.cuCtxPopCurrent_v2
        retain, release = driver.cuDevicePrimaryCtxRetain, driver.cuDevicePrimaryCtxRelease_v2
        if driver.cuInit(0) or driver.cuDeviceGet(ctypes.byref(device), 0):
            return None
    except (OSError, AttributeError):  # no driver, or one that lacks a function
        return None
    if retain(ctypes.byref(context), device):  # the context that Dr.Jit is in, too
        return None
    failed = enter(context)
    if not failed:
        failed = ask(ctypes.byref(free), ctypes.byref(total))
        leave(ctypes.byref(context))
    release(device)
    return None if failed else free.value
