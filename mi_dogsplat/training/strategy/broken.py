"""Primitives that no step of the optimizer can bring back; training removes them before they count or are written.

The engine does not draw a primitive with a value that is not finite, and its gradient is zero: it harms nobody, but it
stays, takes memory, and no file may hold it. Some finite values are as final, and do harm: they have no gradient
wherever they show,

* a colour so bright that the faintest blend (α = 1/255) is white already: the loss clamps at white. Of linear images it
  does not, and lamps are brighter than that: there only what no light is as bright as is broken;
* a primitive that fills every view: where it is opaque, min(.99, ·) is flat everywhere;
* a cut so steep that no pixel lies in its fall: nothing says where its plane should be.
"""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.geometry import Cutoffs
from ...engine.rows import NO_ROW
from ...scene.row_groups import CURVATURES, PLANES, SLOPES
from ...scene.sh_basis import C0
from ..optimizer.group_rows import SPARSE_ROW
from ..optimizer.sh_rows import SH_INDEX
from ..optimizer.splat_optimizer import SplatOptimizer

OF_COLORS = SLOPES.names + CURVATURES.names
NORMALS = [name for plane in PLANES for name in plane.names]
MAX_COLOR = 1 / Cutoffs().alpha  # trained models stay below 3; of a slope, per standard deviation, below 2
MAX_RADIANCE = 1e6  # instead of MAX_COLOR where images are linear, in units of white; the sun is below 1e5
MAX_NORMAL = 1e4  # of a cut, per standard deviation; trained models stay below 200
MAX_SCALE = 1e4  # times the extent of the cameras; trained models stay below 10


def broken(optimizer: SplatOptimizer, extent: float) -> np.ndarray:
    """[N] whether a primitive, or a row that it has, has a value that is not finite or beyond the limits above.

    One kernel, one wait for the device; in a mixed model one more for each group.

    Args:
        extent: radius of the camera positions, world units.
    """
    params, limits = optimizer.params, _limits(optimizer, extent)
    sound, of_groups = dr.full(mi.Bool, True, optimizer.n), []
    for name in optimizer.adam:
        fine = _fine_rows(optimizer, params, name, limits.get(name))
        if name in SH_INDEX:
            of_groups.append((params[SH_INDEX[name]], fine))
        else:
            sound &= fine
    mask = ~sound.numpy()
    for index, fine in of_groups:
        mask[index.numpy()[~fine.numpy()]] = True
    return mask


def _limits(optimizer: SplatOptimizer, extent: float) -> dict[str, float]:
    """By parameter, beyond which a value is broken."""
    brightest = MAX_RADIANCE if optimizer.curve else MAX_COLOR
    colors = dict.fromkeys(("sh_dc", "sh_rest", *SH_INDEX), brightest / C0) | dict.fromkeys(OF_COLORS, brightest)
    return {"log_scales": math.log(MAX_SCALE * extent), **colors, **dict.fromkeys(NORMALS, MAX_NORMAL)}


def _fine_rows(optimizer: SplatOptimizer, params: dict, name: str, limit: float | None) -> mi.Bool:
    """Whether all numbers of a row are finite and within the limit: by primitive, of bands of a mixed model by row."""
    active = True
    if name in SPARSE_ROW:
        row = params.get(SPARSE_ROW[name], dr.full(mi.UInt32, NO_ROW, 1))
        active = row != NO_ROW
    else:
        row = dr.arange(mi.UInt32, dr.width(params[SH_INDEX[name]]) if name in SH_INDEX else optimizer.n)
    fine, size = mi.Bool(True), optimizer.row_size[name]
    for k in range(size):
        value = dr.gather(mi.Float, dr.detach(optimizer.adam[name]), dr.fma(row, size, k), active)
        fine &= dr.isfinite(value)
        if limit is not None:
            fine &= (value if name == "log_scales" else dr.abs(value)) <= dr.opaque(mi.Float, limit)
    return fine


def drop_broken(optimizer: SplatOptimizer, extent: float) -> np.ndarray:
    """Remove what is ``broken``; returns the rows that are left.

    Raises ``FloatingPointError`` when none would be.
    """
    mask = broken(optimizer, extent)
    if mask.all():
        raise FloatingPointError("no primitive has usable values any more; the training has diverged")
    kept = np.flatnonzero(~mask)
    if len(kept) < len(mask):
        optimizer.keep(kept)
    return kept
