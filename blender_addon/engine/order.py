"""A frame as a request of the package: what is to be drawn, written into a folder."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import numpy as np

from ..cameras.camera import Camera
from ..cameras.objects import Eye, camera_numbers, is_sheared, rendered_part
from ..evaluated.edited import later_notes
from ..evaluated.masks import mask_of, numbered
from ..evaluated.placed import copied_drawings, moved_model, objects_in, placed_model, placed_splats
from ..evaluated.shown_object import ShownObject
from ..files.errors import told
from ..files.light import Light, in_common_light
from ..files.linear_map import flattens
from ..files.model import Model, concatenate
from ..files.ply import write_ply
from ..files.said import Said
from ..native.convert import drawing_of
from ..nodes.tree import NEAR_CLIP
from ..objects.attributes import has_splats
from ..objects.conventions import light_of
from ..objects.working_space import converted_notes
from ..scene.export import Plugin
from ..scene.sensor import sensor
from ..scene.world import one_color
from ..scene.write import has_surroundings, write_scene

MIXED = "some models hold sRGB values, others radiance; the sRGB values are converted to radiance"
COPIED = '"{name}": its nodes copy what draws splats, which is left out; turn on As Instance there, and realize nothing'
SHEARED = '"{name}": the picture of the camera is drawn without the shear of its parents; apply their scale'
BEHIND = "the nodes of the world are left out; behind splats alone is its viewport color"
HIDDEN = "all splats are hidden from this picture"
FLAT = '"{name}": its splats are left out, as it is scaled to nothing along an axis'


class StageSettings(NamedTuple):
    """Of a scene and its view layer: all that a stage depends on beside objects, so that a viewport sees it change."""

    send: str
    bounces: int
    mesh_shadows: bool
    transparent: bool
    material: str  # full name of what overrides all materials; empty where none does


def stage_settings(depsgraph: bpy.types.Depsgraph) -> StageSettings:
    """As they are now."""
    scene, override = depsgraph.scene, depsgraph.view_layer.material_override
    settings, name = scene.dogsplat, override.name_full if override else ""
    return StageSettings(settings.send, settings.bounces, settings.mesh_shadows, scene.render.film_transparent, name)


@dataclass
class Stage:
    """What stands before the camera, whichever that is, as a request without one."""

    request: dict[str, Any]
    objects: list[ShownObject]  # by their numbers
    whole: bool  # a scene, and not splats over black
    light: Light  # what the colours of splats mean; those of a scene are radiance
    files: set[str]  # in the folder, which the request names
    notes: list[str]  # a line about each thing that has no counterpart


@dataclass
class Order(Stage):
    """A request, and what its picture means."""

    camera: Camera


@dataclass(frozen=True)
class _Part:
    """The splats of one object."""

    model: Model
    matrix: np.ndarray  # [4, 4], which brings them to the world
    light: Light
    object: ShownObject
    mask: str  # how cameras see it

    @staticmethod
    def of(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, model: Model, matrix: np.ndarray, mask: str) -> _Part:
        return _Part(model, matrix, light_of(obj), ShownObject.of(obj, depsgraph), mask)


@dataclass
class _Splats:
    """All visible splats, by their objects, and how they are drawn together."""

    parts: list[_Part] = field(default_factory=list)
    near: list[float] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    antialiased: bool = False


def make_order(
    depsgraph: bpy.types.Depsgraph,
    folder: Path,
    passes: list[str],
    obj: bpy.types.Object | None = None,
    eye: Eye | None = None,
) -> Order:
    """Write what the package needs for a frame. Raises ``ValueError`` where nothing can be drawn.

    ``obj``: an evaluated camera in place of the scene's own; ``eye``: from where one of several views has it.
    """
    scene = depsgraph.scene
    if obj is None and scene.camera is not None:
        obj = scene.camera.evaluated_get(depsgraph)
    if obj is None:
        raise ValueError(told("the scene has no camera; add one, or import those of the data set"))
    camera = rendered_part(scene.render, camera_numbers(scene, obj, eye))
    stage = make_stage(depsgraph, folder, camera, seen_by=sensor(scene, obj, square(camera)))
    if is_sheared(obj):
        stage.notes.append(told(SHEARED, name=obj.name))
    if scene.render.use_motion_blur:
        stage.notes.append(told("motion blur is left out"))
    if obj.data.dof.use_dof and camera.orthographic:
        stage.notes.append(told("depth of field is left out; it needs a perspective camera"))
    elif obj.data.dof.use_dof and not stage.whole:
        stage.notes.append(told("depth of field is left out; it needs Whole Scene and Linear colors"))
    elif obj.data.dof.use_dof and (obj.data.dof.aperture_blades > 2 or obj.data.dof.aperture_ratio != 1):
        stage.notes.append(told("the aperture is round, whatever its blades and ratio"))
    request = {**stage.request, "passes": passes}
    request["near_clip"] = near_clip_of(stage, camera, obj.data.clip_start)
    if not stage.whole:
        request |= camera_request(camera)
    else:
        request |= {"samples": scene.dogsplat.samples, "denoise": scene.dogsplat.denoise}
        if not scene.dogsplat.denoise:  # what a denoiser leaves flickers less if all frames have the same noise
            request["seed"] = scene.frame_current * 100_003 % 2**31
    return Order(request, stage.objects, stage.whole, stage.light, stage.files, stage.notes, camera)


def make_stage(
    depsgraph: bpy.types.Depsgraph,
    folder: Path,
    camera: Camera,
    hidden: frozenset[str] = frozenset(),
    seen_by: Plugin | None = None,
) -> Stage:
    """Write what is there: splats alone, or a whole scene, with a sensor if one is given.

    Raises ``ValueError`` where nothing can be drawn. ``camera`` is how far a scene has to reach. ``hidden``: full names
    of objects that a viewport does not show.
    """
    settings, splats = stage_settings(depsgraph), _gather(depsgraph, hidden)
    # No splatting has depth of field; paths have no colours but linear ones
    blurred = seen_by is not None and seen_by["type"] == "thinlens" and depsgraph.scene.dogsplat_colors == "LINEAR"
    whole = settings.send == "SCENE" and (blurred or has_surroundings(depsgraph, hidden))
    if not splats.parts and not whole:
        _add_hidden(splats, depsgraph)
    parts, masks, objects = splats.parts, [p.mask for p in splats.parts], [p.object for p in splats.parts]
    request: dict[str, Any] = {"counts": [part.model.n_splats for part in parts]}
    request |= {"near_clip": max(splats.near, default=NEAR_CLIP), "antialiased": splats.antialiased}
    copies = copied_drawings(depsgraph, lambda owner: owner.name_full not in hidden)
    files, notes = set(), [*splats.notes, *(told(COPIED, name=name) for name in copies)]
    layer = depsgraph.view_layer
    if getattr(layer, "world_override", None) is not None:  # from Blender 5.0 on
        notes.append(told("the view layer's override of the world is left out"))
    if not (layer.use_sky and layer.use_solid):
        notes.append(told("the view layer's filter is left out: environment and surfaces are drawn"))
    models, light = in_common_light([part.model for part in parts], [part.light for part in parts])
    if any(part.light.linear != light.linear for part in parts):
        notes.append(told(MIXED))
    if parts:
        model = _write_model(folder, [replace(part, model=m) for part, m in zip(parts, models, strict=True)], light)
        request["model"] = str(model)
        files.add(model.name)
    if not whole:
        if not settings.transparent and one_color(depsgraph.scene_eval.world) is None:
            notes.append(told(BEHIND))
        return Stage(request | numbered(masks), objects, False, light, files, notes)
    written = write_scene(depsgraph, seen_by, camera, folder, len(parts), hidden)
    request |= {"scene": str(folder / written.scene), "max_depth": settings.bounces + 1}
    request |= {"mesh_shadows": settings.mesh_shadows, "transparent": settings.transparent}
    request |= {"hide_lamps": written.hide_lamps} | numbered(masks + written.masks)
    files |= written.files
    return Stage(request, objects + written.objects, True, light, files, notes + written.notes)


def tidy(folder: Path, files: set[str]) -> None:
    """Remove what earlier frames needed and these files are not; what is still being read stays for the next time."""
    for path in folder.iterdir():
        if path.name not in files and path.suffix in (".json", ".ply", ".pfm", ".ppm"):
            with suppress(OSError):
                path.unlink()


def camera_request(camera: Camera) -> dict[str, Any]:
    """What a request says of a camera."""
    numbers = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    film = {"film": list(camera.film)} if camera.film else {}
    return {"camera": {"w2c": camera.w2c.tolist(), **numbers}, "orthographic": camera.orthographic, **film}


def near_clip_of(stage: Stage, camera: Camera, start: float) -> float:
    """For a camera that sees nothing before ``start``, as in all engines of Blender.

    The near clip of the splats is not for parallel rays, which show them as large from near as from afar.
    """
    return start if camera.orthographic else max(start, stage.request["near_clip"])


def square(camera: Camera) -> Camera:
    """The camera with square pixels and so many rows that it sees as much: Mitsuba's sensors have no others."""
    height = max(round(camera.height * camera.fx / camera.fy), 1)
    return replace(camera.stretched(camera.width, height), fy=camera.fx)


