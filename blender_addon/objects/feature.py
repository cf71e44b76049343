"""Whether this Blender draws splats itself: asked of what it offers, and not of its version."""

from __future__ import annotations

import bpy

TYPE = "GAUSSIAN_SPLAT"  # of a point cloud


def is_available() -> bool:
    """Whether a point cloud can be of the type that is drawn as Gaussians."""
    kind = bpy.types.PointCloud.bl_rna.properties.get("type")
    return kind is not None and TYPE in kind.enum_items
