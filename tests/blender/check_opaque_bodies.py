"""Bodies of plastic, painted or of no material at all: as bright as in Cycles."""

import bpy
import numpy as np
import pytest
from blender_pictures import of_fine_pixels
from surroundings import HEIGHT, WIDTH, background, body, camera, image, light, link, material, sphere

from blender_addon.engine.settings import ENGINE

pytestmark = pytest.mark.usefixtures("by_command")
PRINCIPLED = "ShaderNodeBsdfPrincipled"


def without_nodes():
    made = bpy.data.materials.new("without nodes")
    made.diffuse_color = 0.7, 0.3, 0.2, 1
    return made


def painted(is_float):
    made = material(PRINCIPLED)
    shader = next(node for node in made.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    texture = link(made.node_tree, "ShaderNodeTexImage", "Color", shader.inputs["Base Color"])
    texture.image = image("paint", lambda x, y: (0.8 + 0 * x, 0.5 + 0 * x, 0.3 + 0 * x), is_float)
    return made


BODIES = {
    "no material": lambda: None,
    "without nodes": without_nodes,
    "plastic": lambda: material(PRINCIPLED, Base_Color=(0.8, 0.4, 0.1, 1)),
    "shining plastic": lambda: material(PRINCIPLED, Roughness=0.2, IOR=2.0),
    "painted": lambda: painted(False),
    "painted in floats": lambda: painted(True),
}


@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("lamp", [False, True])
def test_an_opaque_body_is_as_bright_as_in_cycles(scene, tmp_path, kind, lamp):
    """A ball in even light or before a wide lamp: its middle, and the whole of it."""
    camera(scene, (0, 0, 8))
    scene.cycles.samples = scene.dogsplat.samples = 256
    if lamp:
        light(scene, "AREA", (1, 1, 5), energy=200, size=2)
    else:
        background(scene, (1, 1, 1, 1))
    body(sphere(1.5), BODIES[kind]())
    cycles, ours = (of_fine_pixels(scene, engine, tmp_path)[..., :3] for engine in ("CYCLES", ENGINE))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    away = np.hypot(y - HEIGHT / 2 + 0.5, x - WIDTH / 2 + 0.5)
    for radius, tolerance in ((5, 0.015), (12, 0.03)):
        seen, expected = (values[away < radius].mean(axis=0) for values in (ours, cycles))
        assert expected.max() > 0.04
        assert seen == pytest.approx(expected, rel=tolerance, abs=0.002), radius
