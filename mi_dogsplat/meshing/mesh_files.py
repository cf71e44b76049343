"""Meshes as files that Blender, Mitsuba and everything else reads, with colours of vertices or a texture.

In PLY and Wavefront OBJ they are in the coordinates of the model. glTF and OpenUSD have y up and are in metres, as the
model has it in these formats: so both lie on each other in one scene.
"""

# pyright: reportAttributeAccessIssue=false
# (the library of OpenUSD has no types)

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.gltf_author import INDICES, Accessors
from ..formats.packing import LUF, RUB
from ..formats.placed import placing
from ..formats.usd_author import ROOT, author, new_stage, place, write_stage
from ..formats.usd_files import NAMES, PACKAGE, require_package
from ..scene.drawing import Drawing
from ..scene.ply_tables import RGB
from ..support.errors import DataError
from ..support.files import write_bytes
from ..support.srgb import srgb_to_linear
from .beside import MARK, material_beside, picture_beside, require_ours, written_beside
from .mesh import Mesh, Texture
from .usd_look import paint

UNLIT = "KHR_materials_unlit"
SMOOTH = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}  # trilinear, and no second copy beside
QUALITY = {"quality": 95, "subsampling": 0}  # of JPEG
Writer = Callable[[Path, Mesh, Drawing], None]
"""writes a mesh of a model of which that is said"""


def writer_of(path: Path, texture: bool = False) -> Writer:
    """What writes a mesh, or one with a texture, to a file of this name.

    Raises ``DataError`` for a name of another format, where the library of OpenUSD is missing, and where the texture
    would take the place of something else.
    """
    if (write := WRITERS.get(path.suffix.lower())) is None:
        raise DataError(path, "no known mesh format", f"name a file that ends in {', '.join(WRITERS)}")
    if texture and write not in WITH_TEXTURE:
        names = ", ".join(name for name, written in WRITERS.items() if written in WITH_TEXTURE)
        raise DataError(path, "has no place for a texture", f"name a file that ends in {names}")
    if write is write_usd:
        require_package(path)
    if texture and path.suffix.lower() not in WHOLE:
        require_ours(picture_beside(path), *[material_beside(path)] * (write is write_obj))
    return write


def write_ply(path: Path, mesh: Mesh, _: Drawing) -> None:
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


