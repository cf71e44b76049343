"""How much primitives weigh in the training views: the sums from which many scores in the literature are made."""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.composite_aovs import composite_aovs
from ..engine.composite_derivatives import lanes_add_in_turn
from ..engine.composite_weights import WEIGHTS_ROW, composite_weights
from ..engine.geometry import Blocks, Grid
from ..engine.parameters import device_array
from ..engine.project import DeviceCamera, project
from ..engine.rasterize import RasterOptions
from ..engine.tables import pack
from ..engine.tiles import tiles
from ..engine.walk import Settings


@dataclass
class Weights:
    """Over all views and the pixels in which a primitive is blended, [N] float64 each."""

    total: np.ndarray  # Σ α T
    transmittance: np.ndarray  # Σ T
    pixels: np.ndarray  # their number
    weighted: np.ndarray  # Σ e α T
    largest: np.ndarray  # max α T
    dominates: np.ndarray  # [N] bool, it has the largest α T of some pixel


def weights(
    params: dict, cameras: list[DeviceCamera], options: RasterOptions, planes: Sequence[np.ndarray] | None = None
) -> Weights:
    """Walk through all views.

    Args:
        params: as in ``rasterize``.
        cameras: the views.
        planes: e of each view, [H, W]; None: 1 everywhere.
    """
    n = dr.width(params["logit_opacities"])
    params = {name: dr.detach(value) for name, value in params.items()}
    Float: Any = dr.detached_t(mi.Float)
    UInt: Any = dr.detached_t(mi.UInt32)
    sums = np.zeros((4, n))
    largest, dominates = np.zeros(n), np.zeros(n, bool)
    for view, camera in enumerate(cameras):
        projection = project(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
        grid = Grid.of(camera.width, camera.height, Blocks.of_backend(), mi.variant())
        tables, lists = pack(projection, projection.colors), tiles(projection, grid, options.cutoffs)
        settings = Settings(3, options.cutoffs, options.negative_transmittance, options.patch)
        walk = grid, grid.lanes, tables, lists, settings
        entries, bits = dr.zeros(Float, dr.width(lists.entry_from_isect) * WEIGHTS_ROW), dr.zeros(UInt, n)
        plane = np.ones((camera.height, camera.width)) if planes is None else planes[view]
        plane = dr.detach(device_array(plane), preserve_type=False)
        dr.make_opaque(entries, bits)
        columns = composite_weights(*walk, plane, entries, bits, lanes_add_in_turn(mi.variant()))
        sums += np.stack([column.numpy() for column in columns])
        largest = np.maximum(largest, bits.numpy().view(np.float32))
        index = composite_aovs(*walk, None, ("index",))[0].numpy()
        dominates[index[index >= 0].astype(np.int64)] = True
    return Weights(*sums, largest, dominates)
