"""Working spaces of Blender 5: splats, and all that goes to the package and comes back, have the colours of Rec. 709.

Oracle: what the same file shows in Linear Rec.709. Blender itself converts the colours of the rest to five decimals.
"""

import bpy
import numpy as np
import pytest
from blender_pictures import EEVEE, picture
from drawn_panels import drawn
from edits import paint, shown
from model_files import export, load
from model_values import assert_equal
from package_command import by_package
from references import REFERENCES, place_camera
from surroundings import background, body, camera, image, light, link, material, plane, sphere

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.engine.order import make_order
from blender_addon.files.ply import read_ply
from blender_addon.nodes.modifier import get_input, input_property, set_input, splat_modifier
from blender_addon.nodes.suited import is_suited
from blender_addon.objects.working_space import CONVERTS_ATTRIBUTES, from_working, to_working
from blender_addon.render_engine import ENGINE
from blender_addon.training.borrowed import Borrowed

ROUNDED = 2e-5  # what five decimals leave of a colour below one
OTHER, CHANGED = "Blender draws colors of another working space", "Working space changed: import the model again"


@pytest.fixture(params=["ACEScg", "Linear Rec.2020"])
def space(request):
    """Another one."""
    if not hasattr(bpy.data, "colorspace"):
        pytest.skip("files have a working space of their own from Blender 5.0 on")
    return request.param


def choose(space):
    if bpy.data.colorspace.working_space == space:  # which Blender would refuse
        return
    assert bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=True) == {"FINISHED"}
    bpy.context.view_layer.update()


def imported(scene, name, space=None):
    """A model before its camera, by linear colours and without noise, in a file of that space."""
    scene.view_settings.view_transform = "Standard"
    if space is not None:
        choose(space)
    place_camera(scene, "dog")
    obj = load(REFERENCES / f"{name}.ply")
    bpy.ops.dogsplat.exact_settings()
    set_input(splat_modifier(obj), "Linear Colors", name != "linear")
    obj.update_tag()
    return obj


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("name", ["dog", "linear"])
def test_cycles_draws_the_same_light_whenever_the_space_is_chosen(scene, space, name, when, tmp_path):
    if when == "before" and CONVERTS_ATTRIBUTES:
        pytest.skip("this Blender converts the coefficients; from 5.2 on it does not")
    obj = imported(scene, name)
    expected = picture(scene, "CYCLES", tmp_path)
    if when == "after":
        bpy.data.objects.remove(obj)
        obj = imported(scene, name, space)
    else:
        choose(space)
    found = picture(scene, "CYCLES", tmp_path)
    assert is_suited(obj) and np.abs(from_working(found) - expected).max() < 1e-5
    assert np.abs(found - expected).max() > 0.1
    choose("Linear Rec.709")
    if not CONVERTS_ATTRIBUTES:
        assert is_suited(obj) and np.array_equal(picture(scene, "CYCLES", tmp_path), expected)


@pytest.mark.parametrize("space", ["ACEScg"], indirect=True)
def test_eevee_does_too(scene, space, tmp_path):
    """In half floats, and without what is below zero. One space will do: on a processor each takes 10 s."""
    obj = imported(scene, "plain")
    expected = picture(scene, EEVEE, tmp_path)
    bpy.data.objects.remove(obj)
    imported(scene, "plain", space)
    assert np.abs(from_working(picture(scene, EEVEE, tmp_path)) - expected).max() < 0.01 * expected.max()


def test_exact_colors_are_the_values_of_the_file_in_every_space(scene, space, tmp_path):
    """For the view transform Raw, which shows numbers as they are."""
    obj = imported(scene, "dog")
    set_input(splat_modifier(obj), "Linear Colors", False)
    scene.view_settings.view_transform = "Raw"
    obj.update_tag()
    expected = picture(scene, "CYCLES", tmp_path)
    bpy.data.objects.remove(obj)
    obj = imported(scene, "dog", space)
    set_input(splat_modifier(obj), "Linear Colors", False)
    obj.update_tag()
    assert np.array_equal(picture(scene, "CYCLES", tmp_path), expected)