def write_obj(path: Path, mesh: Mesh, _: Drawing) -> None:
    """Text; colours stand behind the positions, as MeshLab and Blender have it. A texture lies beside it: ``NAME.mtl``,
    and the picture that this names, ``NAME_texture.jpg``."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]  # all that float32 tells apart
    corner, beside = "{0}", dict[Path, bytes]()
    if mesh.texture is not None:
        corner, picture, material = "{0}/{0}", picture_beside(path), material_beside(path)
        said = f"\nnewmtl surface\nKa 1 1 1\nKd 1 1 1\nillum 0\nmap_Kd {picture.name}\n"  # no light falls on it
        beside = {picture: _picture(mesh.texture), material: b"# " + MARK + os.fsencode(said)}
        lines = [f"mtllib {material.name}", *lines, "usemtl surface"]
        lines += [f"vt {u:.7g} {1 - v:.7g}" for u, v in mesh.texture.uv.tolist()]  # up from the bottom
    elif mesh.colors is not None:
        lines = [f"{line} {r:.4g} {g:.4g} {b:.4g}" for line, (r, g, b) in zip(lines, mesh.colors.tolist(), strict=True)]
    lines += [" ".join(("f", *(corner.format(k) for k in face))) for face in (mesh.faces + 1).tolist()]
    with written_beside(beside):
        write_bytes(path, os.fsencode("\n".join(lines) + "\n"))  # names may be no UTF-8


def write_gltf(path: Path, mesh: Mesh, drawing: Drawing) -> None:
    """glTF 2.0, .glb or .gltf, with linear colours or a texture, which are those of its surface under the light of the
    photographs: so no other light falls on it (``KHR_materials_unlit``). Both of its sides are seen."""
    accessors = Accessors()
    points = (mesh.vertices * np.array(LUF[0])).astype(np.float32)  # half a turn: corners keep their order
    attributes = {"POSITION": accessors.add(points, bounds=True)}
    if mesh.colors is not None:
        attributes["COLOR_0"] = accessors.add(srgb_to_linear(mesh.colors).astype(np.float32))
    dull: dict[str, Any] = {"metallicFactor": 0, "roughnessFactor": 1}  # in programs that light it all the same
    more: dict[str, Any] = {}
    if mesh.texture is not None:
        attributes["TEXCOORD_0"] = accessors.add(mesh.texture.uv.astype(np.float32))
        view = accessors.view(_picture(mesh.texture))
        more = {"images": [{"bufferView": view, "mimeType": "image/jpeg"}], "samplers": [SMOOTH]}
        more["textures"] = [{"source": 0, "sampler": 0}]
        dull["baseColorTexture"] = {"index": 0}
    indices = accessors.add(mesh.faces.astype(np.uint32).reshape(-1, 1), INDICES)
    material = {"pbrMetallicRoughness": dull, "doubleSided": True, "extensions": {UNLIT: {}}}
    primitive = {"attributes": attributes, "indices": indices, "material": 0}
    binary = path.suffix.lower() == ".glb"
    more["materials"] = [material]
    write_bytes(path, accessors.file(primitive, placing(drawing, LUF), [UNLIT], binary, **more))


def write_usd(path: Path, mesh: Mesh, drawing: Drawing) -> None:
    """A prim ``Mesh`` with linear colours, as OpenUSD takes them to be, or with a texture; no subdivision. The picture
    is in a .usdz, or beside another file: ``NAME_usda_texture.jpg``."""
    from pxr import UsdGeom

    stage = new_stage()
    prim = UsdGeom.Mesh.Define(stage, f"{ROOT}/Surface").GetPrim()
    points = (mesh.vertices * np.array(RUB[0])).astype(np.float32)  # half a turn: corners keep their order
    author(prim, "points", "point3f[]", points)
    author(prim, "faceVertexCounts", "int[]", np.full(len(mesh.faces), 3))
    author(prim, "faceVertexIndices", "int[]", mesh.faces.ravel())
    author(prim, "extent", "float3[]", np.stack([points.min(axis=0), points.max(axis=0)]))
    author(prim, "subdivisionScheme", "token", "none", varying=False)
    if mesh.colors is not None:
        colors = author(prim, "primvars:displayColor", "color3f[]", srgb_to_linear(mesh.colors))
        UsdGeom.Primvar(colors).SetInterpolation(UsdGeom.Tokens.vertex)
    place(prim, placing(drawing, RUB))
    if mesh.texture is None:
        write_stage(path, stage)
        return
    picture, content = picture_beside(path), _picture(mesh.texture)
    paint(prim, mesh.texture.uv, f"./{picture.name}")
    if path.suffix.lower() == PACKAGE:
        write_stage(path, stage, {picture.name: content})
        return
    with written_beside({picture: content}):
        write_stage(path, stage)


def _picture(texture: Texture) -> bytes:
    """A JPEG."""
    from PIL import Image

    pixels, file = np.rint(255 * np.clip(texture.pixels, 0, 1)).astype(np.uint8), io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", **QUALITY, comment=MARK)
    return file.getvalue()


WHOLE = (".glb", ".gltf", PACKAGE)  # files that hold their texture
WITH_TEXTURE = (write_obj, write_gltf, write_usd)
WRITERS: dict[str, Writer] = {".ply": write_ply, ".obj": write_obj, **dict.fromkeys((".glb", ".gltf"), write_gltf),
                             **dict.fromkeys(NAMES, write_usd)}  # fmt: skip
