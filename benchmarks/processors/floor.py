"""How near the forward compositor is to what its arithmetic needs, on AVX-512: instructions and cycles per step.

In a step each of the 16 lanes of a tile blends its next primitive into its 16 pixels: 16 vectors of 16 lanes. A packet
takes as many steps as the longest list of its lanes. ``needed`` counts the least that the formulation of
``engine/walks/walk.py`` has to do in a step, as a table. Against it stands the machine code: Dr.Jit hands out its LLVM
IR, and ``opt`` and ``llc`` (packages llvm-19, of Dr.Jit's own version) compile it as Dr.Jit does; the result is the
code that Dr.Jit logs at level Trace, instruction by instruction. ``llvm-mca`` estimates its cycles, and the clock its
real ones, on a model so faint that no walk ends early. ``machine_code.py`` explains the bounds.
"""

from __future__ import annotations

import argparse
import ctypes
import mmap
import re
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.bands import PreparedView
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks, Grid
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.tables import FIRST_FEATURE
from mi_dogsplat.engine.tiles import WORD, TileLists
from mi_dogsplat.engine.view import prepare
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.support.variants import set_variant

from ..engine.scaling import even_splats, front_camera
from ..flags import at_least_one
from .machine_code import bound, compiled, kind_of, loop_of, mca_cycles, pipe_counts, processor

COLORS = 3
DEC_JNZ_RET = bytes.fromhex("48ffcf75fbc3")  # dec rdi; jnz back; ret: one iteration per cycle


@dataclass(frozen=True)
class Need:
    """``count`` vector instructions per step that one kind of pipe can run."""

    what: str
    pipe: str
    count: float
    folded: bool = False  # a load that is an operand of another instruction


def needed(blocks: Blocks) -> list[Need]:
    """The least per step. State lives in memory: it is four times the registers; each load serves ``unroll`` steps.

    The stop at T < 1e-4 costs its comparison and a masked move: the colours' multiplications are masked for nothing.
    Each lane has an isect of its own: rows are loaded lane by lane, in quarters that an insertion joins, and
    transposed.
    """
    columns = FIRST_FEATURE + COLORS
    w, h, pixels = blocks.width, blocks.height, blocks.width * blocks.height
    state = pixels * (1 + COLORS) / blocks.unroll
    return [
        Need("2^p of the next pixel of a row", "multiply", h * (w - 1)),
        Need("ratio of the next pixel", "multiply", h * (w - 2)),
        Need("first 2^p, its ratio and the ratio down, of the next row", "multiply", 3 * (h - 1) - 1),
        Need("alpha = min(.99, 2^p), masked", "add", pixels),
        Need("2^p >= 1/255", "compare", pixels),
        Need("weight = alpha T", "multiply", pixels),
        Need("T - weight", "add", pixels),
        Need("T >= 1e-4", "compare", pixels),
        Need("T where the walk goes on", "any", pixels),
        Need("colours, masked", "multiply", pixels * COLORS),
        Need("dx, dy", "add", 2),
        Need("u, v, p, and the exponents of two ratios", "multiply", 11),
        Need("3 exponentials: whole part, rest, shift", "add", 3 * 4),
        Need("3 exponentials: polynomial of degree 5", "multiply", 3 * 5),
        Need("3 exponentials: sum of exponents", "any", 3),
        Need("patches below 2^-120 are zero", "compare", 1),
        Need("patches below 2^-120 are zero, masks", "any", 3),
        Need("some pixel still transmits", "add", pixels / blocks.unroll),
        Need("state from memory", "load", state),
        Need("state to memory", "store", state),
        Need("bits of the lane: lowest, rest, is there one", "any", 6),
        Need("its word where there is none, index of the primitive", "load", 2 * blocks.lanes_per_tile, folded=True),
        Need("address of the row, to scalar registers", "to scalar", blocks.lanes_per_tile),
        Need("row of the primitive", "load", columns / 4 * blocks.lanes_per_tile, folded=True),
        Need("row of the primitive, insertions", "compare", columns / 4 * (blocks.lanes_per_tile - 4)),
        Need("row of the primitive, transposed", "any", columns * 2),
    ]


