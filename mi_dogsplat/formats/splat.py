"""``.splat`` (antimatter15): 32 bytes a primitive without header, colours the same from all sides.

Position and standard deviations as six 32-bit floats, then bytes: red, green, blue, opacity, and the unit quaternion
(w, x, y, z) as 128 q + 128. Axes are those of 3DGS PLY. The largest and most opaque come first, so that what has been
loaded of a file can be shown.

Layout: github.com/antimatter15/splat (MIT).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..scene.quaternions import WXYZ_FROM_XYZW, XYZW_FROM_WXYZ, unit_quaternions
from ..scene.scales import SMALLEST_SCALE, finite_scales
from ..scene.sh_basis import C0
from ..scene.splats import Splats
from ..support.errors import DAMAGED, DataError
from ..support.wording import counted
from .model import Model
from .packing import logits

ROW = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)])
MIDDLE = 128  # of a quaternion's component


def encode(splats: Splats) -> bytes:
    """The file of a model of plain Gaussians; view dependence is left out."""
    rows = np.zeros(splats.n_splats, ROW)
    colors = np.concatenate([splats.sh_coeffs[:, 0] * C0 + 0.5, splats.opacities[:, None]], axis=1)  # [N, 4]
    rows["means"], rows["scales"] = splats.means, finite_scales(splats.log_scales)
    rows["rgba"] = np.round(np.clip(colors, 0, 1) * 255)
    rows["quats"] = np.clip(np.round(unit_quaternions(splats.quats)[:, WXYZ_FROM_XYZW] * MIDDLE + MIDDLE), 0, 255)
    size = splats.log_scales.astype(np.float64).sum(axis=1) + np.log(np.maximum(splats.opacities, 1e-30))
    return rows[np.argsort(-size, kind="stable")].tobytes()


def read(path: Path) -> Model:
    """The content of a file. Raises ``DataError``."""
    data = path.read_bytes()
    if len(data) % ROW.itemsize:
        problem = f"{counted(len(data), 'byte')}: no whole number of primitives of {ROW.itemsize}"
        raise DataError(path, problem, DAMAGED)
    rows = np.frombuffer(data, ROW)
    rgba = rows["rgba"] / 255.0
    log_scales = np.log(np.maximum(rows["scales"].astype(np.float64), SMALLEST_SCALE))
    quats = (rows["quats"].astype(np.float64) - MIDDLE) / MIDDLE
    splats = Splats(
        means=rows["means"],
        log_scales=log_scales,
        quats=quats[:, XYZW_FROM_WXYZ],
        logit_opacities=logits(rgba[:, 3]),
        sh_coeffs=((rgba[:, :3] - 0.5) / C0)[:, None],
    )
    return Model(splats)
