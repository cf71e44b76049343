"""Frames per second of a viewport that orbits a model, in Blender's window: the table in docs/blender_details.md.

    xvfb-run -a -s "-screen 0 1600x1000x24" blender --window-geometry 0 0 1600 1000 --factory-startup \\
        --python scripts/blender/orbit.py -- MODEL.ply [SHOW:MOVING:COUNT:FOLLOW …]

SHOW is a way to show ("Automatic", "Points", …, or "Nothing" for an empty viewport), MOVING that of "While Moving"
("POINTS", "SHARE", "ALL"), COUNT the splats while moving, FOLLOW 1 with "Follow View". Each line has the seconds of the
wall and of the processor for a redraw, while a timer turns the view by two degrees after each. The add-on's own
handlers do what they do for a person. Without a window (the Python that has bpy) it times what a moved view costs
before anything is drawn: the evaluation of the nodes.
"""

from __future__ import annotations

import itertools
import math
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy
from mathutils import Matrix, Quaternion

SECONDS = 20.0  # of each orbit
FEWEST, MOST = 4, 60  # redraws of it
DRAWN: list[tuple[float, float]] = []  # wall and processor time at the end of each redraw


def note() -> None:
    """After a viewport was drawn."""
    DRAWN.append((time.perf_counter(), time.process_time()))


def settled() -> Iterator[float]:
    """Until no redraw is asked for any more: shaders are compiled by then."""
    area, _ = viewport()
    for _ in range(2):
        area.tag_redraw()
        before = len(DRAWN)
        while len(DRAWN) == before:
            yield 0.2
        yield 3.0


def orbit(show: str, moving: str, count: int, follow: bool) -> Iterator[float]:
    """Turn the view and print what a redraw takes."""
    from blender_addon.nodes.modifier import set_input, splat_modifier

    scene, obj = bpy.context.scene, bpy.context.view_layer.objects.active
    obj.hide_viewport = show == "Nothing"
    if show != "Nothing":
        set_input(splat_modifier(obj), "Show As", show)
        obj.update_tag()
    scene.dogsplat_moving, scene.dogsplat_moving_count, scene.dogsplat_follow_view = moving, count, follow
    yield from settled()
    start, first = time.perf_counter(), len(DRAWN)
    while len(DRAWN) - first < FEWEST or (time.perf_counter() - start < SECONDS and len(DRAWN) - first < MOST):
        yield from turn_view(math.radians(2), DRAWN)
    taken = [(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(DRAWN[first:])]
    wall, cpu = (statistics.median(column) for column in zip(*taken, strict=True))
    print(f"{show}, moving {moving} {count}, follow {follow}: {len(taken)} redraws, median {wall:.3f} s of the wall "
          f"({1 / wall:.1f}/s), {cpu:.3f} s of the processor", flush=True)  # fmt: skip


def steps(model: str, orbits: list[str]) -> Iterator[float]:
    """Import, then every orbit."""
    yield 2.0
    _, space = viewport()
    import_into_view(model)
    bpy.context.scene.eevee.taa_samples = 1
    space.shading.type, space.overlay.show_overlays = "MATERIAL", False
    for show, moving, count, follow in (text.split(":") for text in orbits):
        yield from orbit(show, moving, int(count), follow == "1")


def evaluations(model: str, orbits: list[str]) -> None:
    """The median time in which the nodes are evaluated for another view."""
    from blender_addon.nodes.modifier import set_input, splat_modifier
    from blender_addon.viewport.handlers import while_moving
    from blender_addon.viewport.view import View
    from blender_addon.viewport.watcher import show_models

    scene = empty_file()
    bpy.ops.import_scene.dogsplat(filepath=model)
    obj = bpy.context.object
    for way, scene.dogsplat_moving, count, follow in (text.split(":") for text in orbits):
        scene.dogsplat_moving_count = int(count)
        set_input(splat_modifier(obj), "Show As", way)
        taken = []
        for k in range(11):
            pose = Quaternion((0, 0, 1), math.radians(2 * k)).to_matrix().to_4x4() @ Matrix.Translation((0, 0, 4))
            view = View(tuple(map(tuple, pose)), (900.0, 900.0), (655.5, 439.0), (1311, 878))
            show_models(scene, while_moving(scene, ""), view if follow == "1" else None)
            obj.update_tag()
            start = time.perf_counter(), time.process_time()
            bpy.context.view_layer.update()
            taken.append((time.perf_counter() - start[0], time.process_time() - start[1]))
        wall, cpu = (statistics.median(column) for column in zip(*taken, strict=True))
        print(f"{way}, moving {scene.dogsplat_moving} {count}, follow {follow}: nodes {wall:.3f} s of the wall, "
              f"{cpu:.3f} s of the processor")  # fmt: skip


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    sys.path.insert(1, str(Path(__file__).resolve().parent))  # Blender leaves it out
    import addon_utils
    from in_blender import empty_file, import_into_view, step_by_step, turn_view, viewport

    addon_utils.enable("blender_addon")
    MODEL, *ORBITS = sys.argv[sys.argv.index("--") + 1 :]
    ORBITS = ORBITS or [f"Automatic:{way}:20000:{follow}" for follow in (0, 1) for way in ("POINTS", "SHARE", "ALL")]
    if bpy.app.background:
        evaluations(MODEL, ORBITS)
        sys.exit()
    bpy.types.SpaceView3D.draw_handler_add(note, (), "WINDOW", "POST_PIXEL")
    step_by_step(steps(MODEL, ORBITS))
