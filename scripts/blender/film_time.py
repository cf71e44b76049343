"""How many frames per minute the engine *DoG Splat (Mitsuba)* renders: splats alone, a camera that turns.

    PYTHONPATH=$PWD .venv-blender/bin/python scripts/blender/film_time.py MODEL [FRAMES] [--restart]

Through the command ``dogsplat`` of ``.venv``. The first frame, in which the process starts, is counted. ``--restart``:
a process for each frame. With PYTHONPATH at another checkout it measures the add-on that is there.
"""

import math
import sys
import tempfile
import time
from pathlib import Path

import bpy
from in_blender import empty_file
from mathutils import Matrix

ROOT = Path(__file__).resolve().parents[2]
FRAMES, SIZE = 12, (640, 480)


def prepare(model: Path) -> bpy.types.Scene:
    """A scene of the model and a camera around it."""
    scene = empty_file()
    bpy.ops.import_scene.dogsplat(filepath=str(model))
    splats = bpy.context.object
    centre = sum((v.co for v in splats.data.vertices), splats.data.vertices[0].co * 0) / len(splats.data.vertices)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    for frame in range(1, FRAMES + 1):
        turn = Matrix.Rotation(math.radians(3 * frame), 4, "Z") @ Matrix.Rotation(math.radians(65), 4, "X")
        camera.matrix_world = Matrix.Translation(centre) @ turn @ Matrix.Translation((0, 0, 4))
        for name in ("location", "rotation_euler"):
            camera.keyframe_insert(name, frame=frame)
    scene.render.engine = "DOGSPLAT"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    return scene


def main() -> None:
    """Render the frames and print how long that took."""
    arguments = [word for word in sys.argv[1:] if word != "--restart"]
    scene = prepare(Path(arguments[0]))
    scene.frame_start, scene.frame_end = 1, int(arguments[1]) if len(arguments) > 1 else FRAMES
    from blender_addon import render_engine
    from blender_addon.package import renderers

    command = renderers.Command((str(ROOT / ".venv" / "bin" / "python"), "-m", "mi_dogsplat"))
    render_engine.choose_renderer = lambda words: command
    if "--restart" in sys.argv:
        bpy.app.handlers.render_post.append(lambda *_: command.stop())
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = f"{folder}/"
        start = time.perf_counter()
        bpy.ops.render.render(animation=True)
        seconds = time.perf_counter() - start
    count = scene.frame_end - scene.frame_start + 1
    print(f"FRAMES {count} in {seconds:.2f} s: {60 * count / seconds:.1f} frames per minute")


if __name__ == "__main__":
    main()
