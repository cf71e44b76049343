"""Memory that Dr.Jit asks for, on any backend."""

import gc
from collections.abc import Callable

import drjit as dr
import mitsuba as mi


def device_peak(run: Callable[[], object]) -> int:
    """The most bytes that a call has at a time besides what was there before, the second time that it runs."""
    most = 0
    for _ in range(2):
        gc.collect()
        dr.sync_thread()
        dr.flush_malloc_cache()
        dr.detail.malloc_clear_statistics()
        before = dr.detail.malloc_watermark(dr.backend_v(mi.Float))
        run()
        dr.sync_thread()
        most = dr.detail.malloc_watermark(dr.backend_v(mi.Float)) - before
    return most
