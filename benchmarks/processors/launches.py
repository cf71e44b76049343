"""What the device is given to do in a training step: launches, copies and memsets, by the stage that asks for them, and
how long it takes for them.

Dr.Jit's history of kernels says it for every backend. Times are those of the last of some calls, each kernel's by
itself, so that their sum is what a step takes at least; the wall time says what it takes. It does not see all that a
driver of CUDA is asked for (the transpositions of a sort, memsets, copies); a driver that counts does
(``DRJIT_LIBCUDA_PATH``, as ``make test-cuda`` sets it).
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import drjit as dr
import numpy as np
from mi_dogsplat.datasets import Dataset, View
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.row_groups import BESIDE_COLORS
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

from ..engine.trainer_passes import passes
from ..timing import unawaited

WARM_UP = 6  # calls, in which frozen functions are recorded
VIEWS = 5  # of the training; what depends on the number of isects would be the same in each step of one
STAGES = {  # the innermost of these functions that is running, by file and name, has what is launched meanwhile
    ("engine/rasterize.py", "rasterize"): "project",
    ("engine/tiles.py", "tiles"): "tiles",
    ("drjit/__init__.py", "_radix_sort"): "sort by depth",
    ("engine/drjit_internals.py", "argsort_small"): "sort by tile",
    ("walks/composite.py", "composite"): "composite",
    ("walks/adjoints.py", "composite_backward"): "composite backward",
    ("engine/projected.py", "backward"): "project backward",
    ("training/images/loss.py", "value_and_gradient"): "loss",
    ("strategy/densify_stats.py", "add"): "statistics",
    ("training/optimizer/trained_arrays.py", "step"): "optimizer",
}
ELSEWHERE = "elsewhere"
TIME = "ms"
COUNTED = ("launches", "memsets", "device_to_device", "host_to_device", "device_to_host", "stream_syncs")


def driver_counters() -> Callable[[], dict[str, int]] | None:
    """A function that reads the totals of a driver that counts, by name; None if this one does not."""
    try:
        library = ctypes.CDLL(os.environ["DRJIT_LIBCUDA_PATH"])
        library.cuda_standin_counters.restype = ctypes.POINTER(ctypes.c_uint64)
        library.cuda_standin_counter_names.restype = ctypes.c_char_p
    except (KeyError, OSError, AttributeError):
        return None
    names, values = library.cuda_standin_counter_names().decode().split(), library.cuda_standin_counters()
    return lambda: {name: int(values[k]) for k, name in enumerate(names)}


class Watch:
    """Counts by stage while it is entered."""

    def __init__(self) -> None:
        self.by_stage: dict[str, Counter] = {}
        self.each: list[tuple[str, str, int, int, float]] = []  # stage, kind, lanes, operations, ms of a kernel
        self._stack = [ELSEWHERE]
        self._read = driver_counters()
        self._last: Counter = Counter()
        self._names: dict[Any, str | None] = {}

    def __enter__(self) -> Watch:
        dr.sync_thread()
        dr.set_flag(dr.JitFlag.KernelHistory, True)
        dr.kernel_history_clear()
        self._last = Counter(self._read()) if self._read else Counter()
        sys.setprofile(self._event)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)
        self._note()
        dr.set_flag(dr.JitFlag.KernelHistory, False)
        dr.sync_thread()

    def _event(self, frame: FrameType, event: str, _: object) -> None:
        if event not in ("call", "return"):
            return
        code = frame.f_code
        if code not in self._names:
            self._names[code] = _stage_of(code.co_filename, code.co_name)
        stage = self._names[code]
        if stage is None:
            return
        self._note()
        if event == "call":
            self._stack.append(stage)
        else:
            self._stack.pop()

    def _note(self) -> None:
        counts = self.by_stage.setdefault(self._stack[-1], Counter())
        if self._read:
            now = Counter(self._read())
            counts.update({name: now[name] - self._last[name] for name in COUNTED})
        history: Any = dr.kernel_history()
        for kernel in history:
            if kernel["type"] != dr.KernelType.LLVMHostFunc:
                kind = str(kernel["type"]).split(".")[-1]
                counts["kernels" if kind == "JIT" else "Dr.Jit's own"] += 1
                counts[TIME] += kernel["execution_time"]
                self.each.append(
                    (self._stack[-1], kind, kernel["size"], kernel.get("operation_count", 0), kernel["execution_time"])
                )
        if self._read:
            self._last = Counter(self._read())


def _stage_of(file: str, name: str) -> str | None:
    return next((stage for (of_file, of), stage in STAGES.items() if of == name and file.endswith(of_file)), None)


def rows_of(watch: Watch) -> list[dict[str, Any]]:
    """Counts and milliseconds by stage, and of all together."""
    known = set().union(*watch.by_stage.values())
    columns = [name for name in ("kernels", "Dr.Jit's own", TIME, *COUNTED) if name in known]
    stages = [(stage, watch.by_stage[stage]) for stage in (*STAGES.values(), ELSEWHERE) if stage in watch.by_stage]
    stages.append(("all", sum((counts for _, counts in stages), Counter())))
    return [{"": stage} | {name.replace("_", " "): counts[name] for name in columns} for stage, counts in stages]


def table(rows: list[dict[str, Any]]) -> str:
    """Of some rows, as Markdown."""
    lines = [f"| {' | '.join(rows[0])} |", "|" + "---|" * len(rows[0])]
    for row in rows:
        cells = [f"{row[name]:.3f}" if name == TIME else str(row.get(name) or "") for name in rows[0]]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def watched(run: Callable[[], Any]) -> Watch:
    """One call, once everything is compiled."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):  # frozen functions have recordings of their own under it
        for _ in range(WARM_UP):
            run()
        with Watch() as watch:
            run()
    return watch


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks launches", description=__doc__)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--primitives", type=int, default=10_000)
    parser.add_argument("--size", type=int, nargs=2, default=(400, 300), metavar=("W", "H"))
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--dog", action="store_true", help="all primitives are DoG")
    some.add_argument("--everything", action="store_true", help="all have what ours_shifts gives them, and joint steps")
    parser.add_argument("--each", action="store_true", help="list the kernels one by one")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    args = parser.parse_args(arguments)
    set_variant(args.variant)
    width, height = args.size
    found = []
    trainer = trainer_of(args.primitives, width, height, args.dog, args.everything)
    for name, run in passes(trainer).items():
        watch = watched(run)
        print(f"\n# {name} ({args.variant}, {trainer.optimizer.n:,} primitives, {width}x{height})")
        rows = [*rows_of(watch), {"": "wall time", TIME: unawaited(run)}]
        print(table(rows))
        found += [{"pass": name} | row for row in rows]
        if args.each:
            for stage, kind, lanes, operations, ms in watch.each:
                print(f"{stage:20} {kind:10} {lanes:9,d} lanes {operations:6d} operations {ms:9.4f} ms")
    if args.json:
        args.json.write_text(json.dumps(found), encoding="utf-8")
        print(f"{len(found)} rows")


