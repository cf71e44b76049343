"""A person's hands and eyes for the scripts that show Blender's window: mouse, keyboard, and the display.

``bpy.ops.screen.screenshot`` gives a black picture under Mesa's software OpenGL, so ImageMagick and ffmpeg take it from
the display, and xdotool clicks.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

STILL, STILL_EEVEE, LONGEST = 6.0, 60.0, 600.0  # seconds without a change that mean "done"; the most to wait
Steps = Iterator[float]  # seconds until the next one


def new_file() -> Steps:
    """As Blender opens, without the cube, and in the colours that models are trained in: AgX shows them paler."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.wm.read_homefile(app_template="")
    yield 3
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    bpy.context.scene.eevee.taa_samples = 1  # a processor draws here
    bpy.context.scene.view_settings.view_transform = "Standard"


def area(kind: str) -> bpy.types.Area:
    """The largest editor of a kind."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return max((a for a in areas if a.type == kind), key=lambda a: a.width * a.height)


def space() -> bpy.types.SpaceView3D:
    """The viewport's."""
    return area("VIEW_3D").spaces.active


def viewport():
    """Operators run as if the mouse were in the viewport: a timer has no window."""
    window, place = bpy.context.window_manager.windows[0], area("VIEW_3D")
    region = next(r for r in place.regions if r.type == "WINDOW")
    return bpy.context.temp_override(window=window, screen=window.screen, area=place, region=region)


def panel() -> None:
    """Turn the sidebar to our tab; it has tabs once it was drawn."""
    next(r for r in area("VIEW_3D").regions if r.type == "UI").active_panel_category = "DoG Splat"


def xdotool(*words: str | int) -> None:
    """One command of it."""
    subprocess.run(["xdotool", *map(str, words)], check=True)


def move(x: int, y: int) -> None:
    """The mouse, in pixels of the display."""
    xdotool("mousemove", x, y)


def click(x: int, y: int) -> None:
    """There, with the left button."""
    move(x, y)
    xdotool("click", 1)


def key(name: str) -> None:
    """A key, by its name in X11."""
    xdotool("key", name)


def still(folder: Path, seconds: float = STILL, every: float = 3.0) -> Steps:
    """Until the display has not changed for so long; EEVEE compiles shaders first."""
    start = changed = time.monotonic()
    seen = b""
    while (now := time.monotonic()) - start < LONGEST and (not seen or now - changed < seconds):
        yield every
        raw = grab(folder / "display.ppm")
        digest = hashlib.sha256(raw.read_bytes()).digest()
        if digest != seen:
            seen, changed = digest, time.monotonic()


def grab(path: Path) -> Path:
    """The display, without the pointer of the mouse."""
    subprocess.run(["import", "-window", "root", str(path)], check=True)
    return path


def grab_with_pointer(path: Path) -> Path:
    """The display as a person sees it."""
    source = ["-f", "x11grab", "-draw_mouse", "1", "-i", os.environ["DISPLAY"]]
    subprocess.run(["ffmpeg", "-v", "error", "-y", *source, "-frames:v", "1", str(path)], check=True)
    return path


def shot(folder: Path, name: str, seconds: float = STILL) -> Steps:
    """The display, once it stands still for that long, as ``window_NAME.png``."""
    start = time.monotonic()
    yield from still(folder, seconds)
    raw, target = folder / "display.ppm", folder / f"window_{name}.png"
    subprocess.run(["convert", str(raw), "-strip", str(target)], check=True)
    raw.unlink()
    print(f"{target}, after {time.monotonic() - start:.0f} s", flush=True)
