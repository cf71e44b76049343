"""The scene around the splats as a file of Mitsuba's: what is written once, and what has no counterpart."""

import json

import bpy
import pytest
from blender_pictures import with_alpha
from model_files import load
from references import REFERENCES
from scattering import scattering
from surroundings import GREY, background, body, camera, image, light, link, material, plane, sphere

from blender_addon.cameras.objects import camera_numbers
from blender_addon.engine.settings import ENGINE
from blender_addon.nodes.modifier import set_input, splat_modifier
from blender_addon.scene.export import Export
from blender_addon.scene.images import bitmap
from blender_addon.scene.write import write_scene


def written(scene, tmp_path):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    result = write_scene(depsgraph, None, camera_numbers(scene, scene.camera), tmp_path, 0)
    return result, json.loads((tmp_path / result.scene).read_text())


def test_what_has_no_counterpart_is_drawn_in_its_viewport_colour_and_said(scene, tmp_path):
    camera(scene, (0, 0, 8))
    strange = body(plane(2), material("ShaderNodeBsdfHair")).data.materials[0]
    strange.diffuse_color = (0.25, 0.5, 0.75, 1)
    result, described = written(scene, tmp_path)
    (note,) = result.notes
    assert strange.name in note and "viewport" in note
    (drawn,) = [value for key, value in described.items() if key.startswith("material_")]
    assert drawn["bsdf"]["base_color"]["value"] == pytest.approx([0.24, 0.48, 0.72])  # but what its gloss takes


def test_muted_nodes_do_what_they_do_in_blender(scene, tmp_path):
    """A link goes through them, or none; one that turns a texture turns none."""
    camera(scene, (0, 0, 8))
    tree = body(plane(2), material("ShaderNodeBsdfDiffuse", Color=GREY)).data.materials[0].node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_DIFFUSE")
    hue = link(tree, "ShaderNodeHueSaturation", "Color", shader.inputs["Color"])
    texture = link(tree, "ShaderNodeTexImage", "Color", hue.inputs["Color"])
    mapping = link(tree, "ShaderNodeMapping", "Vector", texture.inputs["Vector"])
    mapping.inputs["Scale"].default_value = (3, 3, 3)
    texture.image = image("picture", lambda x, y: (x, y, x))
    hue.mute = mapping.mute = True
    result, described = written(scene, tmp_path)
    (drawn,) = [value for key, value in described.items() if key.startswith("material_")]
    assert drawn["bsdf"]["reflectance"]["type"] == "bitmap" and "to_uv" not in drawn["bsdf"]["reflectance"]
    assert result.notes == []
    texture.mute = True
    (drawn,) = [value for key, value in written(scene, tmp_path)[1].items() if key.startswith("material_")]
    assert drawn["bsdf"]["reflectance"]["value"] == pytest.approx(GREY[:3])


@pytest.mark.parametrize("kind", ["Diffuse", "Glossy", "Glass", "Translucent", "Principled"])
def test_bent_normals_are_drawn_or_said_to_be_straight(scene, tmp_path, kind):
    """Of what transmits everything they are straight."""
    camera(scene, (0, 0, 8))
    shader = "ShaderNodeBsdfAnisotropic" if kind == "Glossy" else f"ShaderNodeBsdf{kind}"
    tree = body(plane(2), material(shader)).data.materials[0].node_tree
    (node,) = [node for node in tree.nodes if node.bl_idname == shader]
    if kind == "Principled":
        node.inputs["Transmission Weight"].default_value = 1.0
    normal = link(tree, "ShaderNodeNormalMap", "Normal", node.inputs["Normal"])
    link(tree, "ShaderNodeTexImage", "Color", normal.inputs["Color"]).image = image("map", lambda x, y: (x, y, x))
    result, described = written(scene, tmp_path)
    (drawn,) = [value for key, value in described.items() if key.startswith("material_")]
    bends = kind in ("Diffuse", "Glossy")
    assert (drawn.get("bsdf", {}).get("type") == "normalmap") is bends
    assert any("does not bend normals" in note for note in result.notes) is not bends


