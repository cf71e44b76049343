"""The scene around the splats: Cycles and Mitsuba draw the same, without splats, from the same file of Blender."""

import math

import bpy
import numpy as np
import pytest
from blender_pictures import of_fine_pixels, picture
from model_files import load
from references import REFERENCES, place_camera
from surroundings import (
    GREY,
    HEIGHT,
    WIDTH,
    background,
    blocks,
    body,
    camera,
    image,
    light,
    link,
    material,
    plane,
    sphere,
)  # fmt: skip

from blender_addon import render_engine as engine

pytestmark = pytest.mark.usefixtures("by_command")


def both(scene, folder, fine=4):
    """(by Cycles, by Mitsuba)"""
    return [of_fine_pixels(scene, name, folder, fine)[..., :3] for name in ("CYCLES", engine.ENGINE)]


@pytest.mark.parametrize("kind, values", [
    ("POINT", {"energy": 100, "shadow_soft_size": 0}),
    ("POINT", {"energy": 100, "shadow_soft_size": 0.1}),
    ("SPOT", {"energy": 100, "shadow_soft_size": 0, "spot_size": 1.6, "spot_blend": 0.5}),
    ("SUN", {"energy": 2, "angle": 0}),
    ("SUN", {"energy": 2, "angle": 0.2}),
    ("AREA", {"energy": 100, "shape": "RECTANGLE", "size": 0.4, "size_y": 0.2}),
    ("AREA", {"energy": 100, "shape": "DISK", "size": 0.3}),
])  # fmt: skip
def test_a_light_is_as_bright_as_in_cycles(scene, tmp_path, kind, values):
    """On a floor seen from above, through the lamp where it has a size: Cycles does not show it."""
    camera(scene, (0, 0, 8))
    body(plane(20), material("ShaderNodeBsdfDiffuse", Color=GREY))
    light(scene, kind, (0.3, 0.1, 2), (0.2, 0.3, 0.5), **values)
    cycles, mitsuba = both(scene, tmp_path)
    assert cycles.mean() > 0.05
    assert mitsuba.mean() == pytest.approx(cycles.mean(), rel=0.01)
    lit = blocks(cycles) > 0.1 * cycles.max()
    assert np.percentile(np.abs(blocks(mitsuba)[lit] / blocks(cycles)[lit] - 1), 90) < 0.05


def textured(scene):
    """A picture on a wall, a turned environment, and bodies of several materials."""
    seen = camera(scene, (0, -5, 1.5), (math.radians(78), 0, 0))
    seen.data.shift_x, seen.data.shift_y = 0.08, -0.05
    body(plane(10), material("ShaderNodeBsdfDiffuse", Color=GREY))
    wall = material("ShaderNodeBsdfDiffuse")
    shader = next(node for node in wall.node_tree.nodes if node.type == "BSDF_DIFFUSE")
    texture = link(wall.node_tree, "ShaderNodeTexImage", "Color", shader.inputs["Color"])
    texture.image = image("wall", lambda x, y: (x, y, 0.5 * (x > 0.5)))
    mapping = link(wall.node_tree, "ShaderNodeMapping", "Vector", texture.inputs["Vector"])
    mapping.inputs["Scale"].default_value, mapping.inputs["Rotation"].default_value = (1.4, 0.8, 1), (0, 0, 0.5)
    mapping.inputs["Location"].default_value = (0.1, 0.2, 0)
    link(wall.node_tree, "ShaderNodeTexCoord", "UV", mapping.inputs["Vector"])
    body(plane(2, location=(0, 1, 1), rotation=(math.pi / 2, 0, 0)), wall)
    sky = background(scene)
    sky.inputs["Strength"].default_value = 1.3
    above = link(scene.world.node_tree, "ShaderNodeTexEnvironment", "Color", sky.inputs["Color"])
    above.image = image("sky", lambda x, y: (x, y, 0.3 + 0 * x), True)
    turned = link(scene.world.node_tree, "ShaderNodeMapping", "Vector", above.inputs["Vector"])
    turned.inputs["Rotation"].default_value = (0.5, 0.3, 1.1)
    link(scene.world.node_tree, "ShaderNodeTexCoord", "Generated", turned.inputs["Vector"])
    return seen


def test_textures_and_the_world_are_turned_as_in_cycles(scene, tmp_path):
    """Lens shift, mapping of a texture, and rotation and strength of the world, which a mirror shows as well."""
    textured(scene)
    body(sphere(0.5, location=(-1.4, 0.3, 0.6)), material("ShaderNodeBsdfGlossy", Color=(1, 1, 1, 1), Roughness=0.0))
    cycles, mitsuba = both(scene, tmp_path)
    assert cycles.std() > 0.15
    assert np.abs(blocks(mitsuba) - blocks(cycles)).mean() < 0.02
    assert np.corrcoef(mitsuba.ravel(), cycles.ravel())[0, 1] > 0.98


