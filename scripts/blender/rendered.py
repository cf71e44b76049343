"""Frames per second of a viewport that our engine draws ("Rendered" shading): the tables in docs/blender_details.md.

    PYTHON_WITH_BPY scripts/blender/rendered.py MODEL.ply COMMAND
    xvfb-run -a -s "-screen 0 1600x1000x24" blender --window-geometry 0 0 1600 1000 --factory-startup \\
        --python scripts/blender/rendered.py -- MODEL.ply COMMAND [PICTURE.png]

COMMAND is how the package is started, as in the preferences of the add-on. The first line has no window: it times the
pictures alone, as the add-on gets them, while the view turns by two degrees after each. "all" is every pixel and every
splat, as at rest; "moving" is what the pace of a moving view chooses. The second line orbits in Blender's window and
times whole redraws, and saves a picture of the window at rest (with ImageMagick). ``scripts/blender/rendered.sh`` calls
both, on one core, two, and all.
"""

from __future__ import annotations

import itertools
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
from mathutils import Matrix

SIZES = (800, 600), (1311, 878)
PICTURES, ROUNDS = 15, 3
REDRAWS = 60
TURN = math.radians(2)
LONGEST = 300.0  # seconds to wait for the first picture
DRAWN: list[tuple[float, float, int]] = []  # wall and processor time, and news, at the end of each redraw


def framed(obj: bpy.types.Object) -> tuple[np.ndarray, float]:
    """(centre [3], radius) of nine tenths of the splats."""
    points = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.vertices.foreach_get("co", points.ravel())
    centre = np.median(points, axis=0)
    return centre, float(np.quantile(np.linalg.norm(points - centre, axis=1), 0.9))


def orbiting(centre: np.ndarray, radius: float, size: tuple[int, int], turns: int) -> SimpleNamespace:
    """A viewport with its lens of 50 mm that frames the model, turned so many times."""
    x, near, far = 50 / 36 * 2, 0.01, 1000.0
    y = x * size[0] / size[1]
    pose = Matrix.Translation(centre.tolist()) @ Matrix.Rotation(turns * TURN, 4, "Z") @ Matrix.Rotation(1.1, 4, "X")
    pose = pose @ Matrix.Translation((0, 0, radius * math.hypot(1, max(x, y))))
    depth = (0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)), (0, 0, -1, 0)
    rows = Matrix(((x, 0, 0, 0), (0, y, 0, 0), *depth))
    return SimpleNamespace(view_matrix=pose.inverted(), window_matrix=rows, is_perspective=True)


def pictures(command: str) -> None:
    """Times of the pictures alone."""
    from blender_addon.engine.order import make_stage
    from blender_addon.package.live import live_renderer
    from blender_addon.viewport.pace import Level, Pace
    from blender_addon.viewport.region import seen_by
    from blender_addon.viewport.rendered import request_of

    scene, renderer = bpy.context.scene, live_renderer(command)
    frame = framed(bpy.context.object)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    start = time.perf_counter()
    stage = make_stage(depsgraph, renderer.folder, seen_by(orbiting(*frame, SIZES[0], 0), *SIZES[0]).camera)
    print(f"stage written in {time.perf_counter() - start:.2f} s", flush=True)
    taken: dict[tuple, list[float]] = {}
    paces = {size: Pace() for size in SIZES}
    for turn, size, way in itertools.product(range(ROUNDS), SIZES, ("all", "moving")):
        for k in range(PICTURES):
            now, pace = time.monotonic(), paces[size]
            pace.moved(now)
            level = pace.level(now) if way == "moving" else Level()
            seen = seen_by(orbiting(*frame, size, PICTURES * turn + k), *size).scaled(level.pixels)
            start = time.perf_counter()
            list(renderer.pictures(request_of(stage, scene, seen, level, rests=True), lambda: False))
            seconds = time.perf_counter() - start
            if way == "moving":
                pace.took(level, seconds)
            if turn or k > PICTURES // 2:  # kernels are compiled, and the pace has found its level
                taken.setdefault((size, way), []).append(seconds)
    for (size, way), times in taken.items():
        level = paces[size].level(time.monotonic()) if way == "moving" else Level()
        level = f"{level.pixels:.3g} of the pixels along each axis, {level.splats:.3g} of the splats"
        median = statistics.median(times)
        print(f"{size[0]}x{size[1]} {way}: {median * 1e3:.0f} ms, {1 / median:.1f} pictures a second; {level}")
    renderer.close()