def test_tints_of_principled_are_said_where_they_tint(scene, tmp_path):
    camera(scene, (0, 0, 8))
    tree = body(plane(2), material("ShaderNodeBsdfPrincipled")).data.materials[0].node_tree
    inputs = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED").inputs
    inputs["Coat Tint"].default_value = inputs["Sheen Tint"].default_value = (1, 0, 0, 1)
    inputs["Sheen Weight"].default_value = inputs["Coat Weight"].default_value = 0.0
    assert written(scene, tmp_path)[0].notes == []
    inputs["Coat Weight"].default_value = 1.0
    (note,) = written(scene, tmp_path)[0].notes
    assert '"Coat Tint" is left out' in note


@pytest.mark.parametrize("bent, said", [(["Normal"], 1), (["Coat Normal"], 1), (["Normal", "Coat Normal"], 0)])
def test_normals_that_a_coat_has_alone_or_has_not_are_said(scene, tmp_path, bent, said):
    """Of a coat that is there: Mitsuba has one map of normals for both."""
    camera(scene, (0, 0, 8))
    tree = body(plane(2), material("ShaderNodeBsdfPrincipled")).data.materials[0].node_tree
    inputs = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED").inputs
    normal = link(tree, "ShaderNodeNormalMap", "Normal", inputs[bent[0]])
    link(tree, "ShaderNodeTexImage", "Color", normal.inputs["Color"]).image = image("map", lambda x, y: (x, y, x))
    tree.links.new(normal.outputs[0], inputs[bent[-1]])
    assert written(scene, tmp_path)[0].notes == []
    inputs["Coat Weight"].default_value = 1.0
    notes = written(scene, tmp_path)[0].notes
    assert len(notes) == said and all("its coat has the normals of what is below it" in note for note in notes)


