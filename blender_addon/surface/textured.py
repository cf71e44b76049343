"""A surface whose colours are a picture: read as the package writes it, in Wavefront OBJ, and its material."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ..nodes.builder import Tree, arrange
from ..nodes.material import cleared

ENDS = "_texture.jpg"  # of the name of the picture, beside that of the mesh


def read_textured(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(positions [V, 3], corners [F, 3], places in the picture [V, 2]). Raises ``ValueError`` for any other file."""
    rows: dict[str, list[list[str]]] = {"v": [], "vt": [], "f": []}
    for line in path.read_text(encoding="ascii").splitlines():
        kind, *words = line.split()
        if kind in rows:
            rows[kind].append(words)
    corners = np.array([[word.split("/") for word in face] for face in rows["f"]], np.int32)  # [F, 3, 2]
    positions, uv = (np.array(rows[kind], np.float32) for kind in ("v", "vt"))
    if corners.shape[1:] != (3, 2) or (corners[..., 0] != corners[..., 1]).any() or len(positions) != len(uv):
        raise ValueError
    return positions, corners[..., 0] - 1, uv


def painted(mesh: bpy.types.Mesh, uv: np.ndarray, corners: np.ndarray, picture: Path) -> None:
    """Give a mesh of triangles its picture, which is kept in the .blend. It shines by itself: the light of the
    photographs is in it."""
    layer = mesh.uv_layers.new(name="UVMap")
    layer.uv.foreach_set("vector", np.ascontiguousarray(uv[corners.ravel()]).ravel())
    image = bpy.data.images.load(str(picture))
    image.name = mesh.name
    image.pack()
    material = bpy.data.materials.new(mesh.name)
    tree = Tree(cleared(material))
    texture, shader = tree.node("ShaderNodeTexImage", image=image), tree.node("ShaderNodeBsdfPrincipled")
    light = {"Base Color": (0, 0, 0, 1), "Specular IOR Level": 0, "Emission Strength": 1}
    for name, value in (light | {"Emission Color": texture.outputs["Color"]}).items():
        tree.plug(shader.inputs[name], value)
    tree.plug(tree.node("ShaderNodeOutputMaterial").inputs["Surface"], shader.outputs[0])
    if hasattr(material, "cycles"):
        material.cycles.emission_sampling = "NONE"  # thousands of faint lamps
    arrange(material.node_tree)
    mesh.materials.append(material)
