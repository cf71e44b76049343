"""glTF 2.0 (.glb, .gltf) with the extension KHR_gaussian_splatting (ratified by Khronos), written as float32.

A mesh of points with the attributes POSITION, ROTATION (x, y, z, w), SCALE (standard deviations), OPACITY (0..1) and
SH_DEGREE_l_COEF_n (red, green, blue), in glTF's axes: x left, y up, z forward. The signs of the SH basis are those of
3DGS. COLOR_0 is for programs that know points only: linear, as glTF has it. How the model is drawn is in ``extras`` of
the primitive, linear colours in ``colorSpace`` too. What is up, and the metres of a unit, make the matrix of the node:
a scene of glTF has y up and is in metres.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..scene.drawing import EXTRAS, Drawing
from ..scene.quaternions import unit_quaternions
from ..scene.scales import finite_scales
from ..scene.sh_basis import C0
from ..scene.splats import Array, Splats
from ..support.files import write_bytes
from ..support.srgb import srgb_to_linear
from .gltf_author import Accessors, made_for
from .gltf_read import DISPLAY, LINEAR, NAME
from .model import Model
from .packing import LUF
from .placed import placing

POINTS, POSITION = 0, "POSITION"


def attributes(splats: Splats, linear: bool = False) -> dict[str, Array]:
    """Attributes by name, [N, components]: float32, but COLOR_0 bytes; ``linear``: the colours of the model are."""
    shown = np.clip(splats.sh_coeffs[:, 0] * C0 + 0.5, 0, 1)  # [N, 3]
    colors = np.concatenate([shown if linear else srgb_to_linear(shown), splats.opacities[:, None]], axis=1)  # [N, 4]
    found: dict[str, Array] = {
        POSITION: splats.means,
        "COLOR_0": np.round(colors * 255).astype(np.uint8),
        f"{NAME}:ROTATION": unit_quaternions(splats.quats).astype(np.float32),
        f"{NAME}:SCALE": finite_scales(splats.log_scales).astype(np.float32),
        f"{NAME}:OPACITY": splats.opacities[:, None],
    }
    return found | {name: splats.sh_coeffs[:, k] for k, name in enumerate(sh_names(splats.sh_degree))}


def encode(splats: Splats, drawing: Drawing = Drawing(), binary: bool = True) -> bytes:
    """The file of a model of plain Gaussians that is in LUF axes; ``binary``: .glb, else .gltf."""
    accessors = Accessors()
    found = attributes(splats, bool(drawing.linear))
    indices = {name: accessors.add(values, bounds=name == POSITION) for name, values in found.items()}
    how: dict[str, Any] = {"kernel": "ellipse", "colorSpace": LINEAR if drawing.linear else DISPLAY}
    how |= {"sortingMethod": "cameraDistance", "projection": "perspective"}
    primitive: dict[str, Any] = {"attributes": indices, "mode": POINTS, "extensions": {NAME: how}}
    if said := drawing.said():
        primitive["extras"] = {EXTRAS: said}
    return accessors.file(primitive, placing(drawing, LUF), [NAME], binary)


def write(path: Path, model: Model, binary: bool) -> None:
    """The same, to a file. Raises ``DataError``."""
    with made_for(path):
        content = encode(model.splats, model.drawing, binary)
    write_bytes(path, content)


def sh_names(degree: int) -> list[str]:
    """Attributes of the coefficients, in the order of 3DGS."""
    return [f"{NAME}:SH_DEGREE_{d}_COEF_{n}" for d in range(degree + 1) for n in range(2 * d + 1)]
