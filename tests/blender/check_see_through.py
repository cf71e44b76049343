"""Surfaces through which something else is seen: as much of it, and of what they emit, as in Cycles."""

import bpy
import numpy as np
import pytest
from blender_pictures import of_fine_pixels
from model_files import load
from references import REFERENCES
from surroundings import GREY, background, body, camera, image, light, link, material, plane, sphere

from blender_addon.cameras.objects import camera_numbers
from blender_addon.engine.settings import ENGINE
from blender_addon.scene.write import write_scene

PRINCIPLED = {"Alpha": 0.25, "Emission_Color": (0.8, 0.2, 0.3, 1), "Emission_Strength": 1.0,
              "Base_Color": (0, 0, 0, 1), "Specular_IOR_Level": 0.0}  # fmt: skip
pytestmark = pytest.mark.usefixtures("by_command")


def bare(tree):
    """The node for the output of a material, without its shader."""
    tree.nodes.remove(next(node for node in tree.nodes if node.type != "OUTPUT_MATERIAL"))
    return tree.nodes[0].inputs


def both(scene, folder, of, sky=(0.3, 0.5, 0.2, 1), samples=64):
    """(by Cycles, by Mitsuba): a square of a material before a grey one, [3, 3, 3] each where both are seen."""
    camera(scene, (0, 0, 8))
    scene.cycles.samples = scene.dogsplat.samples = samples
    background(scene, sky)
    body(plane(2), of)
    body(plane(20, location=(0, 0, -2)), material("ShaderNodeBsdfDiffuse", Color=GREY))
    seen = (of_fine_pixels(scene, engine, folder)[10:-10, 18:-18, :3] for engine in ("CYCLES", ENGINE))
    return [values.reshape(3, 4, 3, 4, 3).mean((1, 3)) for values in seen]


def test_a_body_of_fog_alone_has_no_surface(scene, tmp_path):
    """Its fog is left out, which a note says; a lamp lights what is behind it."""
    fog = material("ShaderNodeEmission")
    link(fog.node_tree, "ShaderNodeVolumeScatter", "Volume", bare(fog.node_tree)["Volume"])
    fog.node_tree.nodes[-1].inputs["Density"].default_value = 0.0
    light(scene, "POINT", (0, 0, 1), energy=50, shadow_soft_size=0)
    cycles, ours = both(scene, tmp_path, fog)
    assert cycles.min() > 0.1
    assert ours == pytest.approx(cycles, abs=0.01)


def has_sheet(scene, folder):
    """Names of what is said to be a sheet of glass."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    notes = write_scene(depsgraph, None, camera_numbers(scene, scene.camera), folder, 0).notes
    return [note.split('"')[1] for note in notes if "sheet of glass" in note]


def mixed(share, first, second, **values):
    """(material, node that mixes, both shaders); the values are those of the one that shines."""
    made = material(SHINING)
    tree = made.node_tree
    inputs = bare(tree)
    mixing = link(tree, "ShaderNodeMixShader", "Shader", inputs["Surface"])
    mixing.inputs[0].default_value = share
    nodes = [tree.nodes.new(kind) for kind in (first, second)]
    for node, socket in zip(nodes, mixing.inputs[1:], strict=True):
        tree.links.new(node.outputs[0], socket)
        for name, value in values.items() if node.type == "EMISSION" else ():
            node.inputs[name].default_value = value
    return made, mixing, nodes


GLOW = {"Color": (0.8, 0.1, 0.3, 1), "Strength": 1.5}
CLEAR, SHINING, WHITE = "ShaderNodeBsdfTransparent", "ShaderNodeEmission", "ShaderNodeBsdfDiffuse"


@pytest.mark.parametrize("order", [(CLEAR, SHINING), (SHINING, CLEAR)])
def test_what_shines_and_is_there_in_part_shines_in_part(scene, tmp_path, order):
    """What is behind it is seen through it once, though it shines to both sides."""
    cycles, ours = both(scene, tmp_path, mixed(0.25, *order, **GLOW)[0])
    assert np.abs(ours - cycles).max() < 0.01


def test_the_light_of_principled_has_its_alpha(scene, tmp_path):
    cycles, ours = both(scene, tmp_path, material("ShaderNodeBsdfPrincipled", **PRINCIPLED))
    assert np.abs(ours - cycles).max() < 0.01


def pictured(made, shining, is_float=False):
    """An image that is there more and more to the right, in the socket of a colour."""
    texture = link(made.node_tree, "ShaderNodeTexImage", "Color", shining.inputs["Color"])
    if is_float:  # which Blender has multiplied by alpha
        texture.image = image("picture", lambda x, y: (x * x, x * y, 0.5 * x, x), True)
    else:
        texture.image = image("picture", lambda x, y: (x, y, 0.5 + 0 * x, x))
    return texture


def test_a_shining_picture_is_cut_out_by_its_alpha(scene, tmp_path):
    """As Blender's own import of images as planes makes it."""
    made, mixing, (_, shining) = mixed(0.5, CLEAR, SHINING)
    texture = pictured(made, shining)
    made.node_tree.links.new(texture.outputs["Alpha"], mixing.inputs[0])
    cycles, ours = both(scene, tmp_path, made)
    assert np.ptp(cycles[..., 0]) > 0.2
    assert np.abs(ours - cycles).max() < 0.02


