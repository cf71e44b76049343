"""Surfaces through which something else is seen: as much of it, and of what they emit, as in Cycles."""

import pytest
from blender_pictures import picture
from surroundings import GREY, background, body, camera, light, link, material, plane

from blender_addon.engine.settings import ENGINE

pytestmark = pytest.mark.usefixtures("by_command")


def bare(tree):
    """The node for the output of a material, without its shader."""
    tree.nodes.remove(next(node for node in tree.nodes if node.type != "OUTPUT_MATERIAL"))
    return tree.nodes[0].inputs


def both(scene, folder, of):
    """(by Cycles, by Mitsuba): a square of a material before a grey one, [3] each where both are seen."""
    camera(scene, (0, 0, 8))
    scene.cycles.samples = scene.dogsplat.samples = 64
    background(scene, (0.3, 0.5, 0.2, 1))
    body(plane(2), of)
    body(plane(20, location=(0, 0, -2)), material("ShaderNodeBsdfDiffuse", Color=GREY))
    return [picture(scene, engine, folder)[12:-12, 20:-20].mean((0, 1)) for engine in ("CYCLES", ENGINE)]


def test_a_body_of_fog_alone_has_no_surface(scene, tmp_path):
    """Its fog is left out, which a note says; a lamp lights what is behind it."""
    fog = material("ShaderNodeEmission")
    link(fog.node_tree, "ShaderNodeVolumeScatter", "Volume", bare(fog.node_tree)["Volume"])
    fog.node_tree.nodes[-1].inputs["Density"].default_value = 0.0
    light(scene, "POINT", (0, 0, 1), energy=50, shadow_soft_size=0)
    cycles, ours = both(scene, tmp_path, fog)
    assert cycles.min() > 0.1
    assert ours == pytest.approx(cycles, rel=0.03)
