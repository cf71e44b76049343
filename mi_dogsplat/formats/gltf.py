"""glTF 2.0, binary (.glb), with the extension KHR_gaussian_splatting (ratified by Khronos): float32 throughout.

A mesh of points with the attributes POSITION, ROTATION (x, y, z, w), SCALE (standard deviations), OPACITY (0..1) and
SH_DEGREE_l_COEF_n (red, green, blue), in glTF's axes: y up, what the cameras look at faces z. The signs of the SH basis
are those of 3DGS. COLOR_0 is for programs that know points only. Own code: a JSON before a block of numbers.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.splats import Array, Splats
from ..support.errors import DataError
from .packing import logits, unit_quats

NAME = "KHR_gaussian_splatting"
MAGIC, VERSION, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
FLOAT, BYTE, ARRAY_BUFFER, POINTS = 5126, 5121, 34962, 0
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
C0 = 0.28209479177387814


def attributes(splats: Splats) -> dict[str, Array]:
    """Attributes by name, [N, components]: float32, but COLOR_0 bytes."""
    colors = np.concatenate([splats.sh_coeffs[:, 0] * C0 + 0.5, splats.opacities[:, None]], axis=1)  # [N, 4]
    found: dict[str, Array] = {
        "POSITION": splats.means,
        "COLOR_0": np.round(np.clip(colors, 0, 1) * 255).astype(np.uint8),
        f"{NAME}:ROTATION": unit_quats(splats).astype(np.float32),
        f"{NAME}:SCALE": splats.scales,
        f"{NAME}:OPACITY": splats.opacities[:, None],
    }
    return found | {name: splats.sh_coeffs[:, k] for k, name in enumerate(_sh_names(splats.sh_degree))}


def encode(splats: Splats) -> bytes:
    """The file of a model of plain Gaussians that is in RUB axes."""
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    binary, indices = b"", {}
    for name, values in attributes(splats).items():
        raw = values.tobytes()  # of rows of 4 bytes or more: always aligned
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(raw), "target": ARRAY_BUFFER})
        component = BYTE if values.dtype == np.uint8 else FLOAT
        accessor: dict[str, Any] = {"bufferView": len(accessors), "componentType": component, "count": len(values)}
        accessor["type"] = KINDS[values.shape[1]]
        if component == BYTE:
            accessor["normalized"] = True
        if name == "POSITION":
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        indices[name] = len(accessors)
        accessors.append(accessor)
        binary += raw
    how = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    how |= {"sortingMethod": "cameraDistance", "projection": "perspective"}
    content = {
        "asset": {"version": "2.0", "generator": "mi_dogsplat"},
        "extensionsUsed": [NAME],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": indices, "mode": POINTS, "extensions": {NAME: how}}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<III", MAGIC, VERSION, 12 + len(chunks)) + chunks


def decode(path: Path) -> Splats:
    """The first primitive of the first mesh in a file that ``encode`` made, in RUB axes. Raises ``DataError``."""
    data = path.read_bytes()
    try:
        magic, version, _, length, _ = struct.unpack_from("<IIIII", data)
        content = json.loads(data[20 : 20 + length])
        if (magic, version) != (MAGIC, VERSION):
            raise ValueError("no binary glTF 2")
        indices = content["meshes"][0]["primitives"][0]["attributes"]
        binary = data[28 + length :]

        def values(name: str) -> Array:
            accessor = content["accessors"][indices[name]]
            width = {kind: n for n, kind in KINDS.items()}[accessor["type"]]
            offset = content["bufferViews"][accessor["bufferView"]]["byteOffset"]
            return np.frombuffer(binary, "<f4", accessor["count"] * width, offset).reshape(-1, width)

        degree = next(d for d in (3, 2, 1, 0) if f"{NAME}:SH_DEGREE_{d}_COEF_0" in indices)
        return Splats(
            means=values("POSITION"),
            log_scales=np.log(values(f"{NAME}:SCALE").astype(np.float64)),
            quats=values(f"{NAME}:ROTATION"),
            logit_opacities=logits(values(f"{NAME}:OPACITY")[:, 0]),
            sh_coeffs=np.stack([values(name) for name in _sh_names(degree)], axis=1),
        )
    except (struct.error, ValueError, KeyError, IndexError) as error:
        raise DataError(path, f"is no .glb of Gaussians ({error})", "export it again") from error


def _sh_names(degree: int) -> list[str]:
    return [f"{NAME}:SH_DEGREE_{d}_COEF_{n}" for d in range(degree + 1) for n in range(2 * d + 1)]
