"""A million primitives at 1600x1066, all SH degrees: time and peak memory of forward, backward and a training step.

``python -m benchmarks million``: a row for each amount of ``--memory``, in a process of its own, as the peak is that of
its whole life: it has the state of Adam and two photographs, and writes a checkpoint. Points are random, in a cube that
fills the view. On a GPU there is one row, as nothing is divided there, and the peak of the device beside that of the
process.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import Dataset, View
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.engine.bands import BandedView
from mi_dogsplat.runs.checkpoint import save_checkpoint
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.memory import peak_memory_mb
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.train import Trainer

from ..flags import at_least_one
from .trainer_passes import passes

ALL_DEGREES = 4000  # step from which on the colours have all SH degrees


def main(flags: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks million", description=__doc__)
    parser.add_argument("--memory", nargs="*", default=["64G", "5G", "4G"])
    parser.add_argument("--primitives", type=at_least_one, default=1_000_000)
    parser.add_argument("--size", type=int, nargs=2, default=(1600, 1066))
    parser.add_argument("--rounds", type=at_least_one, default=5)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    parser.add_argument("--alone", action="store_true", help="the one amount in this process, as JSON")
    args = parser.parse_args(flags)
    set_variant(args.variant)
    if args.alone:
        print(json.dumps(measured(args)))
        return
    rows = []
    for memory in args.memory[:1] if dr.backend_v(mi.Float) is dr.JitBackend.CUDA else args.memory:
        command = [sys.executable, "-m", "benchmarks", "million", *flags, "--alone", "--memory", memory]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        if done.returncode:
            raise SystemExit(done.returncode)  # it has said why
        rows.append(json.loads(done.stdout))
        if len(rows) == 1:
            print(f"| {' | '.join(rows[0])} |\n" + "|---" * len(rows[0]) + "|")
        cells = [f"{value:,.4g}" if isinstance(value, float) else str(value) for value in rows[-1].values()]
        print(f"| {' | '.join(cells)} |", flush=True)
        if args.json:
            args.json.write_text(json.dumps(rows), encoding="utf-8")
    print(f"{len(rows)} rows")


def measured(args: argparse.Namespace) -> dict[str, Any]:
    """A row for ``args.memory``."""
    config = TrainConfig("random", "3dgs", memory=args.memory[0], variant=args.variant)
    trainer = Trainer(config, random_data(args.primitives, *args.size))
    trainer.step_count = ALL_DEGREES
    times = {f"{name}, ms": 1e3 * seconds(run, args.rounds) for name, run in passes(trainer).items()}
    with tempfile.TemporaryDirectory() as folder:
        save_checkpoint(Path(folder) / "state.npz", trainer.state())
    peak = peak_memory_mb()
    view = trainer.render(trainer.optimizer.params, 0)[1].view
    isects = view.n_isects if view else 0
    if (backend := dr.backend_v(mi.Float)) is dr.JitBackend.CUDA:
        device = dr.detail.malloc_watermark(backend) / 1e6
        return {"isects": isects} | times | {"peak of the device, MB": device, "peak resident, MB": peak}
    bands = len(view.bands) if isinstance(view, BandedView) else 1
    return {"--memory": args.memory[0], "isects": isects, "bands": bands} | times | {"peak resident, MB": peak}


def random_data(n: int, width: int, height: int) -> Dataset:
    """Two views of noise, and points to start from."""
    rng, views = np.random.default_rng(0), []
    for name, x in (("left", -1.0), ("right", 1.0)):
        w2c = look_at(3 * np.array([x, 0, 0.3]), np.zeros(3), "z")
        camera = Camera(w2c, 1.1 * width, 1.1 * width, width / 2, height / 2, width, height)
        views.append(View(name, camera, rng.random((height, width, 3), np.float32)))
    points, colors = rng.uniform(-1, 1, (n, 3)).astype(np.float32), rng.random((n, 3), np.float32)
    return Dataset(Path("random"), views, [], points, colors, False)


def seconds(run: Callable[[], None], rounds: int) -> float:
    """Median, kernels compiled."""
    times = []
    for _ in range(rounds + 2):
        start = time.perf_counter()
        run()
        dr.sync_thread()
        times.append(time.perf_counter() - start)
    return float(np.median(times[2:]))
