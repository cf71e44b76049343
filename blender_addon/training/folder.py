"""Where the training of a scene is, and whose a folder is: two scenes with one would write over each other's views."""

from __future__ import annotations

import json
from pathlib import Path

import bpy

from ..files.errors import FileError
from ..files.whole import write_whole
from .data_set import ELSEWHERE

OWNER = "scene.json"  # in the folder: the scene, and the file that it is in
BLEND_NAME, SCENE_NAME = "{blend_name}", "{scene_name}"  # in a path, as Blender 5 calls them


def training_folder(scene: bpy.types.Scene) -> Path:
    """Of the settings. Raises ``ValueError`` where there is none, where a file that was never saved has a relative one,
    and for the folder of another scene."""
    name = scene.dogsplat_training.folder
    if not name or (not bpy.data.filepath and (name.startswith("//") or BLEND_NAME in name)):
        raise ValueError("save the file, or choose a folder")
    for part, value in ((BLEND_NAME, Path(bpy.data.filepath).stem), (SCENE_NAME, bpy.path.clean_name(scene.name))):
        name = name.replace(part, value)
    folder = Path(bpy.path.abspath(name))
    if other := _other_owner(folder, scene):
        file, other_scene = other
        problem = 'belongs to the scene "{scene}" of {file}'
        raise FileError(folder, problem, ELSEWHERE, scene=other_scene, file=file)
    return folder


def claim(folder: Path, scene: bpy.types.Scene) -> None:
    """Write down that a folder is of this scene. Raises ``FileError``."""
    content = {"file": bpy.data.filepath and _seen_from(folder), "scene": scene.name}
    write_whole(folder / OWNER, [(json.dumps(content, indent=1) + "\n").encode()])


def _seen_from(folder: Path) -> str:
    """The file that is open: relative to a folder, as both may be moved together, but from another drive of Windows."""
    try:
        return bpy.path.relpath(bpy.data.filepath, start=str(folder))
    except ValueError:
        return bpy.data.filepath


def _other_owner(folder: Path, scene: bpy.types.Scene) -> tuple[Path, str] | None:
    """(file, name of the scene) of a folder that is of another one, which is still there.

    A file or scene that is not has another name now, and may be this one.
    """
    try:
        content = json.loads((folder / OWNER).read_text(encoding="utf-8"))
        file, name = Path(bpy.path.abspath(content["file"], start=str(folder))).resolve(), str(content["scene"])
        is_own = file == Path(bpy.data.filepath).resolve()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    is_there = name != scene.name and name in bpy.data.scenes if is_own else file.is_file()
    return (file, name) if is_there else None