def test_a_mapping_turns_a_picture_about_all_axes(scene, tmp_path):
    """Of what it turns out of its plane the shadow is seen."""
    camera(scene, (0, 0, 8))
    wall = material("ShaderNodeEmission")
    shader = next(node for node in wall.node_tree.nodes if node.type == "EMISSION")
    texture = link(wall.node_tree, "ShaderNodeTexImage", "Color", shader.inputs["Color"])
    texture.image = image("wall", lambda x, y: (x, y, 0.5 * (x > 0.5)), True)
    mapping = link(wall.node_tree, "ShaderNodeMapping", "Vector", texture.inputs["Vector"])
    mapping.inputs["Scale"].default_value, mapping.inputs["Rotation"].default_value = (1.4, 0.8, 2), (0.8, -0.5, 0.6)
    link(wall.node_tree, "ShaderNodeTexCoord", "UV", mapping.inputs["Vector"])
    body(plane(8), wall)
    cycles, mitsuba = both(scene, tmp_path)
    assert np.abs(blocks(mitsuba) - blocks(cycles)).mean() < 0.01


def test_pixels_need_not_be_square(scene, tmp_path):
    textured(scene)
    scene.render.pixel_aspect_y = 1.5
    cycles, mitsuba = both(scene, tmp_path)
    assert np.abs(blocks(mitsuba) - blocks(cycles)).mean() < 0.02


def test_a_lens_blurs_what_is_out_of_focus_as_in_cycles(scene, tmp_path):
    lens = textured(scene).data
    lens.dof.use_dof, lens.dof.focus_distance, lens.dof.aperture_fstop = True, 3.0, 0.05
    cycles, mitsuba = both(scene, tmp_path)
    lens.dof.use_dof = False
    sharp = picture(scene, engine.ENGINE, tmp_path)
    errors = [np.abs(blocks(seen) - blocks(cycles)).mean() for seen in (mitsuba, sharp)]
    assert errors[0] < 0.01 and errors[1] > 3 * errors[0]


PRINCIPLED = "ShaderNodeBsdfPrincipled"
MATERIALS = {
    "rough": (PRINCIPLED, {"Base_Color": (0.8, 0.2, 0.1, 1), "Roughness": 0.6}, 0.03),
    "metal": (PRINCIPLED, {"Base_Color": (0.9, 0.7, 0.2, 1), "Roughness": 0.4, "Metallic": 1.0}, 0.08),
    "glass": (PRINCIPLED, {"Base_Color": (0.9, 1, 0.9, 1), "Roughness": 0.0, "Transmission_Weight": 1.0}, 0.05),
    "shining": (PRINCIPLED, {"Emission_Color": (1, 0.3, 0.1, 1), "Emission_Strength": 2.0}, 0.04),
    "half there": (PRINCIPLED, {"Base_Color": (1, 0.4, 0.3, 1), "Alpha": 0.4}, 0.04),
}


def test_materials_look_as_in_cycles(scene, tmp_path):
    """A ball of each, all in one picture; the mean colours of its upper and lower half agree. Those of whole balls of
    metal and of plaster do as well."""
    camera(scene, (0, -9, 0.55), (math.pi / 2, 0, 0))
    background(scene)
    body(plane(30), material("ShaderNodeBsdfDiffuse", Color=GREY))
    light(scene, "AREA", (2, -3, 5), (0.6, 0.3, 0), energy=300, size=5)
    scene.render.resolution_y = 4  # what is above and below the middle of the balls is not looked at
    columns = np.linspace(-2.4, 2.4, len(MATERIALS))
    for x, (kind, values, _) in zip(columns, MATERIALS.values(), strict=True):
        body(sphere(0.5, location=(x, 0, 0.55)), material(kind, **values))
    scene.cycles.samples = scene.dogsplat.samples = 5000  # so many, as the balls light each other
    cycles, mitsuba = both(scene, tmp_path, fine=16)
    centres = (WIDTH * (0.5 + columns / 9 * scene.camera.data.lens / 36)).astype(int)
    for x, (name, (_, _, tolerance)) in zip(centres, MATERIALS.items(), strict=True):
        for top in (0, 2):
            half = np.s_[top : top + 2, x - 2 : x + 2]
            seen, expected = (values[half].mean((0, 1)) for values in (mitsuba, cycles))
            assert np.abs(seen - expected).max() < tolerance * expected.max(), (name, seen, expected)


def test_what_is_half_transparent_loses_no_light(scene, tmp_path):
    """A diffuse ball of which 0.4 is there: its outside, and its inside through it, in a wide lamp's light."""
    camera(scene, (0, -4, 0), (math.pi / 2, 0, 0))
    background(scene, (0.2, 0.2, 0.2, 1))
    light(scene, "AREA", (0, -5, 4), (0.9, 0, 0), energy=1000, size=8)
    half = material("ShaderNodeBsdfDiffuse", Color=(0.8, 0.4, 0.2, 1))
    diffuse, output = half.node_tree.nodes[-1], half.node_tree.nodes[0]
    mixed = link(half.node_tree, "ShaderNodeMixShader", "Shader", output.inputs["Surface"])
    mixed.inputs[0].default_value = 0.4
    link(half.node_tree, "ShaderNodeBsdfTransparent", "BSDF", mixed.inputs[1])
    half.node_tree.links.new(diffuse.outputs[0], mixed.inputs[2])
    body(sphere(1), half)
    scene.cycles.samples = scene.dogsplat.samples = 128
    cycles, mitsuba = (values[8:-8, 16:-16].mean((0, 1)) for values in both(scene, tmp_path))
    assert mitsuba == pytest.approx(cycles, rel=0.03)


