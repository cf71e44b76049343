"""What changes quads of splats rather than splats, of another object or after what draws them: left out, and said."""

import json

import bpy
import numpy as np
import pytest
from blender_pictures import with_alpha
from live_views import staged, through_the_camera
from model_files import export, load
from references import place_camera
from scattering import scattering
from surroundings import GREY, background, body, material, plane

from blender_addon.engine.settings import ENGINE
from blender_addon.nodes.modifier import set_input, splat_modifier

COPIED = "its nodes copy what draws splats"


def scattered(obj, as_instance, realized) -> bpy.types.Object:
    """A square in whose place nodes put the object, at each of its corners."""
    host = body(plane(1, location=(0, 0, 3)), material("ShaderNodeBsdfDiffuse", Color=GREY))
    host.modifiers.new("scatter", "NODES").node_group = scattering(obj, as_instance, realized)
    return host


@pytest.mark.parametrize("send", ["SCENE", "SPLATS"])
@pytest.mark.parametrize("show", ["Quads", "Ellipsoids", "Points"])
@pytest.mark.parametrize("as_instance, realized", [(False, False), (False, True), (True, True)])
def test_a_copy_is_left_out_and_a_note_says_so(scene, model, tmp_path, as_instance, realized, show, send):
    place_camera(scene, "dog")
    obj, scene.dogsplat.send = load(model), send
    set_input(splat_modifier(obj), "Show As", show)
    host = scattered(obj, as_instance, realized)
    bpy.context.view_layer.update()
    stage = staged(tmp_path, through_the_camera(scene).camera)
    assert stage.request["counts"] == [150]
    assert [note for note in stage.notes if COPIED in note and f'"{host.name}"' in note and "As Instance" in note]
    if send == "SCENE":
        shapes = json.loads((tmp_path / stage.request["scene"]).read_text())
        assert not [name for name in shapes if name.startswith("object_")]
    hidden = frozenset([host.name_full])
    assert not [note for note in staged(tmp_path, through_the_camera(scene).camera, hidden).notes if COPIED in note]


def test_an_instance_of_the_object_needs_no_note(scene, model, tmp_path):
    place_camera(scene, "dog")
    scattered(load(model), as_instance=True, realized=False)
    bpy.context.view_layer.update()
    stage = staged(tmp_path, through_the_camera(scene).camera)
    assert stage.request["counts"] == 5 * [150] and stage.notes == []


def test_what_is_no_copy_is_drawn(scene, by_command, model, tmp_path):
    """The picture is that without the nodes: no balls or cards in the place of splats."""
    place_camera(scene, "dog")
    background(scene)
    scene.dogsplat.samples = 4
    obj = load(model)
    body(plane(5), material("ShaderNodeBsdfDiffuse", Color=GREY))
    host = scattered(obj, as_instance=False, realized=True)
    found = with_alpha(scene, ENGINE, tmp_path)
    bpy.data.objects.remove(host)
    assert np.allclose(found, with_alpha(scene, ENGINE, tmp_path), atol=1e-5)


@pytest.mark.parametrize("place", ["after", "off", "in front"])
def test_what_comes_after_the_drawing_is_left_out_and_a_note_says_so(scene, model, tmp_path, place, capfd):
    """Blender puts a new modifier there, where it mirrors quads."""
    place_camera(scene, "dog")
    obj = load(model)
    mirror = obj.modifiers.new("Mirror", "MIRROR")
    if place == "in front":
        obj.modifiers.move(1, 0)
    mirror.show_viewport = place != "off"
    bpy.context.view_layer.update()
    stage = staged(tmp_path, through_the_camera(scene).camera)
    assert stage.request["counts"] == [300 if place == "in front" else 150]
    line = f'"{obj.name}": its modifier "Mirror" comes after the one that draws and changes no splats; move it in front'
    assert stage.notes == ([line] if place == "after" else [])
    export(tmp_path / "out.ply")
    assert (line in capfd.readouterr().out) == (place == "after")
