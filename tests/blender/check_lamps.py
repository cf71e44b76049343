"""Lamps that are set up in unusual ways are as bright, and shine as far to the sides, as in Cycles."""

import json

import bpy
import numpy as np
import pytest
from blender_pictures import of_fine_pixels
from surroundings import GREY, blocks, body, camera, image, light, link, material, plane

from blender_addon.cameras.objects import camera_numbers
from blender_addon.engine.settings import ENGINE
from blender_addon.scene.write import write_scene

pytestmark = pytest.mark.usefixtures("by_command")


def both(scene, folder):
    """(by Cycles, by Mitsuba): a floor seen from above."""
    camera(scene, (0, 0, 8))
    body(plane(20), material("ShaderNodeBsdfDiffuse", Color=GREY))
    return [blocks(of_fine_pixels(scene, engine, folder)[..., :3]) for engine in ("CYCLES", ENGINE)]


def written_lights(scene, folder):
    """(keys of the lamps in a file for Mitsuba, what is said of them)"""
    seen = scene.camera or camera(scene, (0, 0, 8))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    result = write_scene(depsgraph, None, camera_numbers(scene, seen), folder, 0)
    described = json.loads((folder / result.scene).read_text())
    return [key for key in described if key.startswith("light_")], result.notes


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


def test_a_light_whose_nodes_end_nowhere_is_dark(scene, tmp_path):
    """As in Cycles; of nodes that have no counterpart a note says so."""
    lamp = light(scene, "POINT", energy=100).data
    if lamp.node_tree is None:
        lamp.use_nodes = True  # before Blender 5
    tree = lamp.node_tree
    emission = next(node for node in tree.nodes if node.type == "EMISSION")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_LIGHT")
    assert written_lights(scene, tmp_path)[0]
    link(tree, "ShaderNodeTexImage", "Color", emission.inputs["Color"]).image = image("gobo", lambda x, y: (x, y, x))
    assert written_lights(scene, tmp_path)[1] == [f'"{lamp.name}": the texture of "Color" is left out']
    tree.links.clear()
    assert written_lights(scene, tmp_path) == ([], [])
    added = link(tree, "ShaderNodeAddShader", "Shader", output.inputs["Surface"])
    for socket in added.inputs:
        tree.links.new(emission.outputs[0], socket)
    lights, (note,) = written_lights(scene, tmp_path)
    assert len(lights) == 1 and f'"{lamp.name}": the node "{added.name}" has no counterpart' in note


def test_a_light_that_takes_light_away_is_said_to_be_left_out(scene, tmp_path):
    lamp = light(scene, "POINT", energy=-100).data
    assert written_lights(scene, tmp_path) == ([], [f'"{lamp.name}": a light of negative power is left out'])


@pytest.mark.parametrize("shape", ["SQUARE", "ELLIPSE"])
def test_an_area_of_no_size_is_dark(scene, tmp_path, shape):
    """One that grows from nothing begins so, and its size divides nothing."""
    lamp = light(scene, "AREA", (1, 1, 3), energy=100, shape=shape)
    assert len(written_lights(scene, tmp_path)[0]) == 1
    lamp.scale = 0, 0, 0
    cycles, ours = both(scene, tmp_path)
    assert cycles.max() == ours.max() == 0
    assert written_lights(scene, tmp_path) == ([], [])
    lamp.scale, lamp.data.size = (1, 1, 1), 0
    assert written_lights(scene, tmp_path) == ([], [])


@pytest.mark.parametrize("scale", [(2, 1, 1), (1, 1.5, 1), (0.4, 0.8, 1), (1, 1, 2), (-2, 1, 1)])
def test_the_cone_of_a_spot_is_scaled_with_it(scene, tmp_path, scale):
    spot = light(scene, "SPOT", (0.3, 0.1, 2), (0.2, 0.3, 0.5), energy=100, shadow_soft_size=0, spot_size=1.2)
    spot.data.spot_blend, spot.scale = 0.5, scale
    cycles, ours = both(scene, tmp_path)
    assert cycles.max() > 0.1
    assert np.abs(ours - cycles).max() < 0.03 * cycles.max()


def test_a_wide_sun_stands_where_it_does_for_a_scene_that_is_far_from_the_origin(scene, tmp_path):
    """As maps have them, with metres from far away."""
    rotation, place = (0.4, -0.3, 0.2), np.array([5000.0, 4000, 50])
    sun = light(scene, "SUN", (0, 0, 2), rotation, energy=2, angle=0.1)
    camera(scene, place + (0, 0, 8))
    body(plane(20, location=place), material("ShaderNodeBsdfDiffuse", Color=GREY))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    result = write_scene(depsgraph, None, camera_numbers(scene, scene.camera), tmp_path, 0)
    disk = np.array(json.loads((tmp_path / result.scene).read_text())["light_0"]["to_world"]["matrix"])
    towards = disk[:3, 3] - place
    assert towards / np.linalg.norm(towards) == pytest.approx(np.array(sun.matrix_world.col[2][:3]), abs=2e-3)