@pytest.mark.parametrize("transparent", [False, True])
def test_what_shines_is_seen_and_lamps_are_not(scene, tmp_path, transparent):
    """A lamp that faces the camera, before a screen and beside it."""
    camera(scene, (0, 0, 8))
    background(scene, (0.2, 0.3, 0.4, 1))
    body(plane(2, location=(-1, 0, 0)), material("ShaderNodeEmission", Color=(1, 0.5, 0.25, 1), Strength=0.8))
    light(scene, "AREA", (0, 0, 3), (math.pi, 0, 0), energy=50, size=1)
    scene.render.film_transparent, scene.cycles.samples, scene.dogsplat.samples = transparent, 16, 16
    cycles, ours = (of_fine_pixels(scene, name, tmp_path) for name in ("CYCLES", engine.ENGINE))
    assert cycles[HEIGHT // 2, WIDTH // 2 - 3] == pytest.approx((0.8, 0.4, 0.2, 1), abs=1e-3)
    assert (ours[0, 0, 3] == 0) == transparent
    assert np.abs(ours - cycles).mean() < 5e-3


def test_bodies_are_where_cycles_has_them(scene, tmp_path):
    """Modifiers, mirrored and repeated objects, text, and a material for each face, each by its own light."""
    camera(scene, (0, -8, 0), (math.pi / 2, 0, 0))

    def shining(*color):
        return material("ShaderNodeEmission", Color=(*color, 1), Strength=1.0)

    bpy.ops.mesh.primitive_cube_add(size=1, location=(-2, 0, 1), rotation=(0.4, 0.3, 0.6))
    cube = bpy.context.object
    for k, color in enumerate([(1, 0, 0), (0, 1, 0), (0, 0, 1)]):
        cube.data.materials.append(shining(*color))
        cube.data.polygons[2 * k].material_index = cube.data.polygons[2 * k + 1].material_index = k
    cube.modifiers.new("Array", "ARRAY").count = 2
    mirrored = bpy.data.objects.new("mirrored", cube.data)
    mirrored.location, mirrored.rotation_euler, mirrored.scale = (1.5, 0, -1), (0.4, 0.3, 0.6), (-1, 1, 1.5)
    scene.collection.objects.link(mirrored)
    bpy.ops.object.text_add(location=(0.5, 0, 0.8), rotation=(math.pi / 2, 0, 0))
    body(bpy.context.object, shining(1, 1, 0)).data.body = "F"
    group = bpy.data.collections.new("group")
    group.objects.link(body(plane(0.6, location=(0, 0, 0), rotation=(1.2, 0.4, 0)), shining(0, 1, 1)))
    scene.collection.objects.unlink(bpy.context.object)
    for x in (-2.4, -1.4):
        empty = bpy.data.objects.new("instances", None)
        empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", group, (x, 0, -1)
        scene.collection.objects.link(empty)
    cycles, mitsuba = both(scene, tmp_path)
    assert cycles.std() > 0.2
    difference = np.abs(blocks(mitsuba) - blocks(cycles))
    assert difference.mean() < 0.01 and difference.max() < 0.15


def test_splats_stand_in_the_scene(scene, tmp_path):
    """The picture of a scene with splats has them in front of a wall, and without them the wall alone."""
    place_camera(scene, "square")
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    splats = load(REFERENCES / "square.ply")
    scene.dogsplat.samples = 4
    wall = body(plane(50), material("ShaderNodeEmission", Color=(0, 0, 1, 1), Strength=1.0))
    wall.matrix_world = scene.camera.matrix_world.copy()
    wall.location += scene.camera.matrix_world.to_3x3().col[2] * -20
    background(scene, (0, 0, 0, 1))
    before = picture(scene, engine.ENGINE, tmp_path)
    splats.hide_render = True
    behind = picture(scene, engine.ENGINE, tmp_path)
    assert np.allclose(behind, (0, 0, 1), atol=1e-3)
    assert (np.abs(before - behind).max(-1) > 0.1).mean() > 0.2
    scene.dogsplat.send = "SPLATS"
    splats.hide_render = False
    alone = picture(scene, engine.ENGINE, tmp_path)
    # Over black; a blue wall has neither red nor green. The two are blended in different colour spaces.
    assert alone[..., :2].std() > 0.1
    assert np.corrcoef(blocks(before)[..., :2].ravel(), blocks(alone)[..., :2].ravel())[0, 1] > 0.95
