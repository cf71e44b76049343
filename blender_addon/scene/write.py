"""A scene as Blender has evaluated it, without its splats, as one JSON file and the files that it names."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..cameras.camera import Camera
from ..evaluated.masks import mask_of
from ..evaluated.shown_object import ShownObject
from ..evaluated.visible import is_shown
from ..files.errors import type_name
from ..nodes.material import draws_splats
from ..objects.attributes import has_splats
from .bsdf import refracts
from .export import Export, Plugin, matrix
from .lights import NOTHING, light
from .materials import Surface, surface
from .meshes import Part, is_sheet, parts
from .world import is_plain, world_light

WITH_FACES = ("MESH", "META")  # Blender lists what others become as instances that are meshes; metaballs as both
Kind = tuple[int, tuple[str, ...]]  # geometry and materials: what is the same is stored once
LAMP = "light_"  # begins the id of a lamp
RAYS = ("visible_diffuse", "visible_glossy", "visible_transmission", "visible_shadow")  # to which objects are shown
WITHOUT = ("VOLUME", "POINTCLOUD", "CURVES")  # Grease Pencil is drawn by Blender, over the picture of any engine

# Light that is bent is denser inside of glass, of which a sheet has only the one end
SHEET = '"{name}": a sheet of glass changes the brightness of what is behind it; give it thickness, as by Solidify'


@dataclass
class Placed:
    """A body of the scene: what is repeated has one list of parts, which several share."""

    of: ShownObject
    key: int  # of its geometry
    world: np.ndarray  # [4, 4]
    materials: list[bpy.types.Material | None]
    mask: str  # how cameras see it


@dataclass
class Gathered:
    """All of a scene that is neither splats nor camera."""

    bodies: list[Placed] = field(default_factory=list)
    geometry: dict[int, list[Part]] = field(default_factory=dict)
    lights: list[tuple[bpy.types.Object, np.ndarray]] = field(default_factory=list)


def has_surroundings(depsgraph: bpy.types.Depsgraph, hidden: frozenset[str]) -> bool:
    """Whether a scene has more than splats over a world of one colour; a lamp lights no splats.

    ``hidden`` is what a viewport does not show, as ``hidden_in`` finds it; of a render nothing is.
    """
    return not is_plain(depsgraph.scene_eval.world) or any(
        instance.object.type in WITH_FACES and is_shown(instance, depsgraph, hidden) and not _is_of_splats(instance)
        for instance in depsgraph.object_instances
    )


@dataclass
class Written:
    """scene: the name of its file. objects, and their masks, by their numbers. hide_lamps: there are some that
    cameras would see, and in Blender see none of. files: in the folder, that of the scene among them."""

    scene: str
    objects: list[ShownObject]
    masks: list[str]
    hide_lamps: bool
    files: set[str]
    notes: list[str]


def write_scene(
    depsgraph: bpy.types.Depsgraph,
    sensor: Plugin | None,
    camera: Camera,
    folder: Path,
    first: int,
    hidden: frozenset[str] = frozenset(),
) -> Written:
    """Write a scene, whose objects have numbers from ``first`` on, and beside it the files that it names.

    All are named by their content, so that the renderer knows a scene again. Where there is a sensor it becomes part of
    the scene. ``camera``: what is far away is outside of it too. ``hidden`` is as that of ``has_surroundings``.

    What is drawn differently, or not at all, is said in the notes, a line each.
    """
    export = Export(folder)
    _note_rays(export, depsgraph, hidden)
    found = _gather(export, depsgraph, hidden)
    objects = list(dict.fromkeys((body.of, body.mask) for body in found.bodies))
    described: Plugin = {"sensor": sensor} if sensor else {}
    looks = _materials(export, found)
    described |= {name: look.whole() for name, look in looks.items()}
    described |= _bodies(export, found, looks, {known: first + k for k, known in enumerate(objects)})
    middle, size = _sphere(found, camera)
    for number, (obj, world) in enumerate(found.lights):
        if emitter := light(export, obj, world, middle, size):
            described[f"{LAMP}{number}"] = emitter
    if emitter := world_light(export, depsgraph.scene_eval.world):
        described["world"] = emitter
    name = export.write(json.dumps(described).encode(), ".json")
    are_shapes = any("emitter" in plugin for name, plugin in described.items() if name.startswith(LAMP))
    masks = [mask for _, mask in objects]
    return Written(name, [of for of, _ in objects], masks, are_shapes, export.files, export.notes)


def _is_of_splats(instance: bpy.types.DepsgraphObjectInstance) -> bool:
    """Whether it is splats, or what their nodes draw them with, which is of the same object."""
    return has_splats(instance.object.original)


def _note_rays(export: Export, depsgraph: bpy.types.Depsgraph, hidden: frozenset[str]) -> None:
    """Say which objects, splats among them, Cycles would not show to all rays or all lights; what cameras see is a
    mask."""
    for obj in (obj for obj in depsgraph.objects if obj.name_full not in hidden):
        if obj.is_shadow_catcher and obj.type != "LIGHT":  # what all lights are
            export.note('"{name}": a shadow catcher is drawn as any other object', name=obj.name)
        if not all(getattr(obj, name) for name in RAYS):
            export.note('"{name}": of Ray Visibility, only Camera has an effect', name=obj.name)
        linking = obj.light_linking
        if linking.receiver_collection or linking.blocker_collection:
            export.note('"{name}": its light linking is left out', name=obj.name)


def _gather(export: Export, depsgraph: bpy.types.Depsgraph, hidden: frozenset[str]) -> Gathered:
    found, metaballs, listed = Gathered(), [], set()
    for instance in depsgraph.object_instances:
        obj = instance.object
        if not (instance.show_self and is_shown(instance, depsgraph, hidden)) or _is_of_splats(instance):
            continue
        if obj.type == "LIGHT":
            world = np.array(instance.matrix_world, np.float64)
            found.lights.append((obj.original.evaluated_get(depsgraph), world))
        elif obj.type in WITH_FACES:
            body = _placed(found.geometry, instance, depsgraph)
            (metaballs if obj.type == "META" else found.bodies).append(body)
            listed.add(obj.original.name if obj.type != obj.original.type else "")
            if any(_is_hair(system.settings) for system in obj.particle_systems):
                export.note('"{name}": its hair is left out', name=obj.original.name)
        elif obj.type in WITHOUT:
            export.note('"{name}" is left out ({kind})', name=obj.original.name, kind=type_name(obj))
    found.bodies += [body for body in metaballs if body.of.name not in listed]  # where Blender has no mesh of it
    return found


def _placed(
    geometry: dict[int, list[Part]], instance: bpy.types.DepsgraphObjectInstance, depsgraph: bpy.types.Depsgraph
) -> Placed:
    """A body; what has its geometry first adds that."""
    obj, override = instance.object, depsgraph.view_layer_eval.material_override
    key, materials = obj.data.as_pointer(), [slot.material for slot in obj.material_slots]
    if key not in geometry:
        copies = [slot for slot, known in enumerate(materials) if draws_splats(known)]  # of another object
        geometry[key] = [part for part in parts(obj) if part.slot not in copies]
    owner = instance.parent if instance.is_instance else obj
    mask, world = mask_of(owner.original, obj.original, depsgraph), np.array(instance.matrix_world, np.float64)
    return Placed(ShownObject.of(obj, depsgraph), key, world, materials if override is None else [override], mask)


def _is_hair(settings: bpy.types.ParticleSettings) -> bool:
    """Whether strands are drawn; what particles repeat is instances."""
    return settings.type == "HAIR" and settings.render_type == "PATH"


def _material_of(body: Placed, part: Part) -> bpy.types.Material | None:
    return body.materials[min(part.slot, len(body.materials) - 1)] if body.materials else None


def _material_id(material: bpy.types.Material | None) -> str:
    return f"material_{material.original.as_pointer():x}" if material else "material_none"


def _materials(export: Export, found: Gathered) -> dict[str, Surface]:
    """Each once, by its id."""
    used: dict[str, tuple[bpy.types.Material | None, set[str]]] = {}
    for body in found.bodies:
        for part in found.geometry[body.key]:
            material = _material_of(body, part)
            used.setdefault(_material_id(material), (material, set()))[1].add(part.uv_map)
    return {name: surface(export, material, frozenset(maps)) for name, (material, maps) in used.items()}


def _bodies(
    export: Export, found: Gathered, looks: dict[str, Surface], numbers: dict[tuple[ShownObject, str], int]
) -> dict[str, Any]:
    """Shapes; geometry that is there several times is stored once, unless it shines, which Mitsuba does not repeat."""
    kinds = [_kind(body, found.geometry[body.key]) for body in found.bodies]
    times = Counter(kinds)
    groups: dict[Kind, str] = {}
    shapes: dict[str, Any] = {}
    for k, (body, kind) in enumerate(zip(found.bodies, kinds, strict=True)):
        whole, (_, materials) = found.geometry[body.key], kind
        pairs = zip(whole, materials, strict=True)
        own = [(part, material) for part, material in pairs if not looks[material].is_nothing]
        if any(refracts(looks[material].bsdf) for _, material in own) and is_sheet(whole):
            export.note(SHEET, name=body.of.name)
        name = f"object_{numbers[body.of, body.mask]}_{k}"
        if not own:  # Mitsuba repeats no group of nothing
            continue
        if times[kind] == 1 or any(looks[material].radiance for material in materials):
            for i, (part, material) in enumerate(own):
                shapes |= _standing(export, f"{name}_{i}", part.moved(body.world), material, looks)
        else:
            if kind not in groups:
                groups[kind] = f"group_{len(groups)}"
                members = {f"part_{i}": _mesh(export, part, name, looks) for i, (part, name) in enumerate(own)}
                shapes[groups[kind]] = {"type": "shapegroup", **members}
            group = {"type": "ref", "id": groups[kind]}
            shapes[name] = {"type": "instance", "to_world": matrix(body.world), "group": group}
    return shapes


def _standing(export: Export, name: str, part: Part, material: str, looks: dict[str, Surface]) -> dict[str, Plugin]:
    """A part in its place in the world, and what makes it shine to the back."""
    shapes = {name: _mesh(export, part, material, looks)}
    if looks[material].radiance and len((back := part.back()).positions):
        shapes[f"{name}_back"] = _mesh(export, back, material, looks)
        if looks[material].opacity is not None:  # what is seen through both is weakened once
            shapes[f"{name}_back"]["bsdf"] = NOTHING
    return shapes


def _kind(body: Placed, own: list[Part]) -> Kind:
    return body.key, tuple(_material_id(_material_of(body, part)) for part in own)


def _mesh(export: Export, part: Part, material: str, looks: dict[str, Surface]) -> Plugin:
    shape: Plugin = {"type": "ply", "filename": part.write(export), "bsdf": {"type": "ref", "id": material}}
    if light := looks[material].radiance:
        shape["emitter"] = {"type": "area", "radiance": light}
    return shape


def _sphere(found: Gathered, camera: Camera) -> tuple[np.ndarray, float]:
    """(middle [3], radius) of a sphere around the bodies and the camera."""
    corners = [np.linalg.inv(camera.w2c)[:3, 3]]
    for body in found.bodies:
        for part in found.geometry[body.key]:
            points = part.positions.reshape(-1, 3)
            box = np.stack([points.min(0), points.max(0)])
            corners += list(box @ body.world[:3, :3].T + body.world[:3, 3])
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1.0)