def redraws(model: str, command: str, picture: str | None) -> Iterator[float]:
    """Times of whole redraws in the window."""
    from blender_addon.viewport import rendered

    preferences, scene = bpy.context.preferences, bpy.context.scene
    preferences.addons["blender_addon"].preferences.command = command
    yield 2.0
    subprocess.run(["xdotool", "mousemove", "700", "950", "click", "1"], check=True)  # away with the splash screen
    yield 1.0
    _, space = viewport()
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    import_into_view(model)
    scene.view_settings.view_transform = "Standard"
    view = None
    bpy.types.SpaceView3D.draw_handler_add(lambda: note(view), (), "WINDOW", "POST_PIXEL")
    for shading, overlays in itertools.product(("SOLID", "RENDERED"), (True, False)):
        space.overlay.show_overlays = overlays
        if overlays:  # the first of two
            scene.render.engine = "DOGSPLAT" if shading == "RENDERED" else "BLENDER_WORKBENCH"
            bpy.context.object.hide_set(shading == "SOLID")
            space.shading.type = shading
        yield 1.0
        start = time.monotonic()
        while shading == "RENDERED" and time.monotonic() - start < LONGEST:
            yield 0.2
            view = next(iter(rendered.viewports()), None)
            if view and view.error:
                raise RuntimeError(view.error)
            if view and view.news and not view.waits(time.monotonic()):
                break
        if picture and shading == "RENDERED" and overlays:
            subprocess.run(["import", "-window", "root", picture], check=True)
        DRAWN.clear()
        while len(DRAWN) < REDRAWS:
            yield from turn_view(TURN, DRAWN)
        report("empty, solid" if shading == "SOLID" else "our engine", overlays)


def note(view) -> None:
    """After a viewport was drawn."""
    DRAWN.append((time.perf_counter(), time.process_time(), view.news if view else 0))


def report(what: str, overlays: bool) -> None:
    """A line about the latest orbit."""
    later = DRAWN[len(DRAWN) // 3 :]  # by then the pace has found its level
    wall, cpu = (statistics.median(b[k] - a[k] for a, b in itertools.pairwise(later)) for k in (0, 1))
    seconds = later[-1][0] - later[0][0]
    drawn, made = (len(later) - 1) / seconds, (later[-1][2] - later[0][2]) / seconds
    print(f"{what}, overlays {'on' if overlays else 'off'}: {drawn:.1f} redraws a second (median {wall:.3f} s of the "
          f"wall, {cpu:.3f} s of Blender's processors), {made:.1f} pictures a second", flush=True)  # fmt: skip


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    sys.path.insert(1, str(Path(__file__).resolve().parent))  # Blender leaves it out
    import addon_utils
    from in_blender import empty_file, import_into_view, step_by_step, turn_view, viewport

    MODEL, COMMAND, *MORE = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if bpy.app.background:
        empty_file(COMMAND)
        bpy.ops.import_scene.dogsplat(filepath=MODEL)
        print(f"{len(bpy.context.object.data.vertices):,} splats, {len(os.sched_getaffinity(0))} cores", flush=True)
        pictures(COMMAND)
        sys.exit()
    addon_utils.enable("blender_addon", default_set=True)
    step_by_step(redraws(MODEL, COMMAND, MORE[0] if MORE else None))
