"""Blender's own splats, where they are there or something can stand in for them."""

import addon_utils
import bpy
import pytest
from bpy.props import EnumProperty

from blender_addon.objects.feature import is_available

TYPES = (("POINTS", "Points", ""), ("GAUSSIAN_SPLAT", "3D Gaussian Splats", ""))


@pytest.fixture
def native():
    """Point clouds with types, as from 5.3 on."""
    if is_available():
        yield
        return
    if "resize" not in bpy.types.PointCloud.bl_rna.functions:
        pytest.skip("point clouds get points from Python since Blender 5.2, and are drawn as Gaussians since 5.3")
    bpy.types.PointCloud.type = EnumProperty(items=TYPES)
    addon_utils.disable("blender_addon")
    addon_utils.enable("blender_addon")
    yield
    del bpy.types.PointCloud.type
    addon_utils.disable("blender_addon")  # the next test enables it without them
