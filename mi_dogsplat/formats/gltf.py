"""glTF 2.0 (.glb, .gltf) with the extension KHR_gaussian_splatting (ratified by Khronos), written as float32.

A mesh of points with the attributes POSITION, ROTATION (x, y, z, w), SCALE (standard deviations), OPACITY (0..1) and
SH_DEGREE_l_COEF_n (red, green, blue), in glTF's axes: x left, y up, z forward. The signs of the SH basis are those of
3DGS. COLOR_0 is for programs that know points only. How the model is drawn is in ``extras`` of the primitive, linear
colours in ``colorSpace`` too. What is up, and the metres of a unit, make the matrix of the node: a scene of glTF has y
up and is in metres.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..scene.drawing import EXTRAS, Drawing
from ..scene.quaternions import unit_quaternions
from ..scene.scales import finite_scales
from ..scene.sh_basis import C0
from ..scene.splats import Array, Splats
from .gltf_container import glb, gltf
from .gltf_read import DISPLAY, LINEAR, NAME
from .packing import LUF
from .placed import placing

FLOAT, BYTE, ARRAY_BUFFER, POINTS = 5126, 5121, 34962, 0
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def attributes(splats: Splats) -> dict[str, Array]:
    """Attributes by name, [N, components]: float32, but COLOR_0 bytes."""
    colors = np.concatenate([splats.sh_coeffs[:, 0] * C0 + 0.5, splats.opacities[:, None]], axis=1)  # [N, 4]
    found: dict[str, Array] = {
        "POSITION": splats.means,
        "COLOR_0": np.round(np.clip(colors, 0, 1) * 255).astype(np.uint8),
        f"{NAME}:ROTATION": unit_quaternions(splats.quats).astype(np.float32),
        f"{NAME}:SCALE": finite_scales(splats.log_scales).astype(np.float32),
        f"{NAME}:OPACITY": splats.opacities[:, None],
    }
    return found | {name: splats.sh_coeffs[:, k] for k, name in enumerate(sh_names(splats.sh_degree))}


def encode(splats: Splats, drawing: Drawing = Drawing(), binary: bool = True) -> bytes:
    """The file of a model of plain Gaussians that is in LUF axes; ``binary``: .glb, else .gltf."""
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    parts, at, indices = [], 0, {}
    for name, values in attributes(splats).items():
        raw = values.tobytes()  # of rows of 4 bytes or more: always aligned
        views.append({"buffer": 0, "byteOffset": at, "byteLength": len(raw), "target": ARRAY_BUFFER})
        component = BYTE if values.dtype == np.uint8 else FLOAT
        accessor: dict[str, Any] = {"bufferView": len(accessors), "componentType": component, "count": len(values)}
        accessor["type"] = KINDS[values.shape[1]]
        if component == BYTE:
            accessor["normalized"] = True
        if name == "POSITION":
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        indices[name] = len(accessors)
        accessors.append(accessor)
        parts.append(raw)
        at += len(raw)
    how: dict[str, Any] = {"kernel": "ellipse", "colorSpace": LINEAR if drawing.linear else DISPLAY}
    how |= {"sortingMethod": "cameraDistance", "projection": "perspective"}
    primitive: dict[str, Any] = {"attributes": indices, "mode": POINTS, "extensions": {NAME: how}}
    if said := drawing.said():
        primitive["extras"] = {EXTRAS: said}
    node: dict[str, Any] = {"mesh": 0}
    if not np.array_equal(placed := placing(drawing, LUF), np.eye(4)):
        node["matrix"] = placed.T.ravel().tolist()
    content = {
        "asset": {"version": "2.0", "generator": "mi_dogsplat"},
        "extensionsUsed": [NAME],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": at}],
    }
    return (glb if binary else gltf)(content, b"".join(parts))


def sh_names(degree: int) -> list[str]:
    """Attributes of the coefficients, in the order of 3DGS."""
    return [f"{NAME}:SH_DEGREE_{d}_COEF_{n}" for d in range(degree + 1) for n in range(2 * d + 1)]
