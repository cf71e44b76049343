"""The animated picture of docs/blender.md: from File > Import to the final frame, as a person would do it.

A part of ``scripts/blender/window.py``. The mouse, the keys and the window are real. Between two frames it waits until
Blender has drawn, which takes seconds where a processor draws; so the recording has no pauses, and views are at rest.
Places are pixels of a display of 1600x1000 with an interface of 1.25.
"""

from __future__ import annotations

import shutil
import subprocess
import time
from pathlib import Path

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from desktop import LONGEST, Steps, area, click, grab_with_pointer, key, move, panel, still, xdotool
from mathutils import Matrix, Vector

DISPLAY_HEIGHT = 1000
SIDEBAR = 950  # where it begins
SIZE = "1200:750"  # of the animated picture
QUALITY = "70"
MODEL = Path.home() / "robot.ply"


class Reel:
    """Frames of the display in a folder, and how long each is shown."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.seconds: list[float] = []
        folder.mkdir(exist_ok=True)

    def take(self, seconds: float, wait: float = 1.5) -> Steps:
        """What is to be seen once it has not changed for ``wait`` seconds."""
        yield from still(self.folder, wait, 0.7)
        grab_with_pointer(self.folder / f"{len(self.seconds):03d}.png")
        self.seconds.append(seconds)

    def press(self, x: int, y: int, seconds: float, wait: float = 1.5) -> Steps:
        """Go there, so that it lights up, and click."""
        move(x - 4, y - 4)
        yield 0.5
        move(x, y)
        yield from self.take(0.4, 0.8)
        click(x, y)
        yield from self.take(seconds, wait)

    def drag(self, places: list[tuple[int, int]], wait: float = 1.5) -> Steps:
        """Through these, each a moment."""
        for x, y in places:
            move(x, y)
            yield from self.take(0.12, wait)

    def save(self, path: Path) -> None:
        """All frames as an animated WebP that goes on for ever."""
        frames = [f"file '{number:03d}.png'\nduration {seconds}" for number, seconds in enumerate(self.seconds)]
        script = self.folder / "frames.txt"
        script.write_text("ffconcat version 1.0\n" + "\n".join(frames) + f"\nfile '{len(frames) - 1:03d}.png'\n")
        source = ["-f", "concat", "-i", str(script), "-vf", f"scale={SIZE}:flags=lanczos", "-fps_mode", "vfr"]
        coded = ["-c:v", "libwebp_anim", "-quality", QUALITY, "-compression_level", "6", "-loop", "0"]
        subprocess.run(["ffmpeg", "-v", "error", "-y", *source, *coded, str(path)], check=True)


def recording(model: Path, out: Path, command: str) -> Steps:
    """Import a model from the home folder, look around, crop it by a sphere, render it: ``window_recording.webp``."""
    reel = Reel(out / "reel")
    if not MODEL.exists():
        shutil.copy(model, MODEL)
    preferences = bpy.context.preferences
    preferences.view.ui_scale = 1.25
    preferences.view.filebrowser_display_type, preferences.view.render_display_type = "SCREEN", "AREA"
    preferences.view.show_tooltips = False
    preferences.addons["bl_ext.user_default.dogsplat"].preferences.command = command
    yield 3
    yield from bring_in(reel)
    yield from look_around(reel)
    yield from crop(reel)
    yield from render(reel)
    reel.save(out / "window_recording.webp")


def bring_in(reel: Reel) -> Steps:
    """File > Import > DoG Splat, and the only file that is there."""
    move(600, 600)
    yield from reel.take(0.8)
    yield from reel.press(53, 37, 0.5)
    move(100, 406)
    yield from reel.take(0.5)
    move(397, 500)
    yield 0.5
    yield from reel.press(397, 638, 0.8, 3)
    yield from reel.press(378, 150, 0.6)
    yield from reel.press(1505, 940, 0.8, 30)  # the viewport compiles its shaders
    move(600, 700)
    yield 1
    key("KP_Decimal")  # View Selected
    yield from reel.take(0.8, 4)
    key("n")
    yield 2
    panel()
    yield from reel.take(1, 4)


def look_around(reel: Reel) -> Steps:
    """Colours follow the view; the middle button turns it."""
    yield from reel.press(1100, 499, 0.6, 5)
    move(500, 700)
    yield 1
    xdotool("mousedown", 2)
    yield from reel.drag([(500 + 14 * i, 700 - 3 * i) for i in range(16)], 2.5)
    xdotool("mouseup", 2)
    yield from reel.take(0.8, 3)


def crop(reel: Reel) -> Steps:
    """A sphere around the model, made smaller and lifted: the splats outside of it go."""
    yield from reel.press(1110, 783, 0.5)
    yield from reel.press(1031, 842, 0.8, 3)
    yield from reel.press(*on_outline(bpy.data.objects["robot crop"]), 0.6, 3)
    move(900, 600)
    yield 1
    key("s")
    yield from reel.drag([(900 - 10 * i, 600) for i in range(11)])
    click(800, 600)
    yield from reel.take(0.4)
    key("g")
    yield 0.5
    key("z")
    yield 0.5
    yield from reel.drag([(800, 600 - 8 * i) for i in range(9)])
    click(800, 536)
    yield from reel.take(0.8, 3)


def on_outline(obj: bpy.types.Object) -> tuple[int, int]:
    """A pixel of the display where an empty sphere is drawn: an end of its axes, the outermost that is well in view."""
    window, place = bpy.context.window_manager.windows[0], area("VIEW_3D")
    region = next(r for r in place.regions if r.type == "WINDOW")
    axes = [Vector(sign * axis for axis in row) for row in Matrix.Identity(3) for sign in (-1, 1)]
    middle, *ends = (
        location_3d_to_region_2d(region, place.spaces.active.region_3d, obj.matrix_world @ point)
        for point in (Vector((0, 0, 0)), *axes)
    )
    seen = [end for end in ends if 80 < end.x < SIDEBAR - 60 and 80 < end.y < region.height - 80]
    x, y = max(seen, key=lambda end: (end - middle).length)
    return round(window.x + region.x + x), round(DISPLAY_HEIGHT - window.y - region.y - y)


def render(reel: Reel) -> Steps:
    """Our engine, the camera where the view is, and the picture."""
    yield from reel.press(1175, 318, 0.5)
    yield from reel.press(1173, 432, 0.8, 3)
    move(600, 650)
    yield 1
    for _ in range(5):
        key("KP_Subtract")
        yield 1
    key("ctrl+alt+KP_0")  # Align Active Camera to View
    yield from reel.take(0.8, 3)
    yield from reel.press(154, 37, 0.5)
    yield from reel.press(200, 67, 0.5)
    start = time.monotonic()
    while not bpy.data.images.get("Render Result") or bpy.app.is_job_running("RENDER"):
        if time.monotonic() - start > LONGEST:
            raise TimeoutError("no picture")
        yield 1
    move(600, 600)
    yield 1
    key("Home")  # View All
    yield from reel.take(3, 4)
