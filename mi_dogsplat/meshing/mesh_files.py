"""Meshes as files that Blender, Mitsuba and everything else reads: PLY and Wavefront OBJ, with colours of vertices."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..scene.ply_tables import RGB
from ..support.errors import DataError
from ..support.files import write_bytes
from .mesh import Mesh


def writer_of(path: Path) -> Callable[[Path, Mesh], None]:
    """What writes a mesh to a file of this name. Raises ``DataError`` for a name of another format."""
    if (write := WRITERS.get(path.suffix.lower())) is None:
        raise DataError(path, "no known mesh format", f"name a file that ends in {' or '.join(WRITERS)}")
    return write


def write_ply(path: Path, mesh: Mesh) -> None:
    """Binary, little endian, with float positions and, if there are any, colours of a byte a channel."""
    columns = [(name, "<f4") for name in "xyz"] + [(name, "u1") for name in RGB if mesh.colors is not None]
    vertex = np.zeros(len(mesh.vertices), columns)
    for name, values in zip("xyz", mesh.vertices.T, strict=True):
        vertex[name] = values
    if mesh.colors is not None:
        for name, values in zip(RGB, mesh.colors.T, strict=True):
            vertex[name] = np.rint(255 * values)
    face = np.zeros(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    face["count"], face["corners"] = 3, mesh.faces
    kinds = {"<f4": "float", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property {kinds[code]} {name}" for name, code in columns]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices", "end_header\n"]
    write_bytes(path, "\n".join(header).encode(), vertex.tobytes(), face.tobytes())


def write_obj(path: Path, mesh: Mesh) -> None:
    """Text; colours stand behind the positions, as MeshLab and Blender have it."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]  # all that float32 tells apart
    if mesh.colors is not None:
        lines = [f"{line} {r:.4g} {g:.4g} {b:.4g}" for line, (r, g, b) in zip(lines, mesh.colors.tolist(), strict=True)]
    lines += ["f {} {} {}".format(*face) for face in (mesh.faces + 1).tolist()]
    write_bytes(path, ("\n".join(lines) + "\n").encode())


WRITERS: dict[str, Callable[[Path, Mesh], None]] = {".ply": write_ply, ".obj": write_obj}