def test_a_shining_picture_that_is_mixed_with_another_shader_shines_in_part(scene, tmp_path):
    made, _, (_, shining) = mixed(0.25, WHITE, SHINING)
    texture = pictured(made, shining)
    texture.image.alpha_mode = "NONE"
    cycles, ours = both(scene, tmp_path, made)
    assert np.abs(ours - cycles).max() < 0.02


@pytest.mark.parametrize("order", [(CLEAR, SHINING), (SHINING, CLEAR)])
def test_light_that_is_added_to_nothing_hides_nothing(scene, tmp_path, order):
    """Whichever socket it is in."""
    made = material(SHINING)
    inputs = bare(made.node_tree)
    adding = link(made.node_tree, "ShaderNodeAddShader", "Shader", inputs["Surface"])
    for kind, socket in zip(order, adding.inputs, strict=True):
        node = link(made.node_tree, kind, "BSDF" if kind == CLEAR else "Emission", socket)
        if kind == SHINING:
            node.inputs["Color"].default_value = (0.2, 0.1, 0.3, 1)
    cycles, ours = both(scene, tmp_path, made)
    assert cycles[..., 1].min() > 0.2
    assert np.abs(ours - cycles).max() < 0.01


@pytest.mark.parametrize("kind", ["linked", "colored", "picture", "mixed"])
def test_a_transparent_shader_has_its_color(scene, tmp_path, kind):
    """Whoever gives it, and mixed with another shader."""
    made, mixing, (clear, _) = mixed(0.3 if kind == "mixed" else 0.0, CLEAR, WHITE)
    clear.inputs["Color"].default_value = (0.9, 0.3, 0.1, 1)
    if kind == "linked":
        given = link(made.node_tree, "ShaderNodeRGB", "Color", clear.inputs["Color"])
        given.outputs[0].default_value = (0.8, 0.8, 0.8, 1)
    elif kind == "picture":
        pictured(made, clear).image.alpha_mode = "NONE"
    cycles, ours = both(scene, tmp_path, made)
    assert cycles.max() > 0.04
    assert np.abs(ours - cycles).max() < 0.02


