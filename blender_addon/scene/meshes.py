"""Evaluated geometry as binary PLY files, one for each material of a mesh.

Every corner of a triangle is a vertex of its own: it has Blender's normal, smooth, flat or custom, and its own texture
coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .export import Export

APART = 1e-4  # of the size of a mesh: between a luminous sheet and its back
_CORNER = np.dtype([(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")])
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


@dataclass
class Part:
    """The triangles of one material: positions and normals [T, 3, 3], texture coordinates [T, 3, 2]."""

    slot: int
    positions: np.ndarray
    normals: np.ndarray
    coordinates: np.ndarray
    uv_map: str = ""  # of the coordinates, as the mesh has it
    welded: bool = False  # every edge of the whole mesh has two faces

    def moved(self, matrix: np.ndarray) -> Part:
        """By a [4, 4] matrix; a mirror turns the triangles, so that their front stays where it was."""
        linear = matrix[:3, :3]
        positions = self.positions @ linear.T + matrix[:3, 3]
        normals = _unit(self.normals @ np.linalg.pinv(linear))
        moved = Part(self.slot, positions, normals, self.coordinates)
        return moved.turned() if np.linalg.det(linear) < 0 else moved

    def turned(self) -> Part:
        """The same triangles the other way round."""
        return Part(self.slot, *(values[:, ::-1] for values in (self.positions, self.normals, self.coordinates)))

    def back(self) -> Part:
        """A sheet just behind this one that looks the other way; nothing for a body, whose back nobody sees."""
        closed = _is_closed(self.positions)
        turned = self.turned()
        step = APART * float(np.ptp(self.positions.reshape(-1, 3), axis=0).max(initial=0))
        back = Part(self.slot, turned.positions - step * turned.normals, -turned.normals, turned.coordinates)
        return Part(self.slot, *(v[:0] for v in vars(back).values() if isinstance(v, np.ndarray))) if closed else back

    def write(self, export: Export) -> str:
        """The name of the file."""
        corners = np.empty(3 * len(self.positions), _CORNER)
        values = np.concatenate([self.positions, self.normals, self.coordinates], axis=2).reshape(-1, 8)
        for k, name in enumerate(_CORNER.names or ()):
            corners[name] = values[:, k]
        faces = np.empty(len(self.positions), _FACE)
        faces["count"], faces["corners"] = 3, np.arange(len(corners)).reshape(-1, 3)
        properties = "".join(f"property float {name}\n" for name in _CORNER.names or ())
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(corners)}\n{properties}"
        header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        content = header.encode() + corners.tobytes() + faces.tobytes()
        return export.write(content, ".ply")


def is_sheet(own: list[Part]) -> bool:
    """Whether the parts of a mesh enclose nothing; vertices at one place count as one."""
    return not (own[0].welded or _is_closed(np.concatenate([part.positions for part in own])))


def _is_closed(positions: np.ndarray) -> bool:
    """Whether every edge of triangles [T, 3, 3] has two of them."""
    sides = np.ascontiguousarray(np.round(positions, 6)).view([("", positions.dtype)] * 3).reshape(-1, 3)
    _, corner = np.unique(sides, return_inverse=True)
    corner = corner.reshape(-1, 3)
    edges = np.sort(np.concatenate([corner[:, k] for k in ([0, 1], [1, 2], [2, 0])]), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def parts(obj: bpy.types.Object) -> list[Part]:
    """The geometry of an evaluated object in its own coordinates; none where it has no faces."""
    mesh = obj.to_mesh()
    if mesh is None:
        return []
    try:
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        loops, vertices = (_read(mesh.loop_triangles, k, (count, 3), np.int32) for k in ("loops", "vertices"))
        slots = _read(mesh.loop_triangles, "material_index", (count,), np.int32)
        positions = _read(mesh.vertices, "co", (len(mesh.vertices), 3))[vertices]
        normals = _read(mesh.corner_normals, "vector", (len(mesh.loops), 3))[loops] if count else positions
        layers = mesh.uv_layers
        layer = next((layer for layer in layers if layer.active_render), None)
        coordinates = _read(layer.uv, "vector", (len(mesh.loops), 2))[loops] if layer and count else None
        if coordinates is None:
            coordinates = np.zeros((count, 3, 2), np.float32)
        edges = _read(mesh.loops, "edge_index", (len(mesh.loops),), np.int32)
        welded = bool((np.bincount(edges, minlength=len(mesh.edges)) == 2).all())
        found = [(slot, slots == slot) for slot in np.unique(slots)]
        name = layer.name if layer else ""
        return [Part(int(k), positions[own], normals[own], coordinates[own], name, welded) for k, own in found]
    finally:
        obj.to_mesh_clear()


def _read(collection, name: str, shape: tuple[int, ...], kind=np.float32) -> np.ndarray:
    values = np.empty(int(np.prod(shape)), kind)
    collection.foreach_get(name, values)
    return values.reshape(shape)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