def pipes_of(needs: Sequence[Need]) -> dict[str, float]:
    """Instructions by pipe, and all that have to be decoded."""
    counts: dict[str, float] = {"decode": sum(need.count for need in needs if not need.folded)}
    for need in needs:
        counts[need.pipe] = counts.get(need.pipe, 0) + need.count
    return counts


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    dr.set_thread_count(args.threads or dr.thread_count())
    blocks = Blocks.of_backend()
    if dr.backend_v(mi.Float) != dr.JitBackend.LLVM or blocks.lanes_per_tile != 16:
        raise SystemExit("floor: counts AVX-512 code; the variant must be one of llvm_*")
    run, steps = compositor(args.primitives, args.sigma, blocks)
    kernel = history(run, 1)[0]
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.keep or Path(temporary)
        code = compiled(kernel["ir"].getvalue(), folder)
        loop = loop_of(code)
        mca = mca_cycles(loop, processor(kernel["ir"].getvalue()), folder)

    needs, machine = needed(blocks), pipe_counts(loop)
    least = bound(pipes_of(needs))
    each = 1 / blocks.unroll
    clock, ms = clock_ghz(), float(np.median([k["execution_time"] for k in history(run, args.rounds)]))
    cycles = ms * 1e6 * clock * dr.thread_count() / steps
    stack = sum(bool(re.search(r"\[r[sb]p", line)) for line in loop)
    aligned = "yes" if re.search(r"and\trsp, -64", code) else "no"

    print("\n## Needed\n")
    print(table("for", ((f"{n.what} ({n.pipe}{', folded' * n.folded})", n.count) for n in needs)))
    print("\n## Machine code\n")
    print(table("kind", ((kind, n * each) for kind, n in Counter(kind_of(line)[0] for line in loop).most_common())))
    print("\n## Together\n")
    rows = {
        "instructions needed": pipes_of(needs)["decode"],
        "instructions of the machine code": machine["decode"] * each,
        "of which touch the stack": stack * each,
        "cycles, bound by the pipes for the needed ones": least,
        "cycles, bound by the pipes for the machine code": bound(machine) * each,
        "cycles, llvm-mca": mca * each,
        "cycles, measured": cycles,
        "measured / needed": cycles / least,
    }
    print(table("", rows.items()))
    print(
        f"\n{steps:,} steps, {ms:.2f} ms on {dr.thread_count()} threads at {clock:.2f} GHz; "
        f"the stack is aligned to cache lines: {aligned}; denormals are {denormals(blocks)}"
    )


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks floor", description=__doc__)
    parser.add_argument("--primitives", type=int, default=20_000)
    parser.add_argument("--sigma", type=float, default=6.0, help="median standard deviation in pixels")
    parser.add_argument("--rounds", type=at_least_one, default=31)
    parser.add_argument("--threads", type=int, default=0, help="0: all")
    parser.add_argument("--keep", type=Path, help="leave IR and assembly in this folder, which must exist")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    return parser.parse_args(flags)


def compositor(n: int, sigma: float, blocks: Blocks) -> tuple[Callable[[], None], int]:
    """The forward compositor on its own, at 400x300, and the number of steps that its packets take."""
    camera = front_camera(400)
    params = upload(even_splats(n, sigma, camera, opacity=0.01))
    view = prepare(params, DeviceCamera.upload(camera), RasterOptions(0), blocks)
    assert isinstance(view, PreparedView)
    dr.eval(view)

    def run() -> None:
        dr.eval(composite(view))

    return run, steps_of(view.lists, view.grid)


def steps_of(lists: TileLists, grid: Grid) -> int:
    """Steps of all packets until their longest lists end, as ``AheadList`` walks them: a lane waits for the rest of an
    iteration that empties the word that it is at and the next one."""
    words = lists.words.numpy().reshape(-1, grid.blocks.lanes_per_tile)
    counts = np.unpackbits(words.view(np.uint8).reshape(*words.shape, -1), axis=2).sum(2, dtype=int)
    first, last = (v.numpy() // WORD for v in (lists.begin, lists.end + WORD - 1))
    last = np.where(lists.end.numpy() > lists.begin.numpy(), last, first)
    tiles = np.arange(grid.n_tiles)[:, None]

    def count(group: np.ndarray) -> np.ndarray:  # of isects in a word of each lane, 0 behind the last one
        inside = group < last[:, None]
        at = np.where(inside, tiles + group, 0)
        return np.where(inside, counts[at, np.arange(words.shape[1])], 0)

    following = np.repeat(first[:, None], words.shape[1], 1)
    bits, ahead = count(following), count(following + 1)
    following = following + 2
    iterations = np.zeros(grid.n_tiles, int)
    while True:
        busy = (bits + ahead > 0) | (following < last[:, None])
        if not busy.any():
            return int(iterations.sum() * grid.blocks.unroll)
        iterations += busy.any(1)
        for _ in range(grid.blocks.unroll):
            bits, ahead = np.where(bits == 0, ahead, bits), np.where(bits == 0, 0, ahead)
            bits = np.maximum(bits - 1, 0)
        taken = (ahead == 0) & (following < last[:, None])
        ahead = np.where(taken, count(following), ahead)
        following = following + taken


def history(run: Callable[[], None], times: int) -> list[dict[str, Any]]:
    """What Dr.Jit tells of the largest kernel of each of several runs."""
    found = []
    # a frozen function hides its kernels while it is recorded
    with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False), dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for _ in range(times + 1):
            dr.kernel_history_clear()
            run()
            dr.sync_thread()
            kernels = dr.kernel_history([dr.KernelType.JIT])
            found.append(max(kernels, key=lambda kernel: kernel["operation_count"]))
    return found[1:]  # the first one compiled


def clock_ghz() -> float:
    """Clock of a core, from a loop of one cycle per iteration."""
    memory = mmap.mmap(-1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    memory.write(DEC_JNZ_RET)
    loop = ctypes.CFUNCTYPE(None, ctypes.c_uint64)(ctypes.addressof(ctypes.c_char.from_buffer(memory)))
    count, best = 400_000, float("inf")
    for _ in range(500):
        start = time.perf_counter()
        loop(count)
        best = min(best, time.perf_counter() - start)
    return count / best * 1e-9


def denormals(blocks: Blocks) -> str:
    """Whether kernels of this number of threads flush them: Dr.Jit does in its pool, not in the calling thread."""
    Float = array_types().Float
    lanes = len(dr.arange(Float, Grid(400, 300, blocks).n_tiles * blocks.lanes_per_tile))
    values = dr.full(Float, 1e-38, lanes) * dr.opaque(Float, 0.1)
    return "kept (slow)" if np.any(values.numpy()) else "flushed"


def table(title: str, rows: Iterable[tuple[str, float]]) -> str:
    lines = [f"| {name} | {value:.1f} |" for name, value in rows]
    return "\n".join([f"| {title} | per step |", "|---|---|", *lines])
