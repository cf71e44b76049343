"""Pictures of the world are turned as in Cycles, and what else nodes do with them is said."""

import math

import numpy as np
import pytest
from blender_pictures import of_fine_pixels
from surroundings import background, blocks, camera, image, link

from blender_addon.engine.settings import ENGINE
from blender_addon.scene.export import Export
from blender_addon.scene.world import is_plain, world_light


def sky(scene):
    """(node tree, node of the picture) of a new world."""
    node = background(scene)
    tree = scene.world.node_tree
    found = link(tree, "ShaderNodeTexEnvironment", "Color", node.inputs["Color"])
    found.image = image("sky", lambda x, y: (x, y, 0.3 + 0.4 * (x > 0.4)), True)
    return tree, found


def mapped(scene, kind="POINT", **values):
    """(node tree, node of the mapping), which takes directions."""
    tree, found = sky(scene)
    mapping = link(tree, "ShaderNodeMapping", "Vector", found.inputs["Vector"])
    mapping.vector_type = kind
    for name, value in values.items():
        mapping.inputs[name].default_value = value
    link(tree, "ShaderNodeTexCoord", "Generated", mapping.inputs["Vector"])
    return tree, mapping


@pytest.mark.usefixtures("by_command")
@pytest.mark.parametrize("kind, scale", [
    ("POINT", (2, 2, 2)), ("POINT", (-1, 1, 1)), ("VECTOR", (1, -1, 1)), ("TEXTURE", (1, 1, -1)),
    ("TEXTURE", (1, 1, 1)),
])  # fmt: skip
def test_a_picture_of_the_world_is_mirrored_as_in_cycles(scene, tmp_path, kind, scale):
    """And turned besides."""
    camera(scene, (0, 0, 0), (math.radians(100), 0.2, 0.4)).data.lens = 12
    mapped(scene, kind, Rotation=(0.3, 0.2, 1), Scale=scale)
    scene.render.filter_size = scene.cycles.filter_width = 0.01
    cycles, ours = (blocks(of_fine_pixels(scene, engine, tmp_path)[..., :3]) for engine in ("CYCLES", ENGINE))
    assert cycles.std() > 0.1
    assert np.abs(ours - cycles).mean() < 0.01


def notes_of(scene, tmp_path):
    """What is said of a world, without its name."""
    export = Export(tmp_path)
    world_light(export, scene.world)
    return [note.removeprefix(f'"{scene.world.name}": ') for note in export.notes]


@pytest.mark.parametrize("values", [{"Location": (0.5, 0, 0)}, {"Scale": (1, 2, 1)}, {"Scale": (0, 0, 0)}])
def test_mappings_that_no_rotation_is_are_said(scene, tmp_path, values):
    _, mapping = mapped(scene, Rotation=(0, 0, 1))
    assert notes_of(scene, tmp_path) == []
    for name, value in values.items():
        mapping.inputs[name].default_value = value
    assert notes_of(scene, tmp_path) == [f'of the mapping "{mapping.name}" only the rotation is drawn']


def test_what_a_mapping_is_linked_to_is_said(scene, tmp_path):
    """As of those of materials; one that takes no direction turns nothing."""
    tree, mapping = mapped(scene)
    link(tree, "ShaderNodeCombineXYZ", "Vector", mapping.inputs["Rotation"])
    assert notes_of(scene, tmp_path) == ['what "Rotation" of a mapping is linked to is left out']
    tree.links.remove(mapping.inputs["Rotation"].links[0])
    tree.links.remove(mapping.inputs["Vector"].links[0])
    assert notes_of(scene, tmp_path) == [f'the mapping "{mapping.name}" is left out']


@pytest.mark.parametrize("kind, output", [
    ("ShaderNodeVectorRotate", "Vector"), ("ShaderNodeTexCoord", "Window"), ("ShaderNodeTexCoord", "Camera"),
    ("ShaderNodeNewGeometry", "Incoming"),
])  # fmt: skip
def test_pictures_of_the_world_that_no_direction_looks_up_are_said(scene, tmp_path, kind, output):
    tree, found = sky(scene)
    link(tree, "ShaderNodeTexCoord", "Object", found.inputs["Vector"])
    assert notes_of(scene, tmp_path) == []
    other = link(tree, kind, output, found.inputs["Vector"])
    assert notes_of(scene, tmp_path) == [
        f'the picture of the world is looked up by directions, instead of "{other.name}"'
    ]


def test_a_world_of_an_image_texture_has_the_color_of_its_socket(scene, tmp_path):
    """It is not black, and a note says so."""
    node = background(scene, (0.2, 0.4, 0.6, 1))
    node.inputs["Strength"].default_value = 2.0
    picture = link(scene.world.node_tree, "ShaderNodeTexImage", "Color", node.inputs["Color"])
    picture.image = image("sky", lambda x, y: (x, y, x))
    assert world_light(Export(tmp_path), scene.world)["radiance"]["value"] == pytest.approx([0.4, 0.8, 1.2])
    (note,) = notes_of(scene, tmp_path)
    assert f'"{picture.name}" has no counterpart' in note


def test_a_world_that_not_all_rays_see_is_said_to_be_seen(scene, tmp_path):
    background(scene)
    assert notes_of(scene, tmp_path) == []
    scene.world.cycles_visibility.camera = False
    assert notes_of(scene, tmp_path) == ["its Ray Visibility is ignored"]


def test_a_picture_that_no_link_takes_is_no_part_of_the_world(scene):
    """So that splats before it are rendered alone."""
    tree, found = sky(scene)
    assert not is_plain(scene.world)
    found.mute = True
    assert is_plain(scene.world)
    found.mute = False
    tree.links.remove(found.outputs["Color"].links[0])
    assert is_plain(scene.world)
    scene.world = None
    assert is_plain(scene.world)
