"""Lamps that are set up in unusual ways are as bright, and shine as far to the sides, as in Cycles."""

import bpy
import pytest
from blender_pictures import picture
from surroundings import GREY, blocks, body, camera, light, material, plane

from blender_addon.engine.settings import ENGINE

pytestmark = pytest.mark.usefixtures("by_command")


def both(scene, folder):
    """(by Cycles, by Mitsuba): a floor seen from above."""
    camera(scene, (0, 0, 8))
    body(plane(20), material("ShaderNodeBsdfDiffuse", Color=GREY))
    return [blocks(picture(scene, engine, folder)) for engine in ("CYCLES", ENGINE)]


@pytest.mark.skipif("normalize" not in bpy.types.PointLight.bl_rna.properties, reason="no such setting in this Blender")
@pytest.mark.parametrize("kind, values", [
    ("POINT", {"energy": 100, "shadow_soft_size": 0}),
    ("POINT", {"energy": 100, "shadow_soft_size": 0.2}),
    ("SPOT", {"energy": 100, "shadow_soft_size": 0, "spot_size": 1.6, "spot_blend": 0.5}),
    ("SPOT", {"energy": 400, "shadow_soft_size": 0.1, "spot_size": 1.6, "spot_blend": 1.0}),
    ("SUN", {"energy": 2, "angle": 0}),
    ("SUN", {"energy": 3000, "angle": 0.01}),
    ("SUN", {"energy": 20, "angle": 0.2}),
    ("AREA", {"energy": 1000, "size": 0.3}),
])  # fmt: skip
def test_a_light_whose_size_decides_is_as_bright_as_in_cycles(scene, tmp_path, kind, values):
    light(scene, kind, (0.3, 0.1, 2), (0.2, 0.3, 0.5), normalize=False, **values)
    cycles, ours = both(scene, tmp_path)
    assert cycles.mean() > 0.005
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.02)