def _gather(depsgraph: bpy.types.Depsgraph, hidden: frozenset[str]) -> _Splats:
    found = _Splats()
    for obj, matrix, owner in placed_splats(depsgraph, lambda owner: owner.name_full not in hidden):
        model = placed_model(obj, depsgraph, np.eye(4))
        if drawing := drawing_of(obj.evaluated_get(depsgraph)):  # with the keys of this frame
            model = model.with_degree(min(drawing["SH Degree"], model.sh_degree))
            model.is_dog = model.is_dog & bool(drawing["DoG"])
            found.near.append(drawing["Near Clip"])
            found.antialiased |= bool(drawing["Antialiased"])
        notes = converted_notes([obj]) + later_notes(obj, depsgraph)
        if flattens(matrix[:3, :3]):  # what grows from nothing begins so, and must not stop an animation
            notes.append(told(FLAT, name=obj.name))
            model, matrix = model.select(np.zeros(0, int)), np.eye(4)
        found.parts.append(_Part.of(obj, depsgraph, model, matrix, mask_of(owner, obj, depsgraph)))
        found.notes += [note for note in notes if note not in found.notes]
    return found


def _add_hidden(found: _Splats, depsgraph: bpy.types.Depsgraph) -> None:
    """None of the splats of a model that nobody sees now: an animation goes on where all are hidden for a while.

    Raises ``ValueError`` where the scene has no model.
    """
    obj = next(filter(has_splats, objects_in(depsgraph.scene)), None)
    if obj is None:
        raise ValueError(told("the scene has no splats to render; import a model with File > Import > DoG Splat"))
    model = placed_model(obj, depsgraph, np.eye(4), hidden=True).select(np.zeros(0, int))
    found.parts.append(_Part.of(obj, depsgraph, model, np.eye(4), ""))
    found.notes.append(told(HIDDEN))


def _write_model(folder: Path, parts: list[_Part], light: Light) -> Path:
    """A file that is named by its content: the renderer knows it again in the next frame, which writes none."""
    comments = Said().lit(light).comments
    content = hashlib.sha1("\n".join(comments).encode())
    for part in parts:
        for array in (*vars(part.model).values(), part.matrix):
            content.update(np.ascontiguousarray(array))
    path = folder / f"model_{content.hexdigest()}.ply"
    if not path.exists():
        models = [moved_model(part.model, part.matrix, part.object.name) for part in parts]
        write_ply(path, concatenate(models), comments)
    return path