def test_of_several_outputs_the_one_for_cycles_is_drawn(scene, tmp_path):
    """Though that for EEVEE is the active one."""
    camera(scene, (0, 0, 8))
    tree = body(plane(2), material("ShaderNodeEmission")).data.materials[0].node_tree
    (first,) = [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL"]
    second = tree.nodes.new("ShaderNodeOutputMaterial")
    link(tree, "ShaderNodeBsdfDiffuse", "BSDF", second.inputs["Surface"]).inputs["Color"].default_value = GREY
    second.target, first.target, first.is_active_output = "CYCLES", "EEVEE", True
    (drawn,) = [value for key, value in written(scene, tmp_path)[1].items() if key.startswith("material_")]
    assert drawn["bsdf"]["reflectance"]["value"] == pytest.approx(GREY[:3])


def test_the_material_of_the_view_layer_is_that_of_all_bodies(scene, tmp_path):
    """Also where an object has several of its own, or none."""
    camera(scene, (0, 0, 8))
    both = body(body(plane(2), material("ShaderNodeBsdfDiffuse", Color=GREY)), material("ShaderNodeEmission"))
    both.data.polygons[0].material_index = 1
    plane(1)
    clay = material("ShaderNodeBsdfDiffuse", Color=(0.25, 0.5, 0.75, 1))
    assert sum(key.startswith("material_") for key in written(scene, tmp_path)[1]) == 2
    bpy.context.view_layer.material_override = clay
    (drawn,) = [value for key, value in written(scene, tmp_path)[1].items() if key.startswith("material_")]
    assert drawn["bsdf"]["reflectance"]["value"] == pytest.approx([0.25, 0.5, 0.75])


def test_a_portal_of_cycles_is_no_lamp(scene, tmp_path):
    """Nor is the mark of one on a lamp that is no area, where Cycles looks at none."""
    camera(scene, (0, 0, 8))
    plane(2)
    lamps = [light(scene, kind, energy=10) for kind in ("AREA", "AREA", "POINT")]
    lamps[0].data.cycles.is_portal = lamps[2].data.cycles.is_portal = True
    result, described = written(scene, tmp_path)
    shining = sorted(value["type"] for key, value in described.items() if key.startswith("light_"))
    assert len(shining) == 2 and "rectangle" in shining and result.notes == []


def test_a_shadow_catcher_and_rays_that_are_not_told_apart_are_said(scene, model, tmp_path):
    """Of splats and lamps too, but not of what is hidden."""
    camera(scene, (0, 0, 8))
    wall, splats, lamp, hidden = plane(2), load(model), light(scene, "POINT"), plane(1)
    assert written(scene, tmp_path)[0].notes == []
    wall.visible_camera = False
    wall.is_shadow_catcher = hidden.is_shadow_catcher = hidden.hide_viewport = True
    lamp.visible_diffuse = splats.visible_shadow = False
    notes = written(scene, tmp_path)[0].notes
    assert len(notes) == 3 and f'"{wall.name}": a shadow catcher is drawn as any other object' in notes
    assert {f'"{obj.name}": of Ray Visibility, only Camera has an effect' for obj in (lamp, splats)} < set(notes)


def test_hair_fog_light_linking_and_lights_without_shadows_are_said(scene, tmp_path):
    """Once each, and particles that are no hair are not."""
    camera(scene, (0, 0, 8))
    wall, lamp, linked = plane(2), light(scene, "POINT", energy=10), light(scene, "SUN", energy=1)
    for kind in ("EMITTER", "HAIR"):
        wall.modifiers.new(kind, "PARTICLE_SYSTEM").particle_system.settings.type = kind
    lamp.data.use_shadow = False
    linked.light_linking.receiver_collection = bpy.data.collections.new("receivers")
    background(scene)
    world = scene.world
    output = next(node for node in world.node_tree.nodes if node.type == "OUTPUT_WORLD")
    link(world.node_tree, "ShaderNodeVolumeScatter", "Volume", output.inputs["Volume"])
    assert sorted(written(scene, tmp_path)[0].notes) == sorted([
        f'"{wall.name}": its hair is left out',
        f'"{linked.name}": its light linking is left out',
        f'"{lamp.data.name}": a light without shadows casts shadows here',
        f'"{world.name}": its volume is left out',
    ])  # fmt: skip


@pytest.mark.parametrize("source, word", [("TILED", "tiles"), ("SEQUENCE", "frames"), ("FILE", "")])
def test_an_image_of_many_pictures_is_said_to_be_one(tmp_path, source, word):
    picture = image("many.0000", lambda x, y: (x, y, x))
    picture.filepath_raw, picture.file_format = str(tmp_path / "many.0000.png"), "PNG"
    picture.save()
    picture.source = source
    export = Export(tmp_path)
    assert bitmap(export, picture)["type"] == "bitmap"
    assert export.notes == ([f'of the {word} of the image "many.0000" only one is drawn'] if word else [])


@pytest.mark.parametrize("space, raw, said", [
    ("sRGB", False, ""), ("Linear Rec.709", True, ""), ("Non-Color", True, ""), ("Filmic sRGB", False, "sRGB"),
    ("ACEScg", True, "Linear Rec.709"),
])  # fmt: skip
def test_bytes_of_other_color_spaces_are_drawn_as_the_nearest_and_said(tmp_path, space, raw, said):
    """Curved numbers are never taken for linear light."""
    picture, export = image("picture", lambda x, y: (x, y, x)), Export(tmp_path)
    picture.colorspace_settings.name = space
    assert bitmap(export, picture)["raw"] is raw
    assert export.notes == ([f'the image "picture" is drawn as one in {said}, not in {space}'] if said else [])


def test_uv_maps_that_are_not_rendered_and_projections_are_said(scene, tmp_path):
    """Of two meshes with a material the second has no map of that name."""
    camera(scene, (0, 0, 8))
    wall = body(plane(2), material("ShaderNodeBsdfDiffuse", Color=GREY))
    tree = wall.data.materials[0].node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_DIFFUSE")
    texture = link(tree, "ShaderNodeTexImage", "Color", shader.inputs["Color"])
    texture.image = image("picture", lambda x, y: (x, y, x))
    chosen = link(tree, "ShaderNodeUVMap", "UV", texture.inputs["Vector"])
    chosen.uv_map = wall.data.uv_layers[0].name
    assert written(scene, tmp_path)[0].notes == []
    chosen.uv_map = wall.data.uv_layers.new(name="second").name
    problem = f'"{texture.name}" takes the texture coordinates of the mesh, instead of "{chosen.name}"'
    owner = wall.data.materials[0].name
    assert written(scene, tmp_path)[0].notes == [f'"{owner}": {problem}']
    wall.data.uv_layers["second"].active_render = True
    assert written(scene, tmp_path)[0].notes == []
    body(plane(1), wall.data.materials[0])
    assert written(scene, tmp_path)[0].notes == [f'"{owner}": {problem}']
    texture.projection = "BOX"
    assert any("not projected" in note for note in written(scene, tmp_path)[0].notes)


def test_what_blender_draws_itself_is_not_said_to_be_left_out(scene, tmp_path):
    """Grease Pencil, over the picture of any engine."""
    camera(scene, (0, 0, 8))
    plane(2)
    kinds = [name for name in ("grease_pencil_add", "gpencil_add") if name in dir(bpy.ops.object)]
    getattr(bpy.ops.object, kinds[0])(type="STROKE")
    assert written(scene, tmp_path)[0].notes == []


def test_geometry_that_is_repeated_is_written_once(scene, tmp_path):
    camera(scene, (0, 0, 8))
    first = body(sphere(0.5), material("ShaderNodeBsdfDiffuse", Color=GREY))
    for k in range(3):
        copy = bpy.data.objects.new(f"copy {k}", first.data)
        copy.location.x = k
        scene.collection.objects.link(copy)
    lamp = light(scene, "POINT", energy=1, shadow_soft_size=0.1)
    result, described = written(scene, tmp_path)
    assert result.hide_lamps
    lamp.data.shadow_soft_size = 0
    assert not written(scene, tmp_path)[0].hide_lamps
    kinds = [value["type"] for value in described.values()]
    assert kinds.count("shapegroup") == 1 and kinds.count("instance") == 4 and len(result.files) == 2
    assert [of.name for of in result.objects] == [first.name, "copy 0", "copy 1", "copy 2"]


def test_what_stands_on_splats_is_a_body(scene, tmp_path):
    """Instances that a model makes of another object, after what draws it: its quads have four corners each."""
    camera(scene, (0, 0, 8))
    obj = load(REFERENCES / "dog.ply")
    set_input(splat_modifier(obj), "Show As", "Quads")
    flower = plane(0.1)
    flower.hide_viewport = True
    obj.modifiers.new("flowers", "NODES").node_group = scattering(flower)
    _, described = written(scene, tmp_path)
    assert sum(shape.get("type") == "instance" for shape in described.values()) == 4 * len(obj.data.vertices)


def test_a_mesh_without_faces_is_no_shape(scene, by_command, tmp_path):
    """Nor where it is repeated, of which Mitsuba would load nothing."""
    camera(scene, (0, 0, 8))
    body(plane(20), material("ShaderNodeBsdfDiffuse", Color=GREY))
    edges = bpy.data.meshes.new("edges")
    edges.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    for _ in range(2):
        scene.collection.objects.link(bpy.data.objects.new("edges", edges))
    assert [key for key in written(scene, tmp_path)[1] if key.startswith("object_")] == ["object_0_0_0"]
    assert with_alpha(scene, ENGINE, tmp_path)[..., 3].min() > 0.9


def test_text_and_metaballs_are_written_once_each_as_modifiers_leave_them(scene, tmp_path):
    """Of two objects with one text the first is repeated three times."""
    camera(scene, (0, 0, 8))
    text = bpy.data.curves.new("text", "FONT")
    text.body = "H"
    for name in ("first", "second"):
        scene.collection.objects.link(bpy.data.objects.new(name, text))
    bpy.ops.object.metaball_add(type="BALL")
    ball = bpy.context.object.name
    bpy.data.objects["first"].modifiers.new("array", "ARRAY").count = 3
    result, described = written(scene, tmp_path)
    faces = {}
    for name, shape in described.items():
        if shape.get("type") == "ply":
            header = (tmp_path / shape["filename"]).read_bytes().split(b"end_header")[0].decode()
            number = int(name.split("_")[1])
            faces.setdefault(result.objects[number].name, []).append(int(header.split("element face ")[1].split()[0]))
    assert not any(shape["type"] == "instance" for shape in described.values())
    (first,), (second,) = faces["first"], faces["second"]
    assert first == 3 * second and len(faces[ball]) == 1
