"""The picture of editing in docs/blender.md: one model, and what each tool of the add-on leaves of it.

    .venv/bin/python scripts/blender/edit_pictures.py .venv-blender/bin/python MODEL.ply WORK

Cycles renders each panel under the settings of "Set Up Exact Picture"; crop objects are drawn as lines afterwards.
Started with the word ``inside`` by the Python that has bpy, it edits and renders.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
SIZE = 300
LABELS = {
    "imported": "imported",
    "box": "crop by a box",
    "sphere": "crop by a sphere, inverted",
    "mesh": "crop by a mesh (a cone)",
    "size": "limits: small splats alone",
    "count": "limits: the 10,000 most important",
    "erase": "painted: erased",
    "tint": "painted: tinted",
}
Line = list[tuple[float, float, float]]


def circles() -> list[Line]:
    """Three great circles of the unit sphere."""
    t = np.linspace(0, 2 * np.pi, 65)
    flat = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    return [np.roll(flat, k, axis=1).tolist() for k in range(3)]


def edges_of(target: Any, shape: str) -> list[Line]:
    """What shows a crop object, in its own space."""
    if shape == "SPHERE":
        return circles()
    if shape == "MESH":
        mesh = target.data
        return [[tuple(mesh.vertices[i].co) for i in edge.vertices] for edge in mesh.edges]
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    return [[a, b] for a in corners for b in corners if a < b and sum(p != q for p, q in zip(a, b, strict=True)) == 1]


def inside(job: dict[str, Any]) -> None:
    """In Blender: one edit, the picture of it, and the lines of its crop object in pixels."""
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from in_blender import exact_view, render_to
    from mathutils import Vector

    camera, scene = exact_view(job["model"], job["camera"], "QUADS"), bpy.context.scene
    lines = [
        [target.matrix_world @ Vector(point) for point in line]
        for target, shape in EDITS[job["name"]](bpy, bpy.context.object)
        for line in edges_of(target, shape)
    ]
    bpy.context.view_layer.update()
    seen = [[world_to_camera_view(scene, scene.camera, point) for point in line] for line in lines]
    pixels = [[(p.x * camera.width, (1 - p.y) * camera.height) for p in line] for line in seen]
    Path(job["out"]).with_suffix(".json").write_text(json.dumps(pixels))
    render_to(job["out"], "CYCLES")


def crop(shape: str, change: Callable[[Any], None], **options: Any) -> Callable[..., Iterator[tuple[Any, str]]]:
    """An edit: a crop whose object is changed a little."""

    def edit(bpy: Any, obj: Any) -> Iterator[tuple[Any, str]]:
        bpy.ops.dogsplat.add_crop(shape=shape, **options)
        target = next(other for other in bpy.context.selected_objects if other != obj)
        change(target)
        bpy.context.view_layer.update()
        yield target, shape

    return edit


def cone(bpy: Any, obj: Any) -> Iterator[tuple[Any, str]]:
    """A crop by a mesh that is there already."""
    low, high = (f([v.co for v in obj.data.vertices], axis=0) for f in (np.min, np.max))
    place = {"location": (0.1, (low[1] + high[1]) / 2, 0.0), "rotation": (1.5708, 0, 0)}
    bpy.ops.mesh.primitive_cone_add(vertices=12, radius1=0.8, depth=1.2 * (high[1] - low[1]), **place)
    target = bpy.context.object
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.dogsplat.add_crop(shape="MESH")
    yield target, "MESH"


def limit(name: str, value: float) -> Callable[..., Iterator[tuple[Any, str]]]:
    """An edit: one slider."""

    def edit(bpy: Any, obj: Any) -> Iterator[tuple[Any, str]]:
        from blender_addon.nodes.modifier import edit_modifiers, set_input

        bpy.ops.dogsplat.add_limits()
        set_input(edit_modifiers(obj)[0], name, value)
        obj.update_tag()
        yield from ()

    return edit


def paint(what: str) -> Callable[..., Iterator[tuple[Any, str]]]:
    """An edit: a band across the model, as a brush would leave it."""

    def edit(bpy: Any, obj: Any) -> Iterator[tuple[Any, str]]:
        from blender_addon.editing.stand_in import stand_in_of

        bpy.ops.dogsplat.paint(what=what)
        stand_in = stand_in_of(obj)
        places = np.array([v.co for v in stand_in.data.vertices])
        middle = np.median(places, axis=0)
        band = np.flatnonzero(np.abs((places - middle) @ (0.7, 0.5, 0.5)) < 0.12)
        if what == "ERASE":
            stand_in.vertex_groups["Erase"].add(band.tolist(), 1.0, "REPLACE")
        else:
            colors = np.ones((len(places), 4), np.float32)
            colors[band, 1:3] = 0.1
            stand_in.data.attributes["Tint"].data.foreach_set("color", colors.ravel())
        bpy.ops.dogsplat.finish_painting()
        yield from ()

    return edit


def smaller(target: Any) -> None:
    """Half of the object."""
    target.scale *= 0.55
    target.rotation_euler.rotate_axis("Y", 0.5)


EDITS: dict[str, Callable[..., Any]] = {
    "imported": lambda bpy, obj: (),
    "box": crop("BOX", smaller),
    "sphere": crop("SPHERE", lambda target: setattr(target, "scale", target.scale * 0.35), invert=True),
    "mesh": cone,
    "size": limit("Maximum Size", 0.006),
    "count": limit("Maximum Count", 10_000),
    "erase": paint("ERASE"),
    "tint": paint("TINT"),
}


def outside(python: str, model: str, work: Path) -> None:
    """Render what the folder has not yet, and write the picture."""
    sys.path.insert(0, str(ROOT))
    import mi_dogsplat  # noqa: F401
    from mi_dogsplat.render.framing import automatic_camera
    from mi_dogsplat.render.panels import labelled
    from mi_dogsplat.scene.camera_file import write_camera
    from mi_dogsplat.scene.ply import read_ply
    from PIL import Image, ImageDraw

    from scripts.pictures.panels import write_rows

    work.mkdir(parents=True, exist_ok=True)
    camera = automatic_camera(read_ply(Path(model)))
    write_camera(work / "camera.json", camera.downscaled(max(1, round(camera.width / SIZE))))
    panels = []
    for name, label in LABELS.items():
        out = work / f"{name}.png"
        if not out.exists():
            job = {"name": name, "model": model, "camera": str(work / "camera.json"), "out": str(out)}
            subprocess.run([python, __file__, "inside", json.dumps(job)], check=True, stdin=subprocess.DEVNULL)
        picture = Image.open(out).convert("RGB")
        for line in json.loads(out.with_suffix(".json").read_text()):
            ImageDraw.Draw(picture).line([tuple(point) for point in line], (255, 150, 0), 1)
        panels.append(labelled(np.asarray(picture) / 255.0, label))
    write_rows("blender_editing.png", [panels[:4], panels[4:]])


if __name__ == "__main__":
    if sys.argv[1] == "inside":
        inside(json.loads(sys.argv[2]))
    else:
        outside(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
