"""The mesh that the package has written, as an object that lies over its splats and moves with them."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import bpy
import numpy as np

from ..files.errors import told
from ..files.srgb import decoded
from ..objects.working_space import to_working
from .textured import ENDS, painted, read_textured

HEADER = """ply
format binary_little_endian 1.0
element vertex {vertices}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face {faces}
property list uchar int vertex_indices
end_header
"""
VERTEX = np.dtype([("position", "<f4", 3), ("rgb", "u1", 3)])
FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
COLOR = "Color"  # what Blender itself calls the first one


def build_surface(obj: bpy.types.Object, path: Path) -> bpy.types.Object:
    """A child of the splats in their collections; after an error, nothing. One with a texture is there to be seen. Any
    other is drawn as wire, and not rendered.

    Raises ``ValueError`` for a file that is not as ``dogsplat mesh`` writes it.
    """
    has_texture = path.suffix == ".obj"
    try:
        positions, faces, shown = read_textured(path) if has_texture else read_surface(path)
    except (ValueError, KeyError):
        raise ValueError(told("dogsplat mesh has written what the add-on cannot read; update both")) from None
    mesh = bpy.data.meshes.new(f"{obj.name} surface")
    surface = bpy.data.objects.new(mesh.name, mesh)
    with ExitStack() as undo:
        undo.callback(bpy.data.meshes.remove, mesh)
        undo.callback(bpy.data.objects.remove, surface)  # first
        _fill(mesh, positions, faces)
        if has_texture:
            painted(mesh, shown, faces, path.with_name(f"{path.stem}{ENDS}"))
        else:
            _color(mesh, shown)
        for collection in obj.users_collection:
            collection.objects.link(surface)
        surface.parent = obj
        if not has_texture:
            surface.hide_render, surface.display_type = True, "WIRE"
        undo.pop_all()
    return surface


def read_surface(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(positions [V, 3], corners [F, 3], colours uint8 [V, 3]). Raises ``ValueError`` or ``KeyError`` for any other
    file."""
    data = path.read_bytes()
    head, end, _ = data.partition(b"end_header\n")
    counts = [int(words[2]) for line in head.splitlines() if (words := line.split())[:1] == [b"element"]]
    own = dict(zip(("vertices", "faces"), counts, strict=False))
    if (head + end).decode("ascii") != HEADER.format(**own):
        raise ValueError
    vertices = np.frombuffer(data, VERTEX, own["vertices"], len(head + end))
    faces = np.frombuffer(data, FACE, own["faces"], len(head + end) + vertices.nbytes)
    return vertices["position"], faces["corners"], vertices["rgb"]


def _fill(mesh: bpy.types.Mesh, positions: np.ndarray, corners: np.ndarray) -> None:
    """Triangles: positions [V, 3], corners [F, 3]."""
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(positions).ravel())
    mesh.loops.add(corners.size)
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(corners).ravel())
    mesh.polygons.add(len(corners))
    mesh.polygons.foreach_set("loop_start", np.arange(0, corners.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)


def _color(mesh: bpy.types.Mesh, rgb: np.ndarray) -> None:
    """A colour per vertex, uint8 [V, 3]: Blender keeps them in bytes of the sRGB curve, as the file does."""
    linear = np.ones((len(rgb), 4), np.float32)
    linear[:, :3] = to_working(decoded(rgb / np.float32(255)))
    attribute = mesh.attributes.new(COLOR, "BYTE_COLOR", "POINT")
    attribute.data.foreach_set("color", linear.ravel())
    mesh.attributes.active_color = attribute
    mesh.color_attributes.render_color_index = mesh.color_attributes.active_color_index
