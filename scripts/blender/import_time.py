"""Wall time of an import in Blender, the first evaluation of the nodes for the viewport included.

Models of 100,000 primitives, made by the first line:

    .venv/bin/python scripts/blender/import_time.py make WORK
    .venv-blender/bin/python scripts/blender/import_time.py WORK/*.ply
    blender --background --factory-startup --python scripts/blender/import_time.py -- WORK/*.ply

Prints for each file the median of five imports, each into an empty scene, after one that does not count.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
COUNT, REPEATS = 100_000, 5


def make(folder: Path) -> None:
    """Write a Gaussian and a DoG model of SH degree 3, the largest that there is."""
    sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "helpers")]
    import mi_dogsplat  # noqa: F401  (before mitsuba: it chooses the LLVM)
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    from mi_dogsplat.scene.ply import write_ply
    from splat_scenes import random_splats, rounded

    folder.mkdir(parents=True, exist_ok=True)
    splats = rounded(random_splats(COUNT, dog_share=1.0))
    write_ply(folder / "dog.ply", splats)
    write_ply(folder / "gaussian.ply", splats.plain())


def measure(paths: list[str]) -> None:
    """Print the medians in seconds."""
    import bpy

    sys.path[:0] = [str(ROOT), str(ROOT / "scripts" / "blender")]  # Blender leaves the second one out
    for path in paths:
        times = [_import(path) for _ in range(REPEATS + 1)][1:]
        each = ", ".join(f"{seconds:.2f}" for seconds in times)
        print(f"{bpy.app.version_string} {Path(path).name}: {statistics.median(times):.2f} s ({each})")


def _import(path: str) -> float:
    import bpy
    from in_blender import empty_file

    empty_file()
    start = time.perf_counter()
    bpy.ops.import_scene.dogsplat(filepath=path)
    shown = bpy.context.evaluated_depsgraph_get()
    seconds = time.perf_counter() - start
    assert len(shown.object_instances) >= COUNT  # the ellipsoids are there
    return seconds


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if arguments[0] == "make":
        make(Path(arguments[1]))
    else:
        measure(arguments)