def trainer_of(n: int, width: int, height: int, dog: bool = False, everything: bool = False) -> Trainer:
    """A training of ``n`` primitives on random pictures: in the middle of its densification, or, with ``everything``,
    once all rows are there that ``ours_shifts`` gives."""
    rng = np.random.default_rng(0)
    image = rng.uniform(0, 1, (height, width, 3)).astype(np.float32)
    points = rng.uniform([-1, -0.8, 2], [1, 0.8, 4], (n, 3)).astype(np.float32)
    colors = rng.uniform(0, 1, (n, 3)).astype(np.float32)
    poses = [np.eye(4) for _ in range(VIEWS)]
    for k, w2c in enumerate(poses):
        w2c[0, 3] = 0.02 * k
    cameras = [Camera(w2c, width, width, width / 2, height / 2, width, height) for w2c in poses]
    views = [View(f"random {k}", camera, image) for k, camera in enumerate(cameras)]
    dataset = Dataset(Path("random"), views, [], points, colors, False)
    if everything:
        trainer = Trainer(TrainConfig("random", "ours_shifts", steps=30_000, target=0.999), dataset)
        for group in BESIDE_COLORS:
            values = {name: rng.normal(0, 0.1, (n, *shape)) for name, shape in group.arrays.items()}
            trainer.optimizer.set_rows(group, np.arange(n), values)
        trainer.step_count = 20_001
        return trainer
    trainer = Trainer(TrainConfig("random", steps=30_000), dataset)
    trainer.step_count = 3_501  # all degrees of SH are in use, and no step of the next hundred changes primitives
    if dog:
        trainer.optimizer.set_dog(np.arange(n), np.full(n, -2.0), np.full((n, 3), -0.5))
    return trainer