@pytest.mark.parametrize("splats", [False, True])
@pytest.mark.parametrize("kind", ["grey", "colored", "mixed"])
def test_behind_what_is_transparent_a_transparent_film_shows_nothing(scene, tmp_path, kind, splats):
    """Alpha says how much would be seen there. Splats are beside the picture."""
    camera(scene, (0, 0, 8))
    scene.cycles.samples = scene.dogsplat.samples = 64
    background(scene, (0.3, 0.5, 0.2, 1))
    scene.render.film_transparent = True
    made, _, (clear, _) = mixed(0.3 if kind == "mixed" else 0.0, CLEAR, WHITE)
    clear.inputs["Color"].default_value = (0.6, 0.6, 0.6, 1) if kind == "grey" else (0.9, 0.3, 0.1, 1)
    body(plane(20), made)
    if splats:
        load(REFERENCES / "plain.ply").location = 30, 0, 0
    cycles, ours = (of_fine_pixels(scene, engine, tmp_path).mean(axis=(0, 1)) for engine in ("CYCLES", ENGINE))
    assert 0.2 < cycles[3] < 0.8
    assert ours == pytest.approx(cycles, abs=0.01)


@pytest.mark.parametrize("kind, mode", [
    ("PNG", "STRAIGHT"), ("PNG", "CHANNEL_PACKED"), ("PNG", "NONE"), ("OPEN_EXR", "PREMUL"), ("OPEN_EXR", "NONE"),
])  # fmt: skip
@pytest.mark.parametrize("alpha_used", [False, True])
def test_colors_of_pictures_have_the_alpha_that_they_have_in_cycles(scene, tmp_path, kind, mode, alpha_used):
    """Where nothing else of the material takes it, what is transparent in a picture is black, whatever it hides."""
    made, mixing, (_, shining) = mixed(0.99, WHITE, SHINING)
    texture = pictured(made, shining, kind == "OPEN_EXR")
    texture.image.filepath_raw, texture.image.file_format = str(tmp_path / "picture"), kind
    texture.image.save()
    texture.image = bpy.data.images.load(texture.image.filepath_raw)
    texture.image.alpha_mode = mode
    texture.image.colorspace_settings.name = "sRGB" if kind == "PNG" else "Linear Rec.709"
    if alpha_used:
        diffuse = mixing.inputs[1].links[0].from_node
        made.node_tree.links.new(texture.outputs["Alpha"], diffuse.inputs["Color"])
    cycles, ours = both(scene, tmp_path, made)
    assert np.abs(ours - cycles).max() < 0.02


@pytest.mark.parametrize("kind", ["ShaderNodeBsdfGlass", "ShaderNodeBsdfPrincipled", "ShaderNodeBsdfDiffuse"])
def test_glass_without_thickness_is_said_to_change_the_brightness(scene, tmp_path, kind):
    """Which it does by the square of its index; of what encloses something, split or not, nothing is said."""
    camera(scene, (0, 0, 8))
    glass = material(kind, **({"Transmission_Weight": 0.5} if "Principled" in kind else {}))
    pane = body(plane(2), glass)
    body(sphere(1), glass)
    body(sphere(1), glass).modifiers.new("Split", "EDGE_SPLIT").split_angle = 0.0
    assert has_sheet(scene, tmp_path) == ([pane.name] if "Diffuse" not in kind else [])
    pane.modifiers.new("Solidify", "SOLIDIFY").thickness = 0.1
    assert has_sheet(scene, tmp_path) == []


@pytest.mark.parametrize("color", [(1, 1, 1, 1), (0.9, 0.3, 0.1, 1)])
@pytest.mark.parametrize("kind, values", [
    ("POINT", {"energy": 800, "shadow_soft_size": 0}),
    ("SUN", {"energy": 3, "angle": 0.01}),
])  # fmt: skip
def test_its_shade_is_of_what_it_keeps_of_a_lamp(scene, tmp_path, kind, values, color):
    """Without noise: lamps that are small, or have no size, are hardly ever found by scattered rays."""
    made, _, (clear, _) = mixed(0.3, CLEAR, WHITE)
    clear.inputs["Color"].default_value = color
    light(scene, kind, (0.5, 0, 4), (0, 0, 0), **values)
    cycles, ours = both(scene, tmp_path, made, sky=(0, 0, 0, 1), samples=192)
    assert cycles[..., 0].min() > 0.3
    assert np.abs(ours - cycles).max() < 0.02 * cycles.max()
