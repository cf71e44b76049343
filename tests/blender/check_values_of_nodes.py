"""Values that Blender's nodes may have and Mitsuba refuses: they are brought to where they make sense, as by Cycles."""

import bpy
import pytest
from blender_pictures import picture
from surroundings import background, body, camera, link, material, plane, sphere

from blender_addon.cameras.objects import camera_numbers
from blender_addon.engine.settings import ENGINE
from blender_addon.scene.write import Written, write_scene

pytestmark = pytest.mark.usefixtures("by_command")
COLORED = {"BsdfPrincipled": "Base Color", **dict.fromkeys(
    ("BsdfDiffuse", "BsdfGlossy", "BsdfGlass", "BsdfRefraction", "BsdfTranslucent", "BsdfTransparent"), "Color"
)}  # fmt: skip
NUMBERS = {  # what a Value node gives, and what is drawn
    ("BsdfPrincipled", "Metallic"): [(5, 1), (-1, 0)], ("BsdfPrincipled", "Roughness"): [(5, 1), (-1, 0)],
    ("BsdfPrincipled", "Transmission Weight"): [(-1, 0)], ("BsdfPrincipled", "Alpha"): [(5, 1), (-1, 0)],
    ("BsdfPrincipled", "IOR"): [(-1, 1e-5)], ("BsdfPrincipled", "Specular IOR Level"): [(-1, 0)],
    ("BsdfPrincipled", "Coat Weight"): [(-1, 0)], ("BsdfPrincipled", "Sheen Weight"): [(5, 1), (-1, 0)],
    ("BsdfGlossy", "Roughness"): [(5, 1), (-1, 0)], ("BsdfGlass", "Roughness"): [(5, 1), (-1, 0)],
}  # fmt: skip
CASES = [(*of, given, drawn) for of, pairs in NUMBERS.items() for given, drawn in pairs]


def shader_of(made):
    return next(node for node in made.node_tree.nodes if node.type != "OUTPUT_MATERIAL")


def sent(scene, folder) -> Written:
    """What our engine asks for; what is named the same is the same."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return write_scene(depsgraph, None, camera_numbers(scene, scene.camera), folder, 0)


@pytest.mark.parametrize("by_node", [False, True])
@pytest.mark.parametrize("kind", COLORED)
def test_colors_above_1_are_drawn_as_1_and_said(scene, tmp_path, kind, by_node):
    camera(scene, (0, 0, 8))
    background(scene)
    of = material(f"ShaderNode{kind}")
    body(sphere(1.5), of)
    socket = shader_of(of).inputs[COLORED[kind]]
    owner = link(of.node_tree, "ShaderNodeRGB", "Color", socket).outputs[0] if by_node else socket
    owner.default_value = 1, 0.3, 0, 1
    plain = sent(scene, tmp_path)
    owner.default_value = 3, 0.3, 0, 1
    strong = sent(scene, tmp_path)
    assert "colors above 1 are drawn as 1" in "".join(set(strong.notes) - set(plain.notes))
    if kind != "BsdfPrincipled":  # whose colours lose a little to what mirrors
        assert strong.scene == plain.scene
    if not by_node:  # what is drawn is the same
        assert picture(scene, ENGINE, tmp_path).max() > 0.1


def test_light_above_1_stays(scene, tmp_path):
    camera(scene, (0, 0, 8))
    body(plane(20), material("ShaderNodeEmission", Color=(3, 0.3, 0, 1), Strength=2))
    assert not sent(scene, tmp_path).notes
    assert picture(scene, ENGINE, tmp_path)[8, 8] == pytest.approx((6, 0.6, 0), rel=1e-4)


def test_colors_of_a_wider_space_stop_no_render(scene, tmp_path):
    """Pure green of ACEScg has less than no red of Rec. 709, and more than all of its green."""
    if not hasattr(bpy.data, "colorspace"):
        pytest.skip("files have a working space of their own from Blender 5.0 on")
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=True)
    camera(scene, (0, 0, 8))
    background(scene, (1, 1, 1, 1))
    white = material("ShaderNodeBsdfDiffuse", Color=(1, 1, 1, 1))
    body(plane(20), white)
    assert not sent(scene, tmp_path).notes
    shader_of(white).inputs["Color"].default_value = 0, 1, 0, 1
    red, green, blue = picture(scene, ENGINE, tmp_path)[8, 8]
    assert green > 2 * max(red, blue)


@pytest.mark.parametrize(("kind", "name", "given", "drawn"), CASES)
def test_numbers_end_where_those_of_cycles_do(scene, tmp_path, kind, name, given, drawn):
    camera(scene, (0, 0, 8))
    background(scene)
    of = material(f"ShaderNode{kind}")
    body(sphere(1.5), of)
    value = link(of.node_tree, "ShaderNodeValue", "Value", shader_of(of).inputs[name]).outputs[0]
    value.default_value = drawn
    expected = sent(scene, tmp_path)
    value.default_value = given
    assert sent(scene, tmp_path).scene == expected.scene


def test_a_mixture_has_no_share_beyond_its_shaders(scene, tmp_path):
    camera(scene, (0, 0, 8))
    background(scene)
    of = material("ShaderNodeBsdfDiffuse")
    tree, first = of.node_tree, shader_of(of)
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    mixing = link(tree, "ShaderNodeMixShader", "Shader", output.inputs["Surface"])
    second = link(tree, "ShaderNodeBsdfGlossy", "BSDF", mixing.inputs[2])
    tree.links.new(first.outputs[0], mixing.inputs[1])
    value = link(tree, "ShaderNodeValue", "Value", mixing.inputs[0]).outputs[0]
    second.inputs["Roughness"].default_value = 0.5
    body(sphere(1.5), of)
    for given, drawn in ((7, 1), (-7, 0)):
        value.default_value = drawn
        expected = sent(scene, tmp_path)
        value.default_value = given
        assert sent(scene, tmp_path).scene == expected.scene
