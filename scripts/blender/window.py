"""Pictures of the add-on in Blender's window, by the mouse, the keyboard and the screen of a person.

Runs inside of Blender, started by ``scripts/blender/window.sh``; each function below is one picture, and a timer goes
through them, because Blender draws only between two calls.
"""

from __future__ import annotations

import math
import os
import shutil
import sys
import time
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "tests" / "blender" / "helpers")]  # Blender leaves them out
from desktop import (  # noqa: E402
    STILL_EEVEE,
    Steps,
    area,
    click,
    key,
    move,
    new_file,
    panel,
    shot,
    space,
    viewport,
)
from in_blender import step_by_step  # noqa: E402
from mathutils import Quaternion  # noqa: E402
from recording import recording  # noqa: E402
from training_picture import build  # noqa: E402

FACE = math.radians(-35)  # from Blender's first view to where one sees the robot's face


def sidebar() -> Steps:
    """Ours, beside the viewport."""
    space().show_region_ui = True
    yield 5
    panel()


def cropped(model: Path) -> None:
    """In the viewport: a model, framed, and a crop by a sphere of half its size, which is selected."""
    bpy.ops.import_scene.dogsplat("EXEC_DEFAULT", True, filepath=str(model), up_axis="-Y")
    bpy.ops.view3d.view_selected()
    bpy.ops.dogsplat.add_crop("EXEC_DEFAULT", True, shape="SPHERE")
    next(obj for obj in bpy.context.selected_objects if obj.type == "EMPTY").scale *= 0.5


def menu(model: Path, run: Path) -> Steps:
    """File > Import, with our entries, and the file dialog with the options of the import, in the home folder."""
    shutil.copy(model, Path.home())
    bpy.context.preferences.view.show_tooltips = False
    click(43, 33)
    yield 2
    click(77, 330)
    yield 1
    move(370, 518)
    yield from shot(OUT, "menu")
    click(370, 518)
    yield 3
    yield from shot(OUT, "dialog")
    key("Escape")
    yield 1


def drop(model: Path, run: Path) -> Steps:
    """What a file that is dropped on the viewport brings up; the drop itself is Blender's."""
    move(700, 300)
    yield 1
    with viewport():
        bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory=str(model.parent), files=[{"name": model.name}])
    yield from shot(OUT, "drop")
    key("d")
    yield from shot(OUT, "dropped")
    key("Escape")
    yield 1


def imported(model: Path, run: Path) -> Steps:
    """A model just after its import, with the options to redo it and the panel."""
    yield from new_file()
    start = time.perf_counter()
    with viewport():
        bpy.ops.import_scene.dogsplat("EXEC_DEFAULT", True, filepath=str(model), up_axis="-Y")
        print(f"import: {time.perf_counter() - start:.2f} s", flush=True)
        view = space().region_3d
        view.view_rotation = Quaternion((0, 0, 1), FACE) @ view.view_rotation
        bpy.ops.view3d.view_selected()
    yield from sidebar()
    click(80, 886)  # unfolds the panel of the last operation
    yield from shot(OUT, "imported", STILL_EEVEE)


def editing(model: Path, run: Path) -> Steps:
    """A live crop by a sphere, and limits, in the panel of edits; quads made for the viewport."""
    yield from new_file()
    bpy.context.scene.dogsplat_follow_view = True
    with viewport():
        cropped(model)
        bpy.ops.dogsplat.add_limits("EXEC_DEFAULT", True)
    yield from sidebar()
    yield from shot(OUT, "editing", STILL_EEVEE)


def training(model: Path, run: Path) -> Steps:
    """A rig around the objects of a scene, and the panel that renders them and trains on the views."""
    yield from new_file()
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / "still_life.blend"))
    build(bpy.context.scene)
    bpy.context.scene.dogsplat_training.elevations = (-10, 90)
    with viewport():
        bpy.ops.dogsplat.make_cameras("EXEC_DEFAULT", True)
        bpy.ops.view3d.view_selected()
    yield from sidebar()
    yield 2
    click(1080, 297)  # unfolds the panel
    yield from shot(OUT, "training")


def camera(model: Path, run: Path) -> Steps:
    """A trained model through the first camera of its data set."""
    yield from new_file()
    space().show_region_ui = True
    with viewport():
        bpy.ops.import_scene.dogsplat("EXEC_DEFAULT", True, filepath=str(run / "point_cloud.ply"), show_as="QUADS")
        bpy.ops.import_scene.dogsplat_cameras("EXEC_DEFAULT", True, filepath=str(run / "config.json"))
        bpy.ops.dogsplat.exact_settings("EXEC_DEFAULT", True)
        space().region_3d.view_perspective = "CAMERA"
        bpy.ops.view3d.view_center_camera()
    bpy.context.scene.camera.data.show_background_images = False  # splats alone
    space().shading.type = "RENDERED"
    yield 5
    panel()
    yield from shot(OUT, "camera", STILL_EEVEE)


def frame(model: Path, run: Path) -> Steps:
    """The final frame by the engine "DoG Splat (Mitsuba)", with the properties of the render."""
    scene, preferences = bpy.context.scene, bpy.context.preferences
    scene.render.engine, scene.dogsplat_colors = "DOGSPLAT", "DISPLAY"
    space().shading.type = "MATERIAL"  # by EEVEE; of "Rendered" the engine itself draws
    area("PROPERTIES").spaces.active.context = "RENDER"
    preferences.addons["bl_ext.user_default.dogsplat"].preferences.command = os.environ.get("DOGSPLAT_COMMAND", "")
    preferences.view.render_display_type = "AREA"
    yield from shot(OUT, "engine", STILL_EEVEE)
    with viewport():
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield 5
    while bpy.app.is_job_running("RENDER"):
        yield 1
    move(600, 600)
    yield 1
    key("Home")  # View All
    yield 1
    key("ctrl+KP_2")  # two pixels for one
    yield from shot(OUT, "frame")


def german(model: Path, run: Path) -> Steps:
    """The panels in German; last, because the language stays."""
    view = bpy.context.preferences.view
    view.language = "de_DE"
    view.use_translate_interface = view.use_translate_tooltips = view.use_translate_reports = True
    yield from new_file()
    with viewport():
        cropped(model)
    yield from sidebar()
    yield from shot(OUT, "german", STILL_EEVEE)


def record(model: Path, run: Path) -> Steps:
    """The animated picture: from the menu to the final frame."""
    yield from new_file()
    yield from recording(model, OUT, os.environ.get("DOGSPLAT_COMMAND", ""))


PICTURES = {
    function.__name__: function
    for function in (menu, drop, imported, editing, training, camera, frame, record, german)
}


def steps(names: list[str], model: Path, run: Path) -> Steps:
    """The pictures that are asked for, one after the other."""
    yield 5
    for name in names or PICTURES:
        yield from PICTURES[name](model, run)


MODEL, RUN, OUT, *NAMES = sys.argv[sys.argv.index("--") + 1 :]
OUT = Path(OUT)
step_by_step(steps(NAMES, Path(MODEL), Path(RUN)))
