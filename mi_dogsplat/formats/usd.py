"""OpenUSD (.usd, .usda, .usdc, .usdz): a prim ParticleField3DGaussianSplat of OpenUSD 26.03, written as float32.

The axes are x right, y up, z back (RUB), as those of a stage with y up and of its cameras; SH turn with them, and their
signs are those of 3DGS. What is up, and the metres of a unit, make the matrix of the prim. It lies in an Xform, which
is what a stage that references the file moves. How the model is drawn is in ``customData``, linear colours in the
``colorSpace`` of the coefficients, too. The coefficients say by ``elementSize`` and ``interpolation`` that they are
some for each primitive, as Pixar's converter writes them.
"""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..scene.drawing import EXTRAS, Drawing
from ..scene.quaternions import rotation_from_quaternion, unit_quaternions
from ..scene.scales import finite_scales
from ..scene.splats import Array, Splats
from .packing import RUB
from .placed import placing
from .usd_author import ROOT, author, new_stage, place, write_stage
from .usd_files import require_package
from .usd_read import COEFFICIENTS, DEGREE, DISPLAY, LINEAR, TYPE

PRIM = f"{ROOT}/Splats"
REACH = 3  # standard deviations: what is further away is not seen


def write(path: Path, splats: Splats, drawing: Drawing = Drawing()) -> None:
    """Write a model of plain Gaussians that is in RUB axes. Raises ``DataError``."""
    require_package(path)
    from pxr import UsdGeom

    stage = new_stage()
    prim = stage.DefinePrim(PRIM, TYPE)
    author(prim, "positions", "point3f[]", splats.means)
    author(prim, "orientations", "quatf[]", unit_quaternions(splats.quats))
    author(prim, "scales", "float3[]", finite_scales(splats.log_scales))
    author(prim, "opacities", "float[]", splats.opacities)
    author(prim, DEGREE, "int", splats.sh_degree, varying=False)
    coefficients = author(prim, COEFFICIENTS, "float3[]", splats.sh_coeffs.reshape(-1, 3))
    coefficients.SetColorSpace(LINEAR if drawing.linear else DISPLAY)
    of_each = UsdGeom.Primvar(coefficients)
    of_each.SetElementSize(splats.sh_coeffs.shape[1])
    of_each.SetInterpolation(UsdGeom.Tokens.vertex)
    author(prim, "extent", "float3[]", extent(splats))
    author(prim, "sortingModeHint", "token", "zDepth", varying=False)
    author(prim, "projectionModeHint", "token", "perspective", varying=False)
    place(prim, placing(drawing, RUB))
    if said := drawing.said():
        prim.SetCustomData({EXTRAS: said})
    write_stage(path, stage)


def extent(splats: Splats) -> Array:
    """The least and the greatest corner [2, 3] of a box around all primitives; empty, as OpenUSD has it, of none."""
    if not splats.n_splats:
        return np.zeros((0, 3), np.float32)
    turns = rotation_from_quaternion(splats.quats.astype(np.float64))
    axes = turns * finite_scales(splats.log_scales)[:, None, :]  # [N, 3, 3]
    reach = REACH * np.sqrt((axes**2).sum(axis=2))  # [N, 3]
    largest = np.finfo(np.float32).max
    corners = [(splats.means - reach).min(axis=0), (splats.means + reach).max(axis=0)]
    return np.clip(corners, -largest, largest).astype(np.float32)
