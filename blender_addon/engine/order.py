"""A frame as a request of the package: what is to be drawn, written into a folder."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..cameras.camera import Camera
from ..cameras.objects import camera_numbers
from ..files.errors import told
from ..files.model import Model, concatenate
from ..files.ply import write_ply
from ..nodes.modifier import get_input, splat_modifier
from ..objects.placed import placed_model, placed_splats
from ..scene.write import has_surroundings, write_scene

NEAR_CLIP = 0.2  # where no model of the scene has a modifier that says otherwise
SCENE_FILE = "scene.json"


@dataclass
class Order:
    """A request, and what its picture means."""

    request: dict[str, Any]
    camera: Camera
    objects: list[str]  # by their numbers
    whole: bool  # a scene in linear radiance, and not splats in sRGB values over black
    files: set[str]  # in the folder, which the request names
    notes: list[str] = field(default_factory=list)  # a line about each thing that has no counterpart


@dataclass
class _Splats:
    """All visible splats."""

    models: list[Model] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    near: list[float] = field(default_factory=list)
    antialiased: bool = False


def make_order(depsgraph: bpy.types.Depsgraph, folder: Path, passes: list[str]) -> Order:
    """Write what the package needs. Raises ``ValueError`` where nothing can be drawn."""
    scene = depsgraph.scene
    if scene.camera is None:
        raise ValueError(told("the scene has no camera; add one, or import those of the data set"))
    camera, splats = camera_numbers(scene, scene.camera.evaluated_get(depsgraph)), _gather(depsgraph)
    whole = scene.dogsplat.send == "SCENE" and has_surroundings(depsgraph)
    if not splats.models and not whole:
        raise ValueError(told("the scene has no splats to render; import a model with File > Import > DoG Splat"))
    request: dict[str, Any] = {"passes": passes, "counts": [model.n_splats for model in splats.models]}
    request |= {"near_clip": max(splats.near, default=NEAR_CLIP), "antialiased": splats.antialiased}
    files = set()
    if splats.models:
        model = _write_model(folder, concatenate(splats.models))
        request["model"] = str(model)
        files.add(model.name)
    if not whole:
        names = ("fx", "fy", "cx", "cy", "width", "height")
        numbers = {name: getattr(camera, name) for name in names}
        return Order(request | {"camera": {"w2c": camera.w2c.tolist(), **numbers}}, camera, splats.names, False, files)
    written = write_scene(depsgraph, square(camera), folder / SCENE_FILE, len(splats.models))
    settings = scene.dogsplat
    request |= {"scene": str(folder / SCENE_FILE), "samples": settings.samples, "max_depth": settings.bounces + 1}
    request |= {"transparent": scene.render.film_transparent, "hide_lamps": written.hide_lamps}
    request["seed"] = scene.frame_current * 100_003 % 2**31  # noise that is not the same in each frame of a film
    files |= written.files | {SCENE_FILE}
    return Order(request, camera, splats.names + written.names, True, files, written.notes)


def square(camera: Camera) -> Camera:
    """The camera with square pixels and so many rows that it sees as much: Mitsuba's sensors have no others."""
    height = max(round(camera.height * camera.fx / camera.fy), 1)
    return replace(camera, fy=camera.fx, cy=camera.cy * height / camera.height, height=height)


def _gather(depsgraph: bpy.types.Depsgraph) -> _Splats:
    """In the space of the world."""
    found = _Splats()
    for obj, matrix in placed_splats(depsgraph):
        model = placed_model(obj, depsgraph, matrix)
        if modifier := splat_modifier(obj):
            model = model.with_degree(min(get_input(modifier, "SH Degree"), model.sh_degree))
            model.is_dog = model.is_dog & bool(get_input(modifier, "DoG"))
            found.near.append(get_input(modifier, "Near Clip"))
            found.antialiased |= bool(get_input(modifier, "Antialiased"))
        found.models.append(model)
        found.names.append(obj.name)
    return found


def _write_model(folder: Path, model: Model) -> Path:
    """A file that is named by its content: the renderer knows it again in the next frame, which writes none."""
    content = hashlib.sha1()
    for array in vars(model).values():
        content.update(np.ascontiguousarray(array))
    path = folder / f"model_{content.hexdigest()}.ply"
    if not path.exists():
        write_ply(path, model)
    return path
