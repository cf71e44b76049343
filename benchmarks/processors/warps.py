"""One list per lane or one per tile: the steps that a warp of CUDA takes, and the primitives that it meets in them.

Counted, not timed, with the lists and blocks of CUDA, on any backend. A warp takes as many steps as its longest lane.
In a step it loads the rows of as many primitives as its lanes are at, and adds to as many in a derivative: an addition
of Dr.Jit (1.5) first sums over the lanes that are at the same row, in rounds that halve the most crowded row. With a
CUDA variant the instructions (PTX) of a step are counted too. "Compared": with how many an isect is compared to find
its place in its bucket (``engine/tile_buckets.py``), the mean of all.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import drjit as dr
import numpy as np
from mi_dogsplat.engine.bands import PreparedView
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.tile_buckets import DEPTHS
from mi_dogsplat.engine.view import prepare
from mi_dogsplat.engine.walks.adjoints import composite_backward
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.engine.walks.pixels import Planes
from mi_dogsplat.engine.walks.walk import Walk
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

from ..models import fern_opaque, fern_points, playbot

BLOCKS = Blocks(4, 2, 4, 8, 1)  # CUDA's
CASES = {
    "fern, as initialised": fern_points,
    "fern, random opacities": fern_opaque,
    "fern x 10, as initialised": lambda: fern_points(10),
    "playbot": playbot,
}
COLUMNS = 9  # that a derivative adds to a row
# instructions of an addition where all lanes of a warp are at one row; else without its rounds, and of a round
UNIFORM, PARTIAL, ROUND = 24, 19, 11
SELECTION = 16  # instructions of a step that find a lane's next primitive in its words


@dataclass
class Counts:
    """Of an image: isects, and for each form steps of all warps, rows that they meet, and rounds of an addition."""

    isects: int = 0
    lane_steps: int = 0
    lane_rows: int = 0
    lane_rounds: int = 0
    tile_steps: int = 0
    compared: float = 0.0


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks warps", description=__doc__)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    variant = parser.parse_args(arguments).variant
    set_variant(variant)
    instructions = None
    if variant.startswith("cuda"):
        instructions = per_step()
        print("instructions of a step: {} forward, {} in the derivative without its additions".format(*instructions))
    columns = "isects|compared|steps, lists of lanes|of tiles|rows in a step of lanes|rounds|forward|derivative"
    print(f"| | {columns.replace('|', ' | ')} |\n{'|---' * 9}|")
    for name, case in CASES.items():
        c = counts(*case())
        cells = [f"{c.isects:,}", f"{c.compared:.1f}", f"{c.lane_steps:,}"]
        cells.append(f"{c.tile_steps:,} ({c.tile_steps / c.lane_steps:.2f}x)")
        cells += [f"{c.lane_rows / c.lane_steps:.1f}", f"{c.lane_rounds / c.lane_steps:.1f}"]
        cells += [f"{ratio:.2f}x" for ratio in instruction_ratios(c, *instructions)] if instructions else ["", ""]
        print(f"| {name} | {' | '.join(cells)} |")


def instruction_ratios(c: Counts, forward: int, backward: int) -> tuple[float, float]:
    """Instructions with lists of tiles over those with lists of lanes, (forward, derivative)."""
    lanes = (backward + COLUMNS * PARTIAL) * c.lane_steps + COLUMNS * ROUND * c.lane_rounds
    tiles = (backward - SELECTION + COLUMNS * UNIFORM) * c.tile_steps
    return (forward - SELECTION) * c.tile_steps / (forward * c.lane_steps), tiles / lanes


def per_step() -> tuple[int, int]:
    """PTX instructions of a step of the compositor and of its derivative: kernels with two in an iteration, less those
    with one."""
    splats, camera = fern_points()
    (f1, b1), (f2, b2) = (compositor_sizes(splats, camera, unroll) for unroll in (1, 2))
    return f2 - f1, b2 - b1


def compositor_sizes(splats: Splats, camera: Camera, unroll: int) -> tuple[int, int]:
    options = RasterOptions(sh_degree=0)
    view = prepare(upload(splats), DeviceCamera.upload(camera), options, replace(BLOCKS, unroll=unroll))
    found: list[Planes] = []
    forward = largest_kernel(lambda: dr.eval(found.append(composite(view)), found))
    T = found[0].T
    δ = Planes([dr.opaque(type(T), 1, dr.width(T)) for _ in found[0].features], dr.zeros(type(T), dr.width(T)))
    return forward, largest_kernel(lambda: dr.eval(composite_backward(view, found[0], δ)))


def largest_kernel(run: Callable[[], object]) -> int:
    """Instructions of the longest kernel that is launched."""
    dr.sync_thread()
    # a frozen function hides its kernels while it is recorded
    with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False), dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        run()
        dr.sync_thread()
        history: Any = dr.kernel_history([dr.KernelType.JIT])
    return max(ptx_instructions(kernel["ir"].getvalue()) for kernel in history)


def ptx_instructions(code: str) -> int:
    kernel = code[code.index(".entry") :]
    return len(re.findall(r"^\s*(?:@!?%\w+ )?[a-z]+(?:\.\w+)*\s+[^;]*;", kernel, re.MULTILINE))


def counts(splats: Splats, camera: Camera) -> Counts:
    params, device_camera = upload(splats), DeviceCamera.upload(camera)
    degree = splats.sh_degree
    view = prepare(params, device_camera, RasterOptions(sh_degree=degree), BLOCKS)
    assert isinstance(view, PreparedView)
    depths = project(params, device_camera, sh_degree=degree).depth.numpy()
    depth = depths[view.lists.splat_from_isect.numpy()]
    walked_to = ends_of_walks(view)
    words = view.lists.words.numpy().reshape(-1, BLOCKS.lanes_per_tile)
    begin, end = view.lists.begin.numpy(), view.lists.end.numpy()
    bits = depth.view(np.int32).astype(np.int64)
    bucket = (bits - bits.min()) * DEPTHS // (int(np.ptp(bits)) + 1)
    bucket += DEPTHS * np.repeat(np.arange(len(begin)), end - begin)
    found = Counts(isects=len(bucket), compared=float(np.square(np.bincount(bucket)).sum() / len(bucket)))
    for tile in np.flatnonzero(end > begin):
        b, e = int(begin[tile]), int(end[tile])
        of_tile = words[tile + b // 32 : tile + (e - 1) // 32 + 1]
        bits = (of_tile[:, None] >> np.arange(32, dtype=np.uint32)[:, None]) & 1  # [words, 32, lanes]
        listed = bits.reshape(-1, BLOCKS.lanes_per_tile)[b % 32 : b % 32 + e - b].astype(bool)  # [isects, lanes]
        met = listed & (np.arange(b, e)[:, None] < walked_to[tile])
        step = np.cumsum(met, axis=0) - 1  # of the lane, in which it meets an isect
        isect, lane = np.nonzero(met)
        rows, peers = np.unique(step[isect, lane] * np.int64(e - b) + isect, return_counts=True)
        most = np.zeros(int(met.sum(axis=0).max()), int)
        np.maximum.at(most, rows // (e - b), peers)
        found.lane_steps += len(most)
        found.lane_rows += len(peers)
        found.lane_rounds += int(np.ceil(np.log2(most)).sum())
        found.tile_steps += int(walked_to[tile].max()) - b
    return found


def ends_of_walks(view: PreparedView) -> np.ndarray:
    """[tiles, lanes] isect before which a lane's walk ends: its tile's end, or where its last pixel is opaque."""
    walk = Walk(view)

    def step(meeting, T: list, last: list) -> None:
        for k, a in enumerate(walk.alphas(meeting).values):
            _, T[k], _ = walk.advance(a, T[k], meeting, k)
        last[0] = dr.select(meeting.active, meeting.isect + 1, last[0])

    T, last = walk.run(step, [walk.types.UInt(0)], "ends of walks")
    largest: Any = reduce(dr.maximum, T)  # finished pixels have -T
    end = dr.gather(walk.types.UInt, view.lists.end, view.lanes.tile)
    return dr.select(largest > 0, end, last[0]).numpy().reshape(-1, BLOCKS.lanes_per_tile)
