"""The normal of a primitive: its shortest axis, turned to the camera.

A primitive that has been fitted to a surface is a flat disc in it (Guédon and Lepetit 2024, SuGaR, Sec. 4.1). One that
is not flat has no normal: of equal axes the first is taken.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .activations import rotation_matrix
from .device_camera import DeviceCamera
from .rows import read_rows, rows


def normals(params: dict, camera: DeviceCamera) -> list:
    """Unit vectors in world space, 3 channels of [N].

    Differentiable by the quaternions; which axis it is, and to which side it points, are constants.

    Args:
        params: raw parameters as flat arrays, see ``project``.
        camera: the view, whose centre, or plane, every normal faces (a right angle counts as facing).
    """
    index, axis = dr.arange(mi.UInt32, dr.width(params["logit_opacities"])), shortest_axes(params)
    if camera.perspective:
        direction = camera.anonymous().offset(rows(dr.detach(params["means"]), 3, index))
    else:
        direction = camera.rotation[2]
    x, y, z = (d * dr.detach(n) for d, n in zip(direction, axis, strict=True))
    away = x + y + z > 0
    return [dr.select(away, -n, n) for n in axis]


def shortest_axes(params: dict) -> list:
    """The same without a camera: unit vectors to either side. Differentiable by the quaternions."""
    index = dr.arange(mi.UInt32, dr.width(params["logit_opacities"]))
    R = rotation_matrix(read_rows(params["quats"], 4, 4, index))
    a, b, c = rows(dr.detach(params["log_scales"]), 3, index)
    first, second = (a <= b) & (a <= c), b <= c
    return [dr.select(first, row[0], dr.select(second, row[1], row[2])) for row in R]