@pytest.mark.parametrize("name", ["dog", "linear"])
@pytest.mark.parametrize("colors", ["LINEAR", "DISPLAY"])
def test_our_engine_draws_splats_over_the_same_world(scene, by_command, space, name, colors, tmp_path):
    """In display values the picture of a file stays what it is."""
    imported(scene, name)
    background(scene, (0.1, 0.4, 0.05, 1) if colors == "LINEAR" else (0.3, 0.3, 0.3, 1))
    scene.dogsplat_colors = colors
    expected = picture(scene, ENGINE, tmp_path)
    for obj in [obj for obj in bpy.data.objects if obj.type != "CAMERA"]:
        bpy.data.objects.remove(obj)
    imported(scene, name, space)
    found = picture(scene, ENGINE, tmp_path)
    assert np.abs((from_working(found) if colors == "LINEAR" else found) - expected).max() < ROUNDED
    assert colors == "DISPLAY" or np.abs(found - expected).max() > 0.1


def test_a_whole_scene_is_lit_and_colored_as_before(scene, by_command, space, tmp_path):
    """Colours of shaders, of the viewport, of lamps with a temperature, of the world, and images of floats."""
    camera(scene, (0, 0, 6))
    scene.dogsplat.samples = 8
    body(plane(8), material("ShaderNodeBsdfPrincipled", Base_Color=(0.2, 0.7, 0.3, 1)))
    shining = material("ShaderNodeEmission", Strength=2.0)
    pixels = image("floats", lambda x, y: (0.9 * x, 0.3 + 0 * x, 0.5 * y), is_float=True)
    pixels.filepath_raw, pixels.file_format = str(tmp_path / "floats.exr"), "OPEN_EXR"
    pixels.save()
    link(shining.node_tree, "ShaderNodeTexImage", "Color", shining.node_tree.nodes["Emission"].inputs[0]).image = pixels
    body(sphere(0.7, location=(1.2, 0, 1)), shining)
    odd = body(sphere(0.6, location=(-1.2, 0, 1)), material("ShaderNodeBsdfHair"))
    odd.data.materials[0].diffuse_color = (0.8, 0.3, 0.1, 1)
    light(scene, "POINT", (0, -1, 3), energy=60, color=(0.7, 0.4, 1.0), shadow_soft_size=0)
    warm = light(scene, "POINT", (0, 1, 3), energy=40, shadow_soft_size=0)  # of white: by a color it differs
    if hasattr(warm.data, "use_temperature"):
        warm.data.use_temperature, warm.data.temperature = True, 3500
    background(scene, (0.1, 0.1, 0.4, 1))
    expected = picture(scene, ENGINE, tmp_path)
    choose(space)
    found = picture(scene, ENGINE, tmp_path)
    assert expected.std(axis=(0, 1)).min() > 0.02
    difference = np.abs(from_working(found) - expected)
    assert np.percentile(difference, 99) < 1e-4 < 0.02 < np.percentile(np.abs(found - expected), 95)


def test_a_tint_has_the_color_that_was_picked(scene, space):
    picked = np.array([0.8, 0.3, 0.1], np.float32)
    rows, found = np.arange(40), []
    for chosen in ("Linear Rec.709", space):
        choose(chosen)
        obj = load(REFERENCES / "dog.ply")
        bpy.ops.dogsplat.paint(what="TINT")
        paint(stand_in_of(obj), rows, color=(*to_working(picked), 1.0))
        found.append(shown(obj))
        bpy.ops.dogsplat.finish_painting()
    assert np.allclose(found[1].sh_coeffs, found[0].sh_coeffs, atol=1e-5)
    raw = read_ply(REFERENCES / "dog.ply")
    assert not np.allclose(found[0].sh_coeffs, raw.sh_coeffs, atol=0.01)
    assert_equal(found[1].select(np.arange(40, 150)), raw.select(np.arange(40, 150)))


