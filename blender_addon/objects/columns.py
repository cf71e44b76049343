"""Attributes of the points of a mesh or point cloud as arrays."""

from __future__ import annotations

import bpy
import numpy as np

from ..files.errors import told

POINT_FIELDS = {  # name and width of what an attribute holds, but for strings, of which there are no arrays
    "FLOAT": ("value", 1), "FLOAT2": ("vector", 2), "FLOAT_VECTOR": ("vector", 3), "FLOAT4": ("vector", 4),
    "FLOAT_COLOR": ("color", 4), "BYTE_COLOR": ("color", 4), "QUATERNION": ("value", 4), "FLOAT4X4": ("value", 16),
    "INT": ("value", 1), "INT8": ("value", 1), "BOOLEAN": ("value", 1), "INT16_2D": ("value", 2),
    "INT32_2D": ("value", 2),
}  # fmt: skip
WHOLE = ("INT", "INT8", "BOOLEAN", "INT16_2D", "INT32_2D")
Geometry = bpy.types.Mesh | bpy.types.PointCloud


def put_column(mesh: Geometry, name: str, values: np.ndarray, kind: str | None = None) -> None:
    """Store an attribute of the points, [N, width] or [N]; by default a number, vector or colour by its width."""
    width = 1 if values.ndim == 1 else values.shape[1]
    whole = np.issubdtype(values.dtype, np.integer)
    kind = kind or ("INT" if whole else {1: "FLOAT", 3: "FLOAT_VECTOR", 4: "FLOAT_COLOR"}[width])
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, "POINT")
    values = np.ascontiguousarray(values, np.int32 if whole else np.float32)
    attribute.data.foreach_set(POINT_FIELDS[kind][0], values.ravel())


def get_column(mesh: Geometry, name: str, width: int) -> np.ndarray:
    """An attribute of the points, [N, width]. Raises ``ValueError`` where there is none of that kind."""
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.domain != "POINT" or attribute.data_type not in POINT_FIELDS:
        problem = 'the mesh "{mesh}" has no usable attribute "{name}"; import the model again'
        raise ValueError(told(problem, mesh=mesh.name, name=name))
    field, own_width = POINT_FIELDS[attribute.data_type]
    if own_width != width:
        problem = 'attribute "{name}" of "{mesh}" is {kind}; import the model again'
        raise ValueError(told(problem, name=name, mesh=mesh.name, kind=attribute.data_type))
    values = np.empty(len(attribute.data) * width, np.int32 if attribute.data_type in WHOLE else np.float32)
    attribute.data.foreach_get(field, values)
    return values.reshape(-1, width)
