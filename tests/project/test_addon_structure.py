"""The rooms of the add-on: low ones never import high ones, and no two modules need each other."""

import ast
from pathlib import Path

from layout import Layout

# From low to high. A module may import from its own room and from those above it here.
ROOMS = [
    {"translations"},
    {"preferences", "windows"},
    {"files"},
    {"package"},
    {"objects"},
    {"cameras"},
    {"nodes"},
    {"evaluated"},
    {"editing"},
    {"native"},
    {"import_export"},
    {"surface"},
    {"scene"},
    {"engine"},
    {"viewport"},
    {"render_engine"},
    {"training"},
    {"panel"},
]
LAYOUT = Layout(Path(__file__).parents[2] / "blender_addon", ROOMS)
NUMBERS = ("bpy.app.translations",)  # what files may know of Blender: the language of its messages


def test_a_room_imports_no_higher_one():
    LAYOUT.require_order()


def test_no_two_modules_need_each_other():
    assert not LAYOUT.cycle_of_modules()


def test_every_room_exists():
    LAYOUT.require_rooms()


def test_files_know_numbers_and_no_scene():
    """Models are read and written by any Python; of Blender they know the language of its messages."""
    for path in LAYOUT.modules:
        if LAYOUT.room(path) not in ("files", "package"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            of_blender = {n for n in names if n.split(".")[0] in ("bpy", "mathutils", "gpu")} - set(NUMBERS)
            assert not of_blender, f"{path.relative_to(LAYOUT.root)} imports {', '.join(of_blender)}"