def test_settings_and_drivers_and_keys_stay_when_trees_are_changed(scene, model, space):
    place_camera(scene, "dog")
    obj = load(model)
    modifier = splat_modifier(obj)
    set_input(modifier, "Near Clip", 0.7)
    set_input(modifier, "Show As", "Ellipsoids")
    for frame, share in ((1, 0.2), (11, 0.8)):
        set_input(modifier, "Viewport Share", share)
        owner, key = input_property(modifier, "Viewport Share")
        owner.keyframe_insert(key, frame=frame)
    scene.frame_set(6)
    names = ("Near Clip", "Show As", "Viewport Share", "Focal X", "Center Y")
    before = [get_input(modifier, name) for name in names]
    for chosen in (space, "Linear Rec.709"):
        choose(chosen)
        assert is_suited(obj) and [get_input(splat_modifier(obj), name) for name in names] == before
    scene.camera.data.lens *= 2
    scene.frame_set(11)
    seen = splat_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    assert get_input(seen, "Focal X") == pytest.approx(2 * before[3]) and get_input(seen, "Viewport Share") > 0.79


def test_undo_of_the_choice_has_the_trees_of_before(scene, model, space):
    load(model)
    bpy.ops.ed.undo_push(message="before")
    choose(space)
    bpy.ops.ed.undo_push(message="chosen")
    for step, chosen in ((bpy.ops.ed.undo, "Linear Rec.709"), (bpy.ops.ed.redo, space)):
        step()
        bpy.context.view_layer.update()
        assert bpy.data.colorspace.working_space == chosen and is_suited(bpy.data.objects["dog"])


def test_models_of_another_file_suit_this_one(scene, model, space, tmp_path):
    """Appended ones do; what is only linked cannot be changed, and the panel says so."""
    import addon_utils

    load(model)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    for command, suits in ((bpy.ops.wm.append, True), (bpy.ops.wm.link, False)):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        addon_utils.enable("blender_addon")
        choose(space)
        command(directory=str(tmp_path / "source.blend" / "Object"), filename="dog")
        bpy.context.view_layer.update()
        obj = bpy.context.view_layer.objects.active = bpy.data.objects["dog"]
        place_camera(bpy.context.scene, "dog")
        assert is_suited(obj) == suits
        assert (OTHER in drawn()) == (not suits and not CONVERTS_ATTRIBUTES)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "source.blend"))
    assert is_suited(bpy.data.objects["dog"])


def test_exports_have_the_bits_of_the_file_or_it_is_said_why_not(scene, model, space, tmp_path, capfd):
    """Only Blender 5.0 and 5.1 convert coefficients, of what was there when the space was chosen."""
    place_camera(scene, "dog")
    first = load(model)
    choose(space)
    second = load(model)
    assert CHANGED not in drawn()
    assert_equal(export(tmp_path / "second.ply"), read_ply(model))
    bpy.context.view_layer.objects.active = first
    first.select_set(True)
    second.select_set(False)
    capfd.readouterr()
    found = export(tmp_path / "first.ply")
    said = f'"{first.name}": its colors are wrong since the working space {space} was chosen; import the model again'
    assert (f"Warning: {said}" in capfd.readouterr().out) == CONVERTS_ATTRIBUTES == (CHANGED in drawn())
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert order.notes == [said] * CONVERTS_ATTRIBUTES
    if not CONVERTS_ATTRIBUTES:
        assert_equal(found, read_ply(model))


READ = """
import json, sys
from pathlib import Path
from mi_dogsplat.datasets.exr import read_exr
print(json.dumps(read_exr(Path(sys.argv[1])).mean(axis=(0, 1)).tolist()))
"""


def test_linear_views_of_a_training_are_those_of_rec_709(scene, space, tmp_path):
    camera(scene, (0, 0, 6))
    background(scene, (0.8, 0.1, 0.1, 1))
    choose(space)
    scene.dogsplat_training.linear, scene.dogsplat_training.transparent = True, False
    before = scene.render.image_settings.color_management
    with Borrowed() as borrowed:
        borrowed.set_picture(scene)
        scene.render.engine, scene.render.filepath = "CYCLES", str(tmp_path / "view.exr")
        bpy.ops.render.render(write_still=True)
    assert scene.render.image_settings.color_management == before
    assert by_package(READ, str(tmp_path / "view.exr"))[:3] == pytest.approx([0.8, 0.1, 0.1], abs=2e-3)
