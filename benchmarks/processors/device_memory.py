"""Peak memory of the device by the number of primitives: ``python -m benchmarks device_memory``.

Primitives are spread evenly over a view of 800x600 pixels, at fixed coverage, SH degree 3. Three peaks of Dr.Jit's
allocator, each from empty caches: a picture, a picture with its derivatives, and steps of training (L1 + SSIM, Adam).
"""

from __future__ import annotations

import argparse
import gc
import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import drjit as dr
import mitsuba as mi
from mi_dogsplat.support.variants import set_variant

from ..engine.lean import engine_backward, engine_forward
from ..engine.scaling import even_model, front_camera
from ..engine.training_step import contestants

STEPS = 3  # the first allocates what the next ones find


def main(flags: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks device_memory", description=__doc__)
    parser.add_argument("--primitives", type=int, nargs="*", default=[10_000, 100_000, 300_000, 1_000_000, 3_000_000])
    parser.add_argument("--width", type=int, default=800, help="of the view, 4:3")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    args = parser.parse_args(flags)
    set_variant(args.variant)
    rows, camera = [], front_camera(args.width)
    for n in args.primitives:
        splats = even_model(n, camera)
        peaks = {
            "picture, MB": peak(partial(engine_forward, splats, camera, 3)),
            "with derivatives, MB": peak(partial(engine_backward, splats, camera, 3)),
            "training, MB": peak(lambda model=splats: contestants(model, camera)["step"]),
        }
        most = 1e6 * peaks["training, MB"] / n
        rows.append({"primitives": n, "pixels": f"{camera.width}x{camera.height}", **peaks, "bytes a primitive": most})
        print(rows[-1], flush=True)
        if args.json:
            args.json.write_text(json.dumps(rows), encoding="utf-8")
    print(f"{len(rows)} rows")


def peak(prepare: Callable[[], Callable[[], None]]) -> float:
    """Most that was allocated at once, in MB, what ``prepare`` uploads included."""
    gc.collect()
    dr.sync_thread()
    dr.flush_malloc_cache()
    dr.detail.malloc_clear_statistics()
    run = prepare()
    for _ in range(STEPS):
        run()
    dr.sync_thread()
    return dr.detail.malloc_watermark(dr.backend_v(mi.Float)) / 1e6
