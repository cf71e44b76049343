"""The panel and the menus draw: every property and operator that they name exists."""

from types import SimpleNamespace

import bpy
import pytest
from drawn_panels import NO_CAMERA, Layout, drawn, viewport
from model_files import load
from references import place_camera
from surroundings import light, plane

from blender_addon.engine.panels import (
    DOGSPLAT_PT_film,
    DOGSPLAT_PT_override,
    DOGSPLAT_PT_passes,
    DOGSPLAT_PT_render,
    DOGSPLAT_PT_visibility,
)
from blender_addon.engine.passes import SETTINGS
from blender_addon.nodes.modifier import input_property, splat_modifier
from blender_addon.panel import (
    EDITED,
    SHOWN,
    DOGSPLAT_PT_edit,
    apply_menu,
    export_menu,
    import_menu,
    object_menu,
)
from blender_addon.render_engine import ENGINE, DogSplatEngine


def test_the_panel_shows_the_settings_of_a_model(scene, model):
    assert drawn() == [
        "import_scene.dogsplat", "export_scene.dogsplat", "import_scene.dogsplat_cameras", "dogsplat.look_through",
        "dogsplat.exact_settings", "engine",
    ]  # fmt: skip
    load(model)
    names = drawn()
    assert set(SHOWN) <= set(names)
    assert "dog: 150 splats" in names and NO_CAMERA in names
    place_camera(scene, "dog")
    assert NO_CAMERA not in drawn()
    scene.render.engine = ENGINE
    assert "dogsplat_colors" in drawn()


def test_the_panel_says_what_hides_colors_and_lobes(scene, model):
    """Blender opens with solid shading, and with EEVEE."""
    place_camera(scene, "dog")
    load(model, prepare_viewports=False)
    names = drawn()
    assert "Material Preview" in names and "EEVEE: no negative lobes" in names
    viewport().shading.type = "MATERIAL"
    assert "Material Preview" not in drawn()
    load(model.with_name("plain.ply"))
    assert "EEVEE: no negative lobes" not in drawn()


def test_the_panel_says_that_cameras_of_several_views_share_quads(scene, model):
    """The two eyes of Stereo 3D do not, nor do views that our engine renders."""
    place_camera(scene, "dog")
    load(model)
    said = "Multi-View: quads of the active camera"
    scene.render.use_multiview = True
    assert said not in drawn()
    scene.render.views_format = "MULTIVIEW"
    assert said in drawn()
    scene.render.engine = ENGINE
    assert said not in drawn()


def test_the_panel_says_that_eevee_draws_one_model_after_the_other(scene, model):
    load(model)
    said = "EEVEE: join models that overlap"
    assert said not in drawn()
    load(model)
    assert said in drawn()
    scene.render.engine = "CYCLES"
    assert said not in drawn()


def test_the_render_properties_have_the_settings_of_the_engine_alone(scene):
    layout = Layout()
    DOGSPLAT_PT_render.draw(SimpleNamespace(layout=layout), bpy.context)
    assert layout.drawn == ["send", "samples", "denoise", "bounces", "mesh_shadows", "Colors of Splats Only"]
    scene.dogsplat.send = "SPLATS"
    layout.drawn.clear()
    DOGSPLAT_PT_render.draw(SimpleNamespace(layout=layout), bpy.context)
    assert layout.drawn == ["send", "Colors of Splats Only"]
    layout.drawn.clear()
    DOGSPLAT_PT_passes.draw(SimpleNamespace(layout=layout), bpy.context)
    assert layout.drawn == list(SETTINGS.values())
    assert not DOGSPLAT_PT_render.poll(SimpleNamespace(engine="CYCLES"))
    scene.render.engine = ENGINE
    assert DOGSPLAT_PT_render.poll(bpy.context)


SHARED = {
    "material": ["EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface"],
    "world": ["WORLD_PT_context_world", "EEVEE_WORLD_PT_surface"],
    "light": ["DATA_PT_EEVEE_light", "DATA_PT_spot"],
    "camera": ["DATA_PT_lens", "DATA_PT_camera_dof", "DATA_PT_camera_dof_aperture"],
}
"""By what is active: panels of Blender that show what our engine reads."""


@pytest.mark.parametrize("active", SHARED)
def test_what_the_engine_reads_can_be_set_while_it_is_chosen(scene, active):
    """By Blender's own panels; the power of a lamp is in one that says its kind, of which there is no second."""
    things = {"material": bpy.data.materials.new("M"), "world": bpy.data.worlds.new("W"),
              "light": bpy.data.lights.new("L", "SPOT"), "camera": bpy.data.cameras.new("C")}  # fmt: skip
    given = {name: None for name in things} | {active: things[active]}
    context = SimpleNamespace(engine=ENGINE, scene=scene, object=None, **given)
    assert all(getattr(bpy.types, name).poll(context) for name in SHARED[active])
    assert not bpy.types.DATA_PT_light.poll(context) and not DogSplatEngine.bl_use_shading_nodes_custom


def test_film_visibility_and_override_have_panels_of_our_own(scene):
    layout = Layout()
    for send, names in (("SCENE", ["Transparent", "filter_size"]), ("SPLATS", ["Transparent"])):
        scene.dogsplat.send = send
        DOGSPLAT_PT_film.draw(SimpleNamespace(layout=layout), bpy.context)
        assert layout.drawn == names
        layout.drawn.clear()
    DOGSPLAT_PT_override.draw(SimpleNamespace(layout=layout), bpy.context)
    assert layout.drawn == ["material_override"]
    layout.drawn.clear()
    seen, lamp = plane(1), light(scene, "POINT")
    DOGSPLAT_PT_visibility.draw(SimpleNamespace(layout=layout), SimpleNamespace(object=seen))
    assert layout.drawn == ["Camera"]
    for engine, obj, shown in ((ENGINE, seen, True), (ENGINE, lamp, False), ("CYCLES", seen, False)):
        assert DOGSPLAT_PT_visibility.poll(SimpleNamespace(engine=engine, object=obj)) == shown


def test_the_menu_of_the_modifier_names_the_ways_to_show(model):
    modifier = splat_modifier(load(model))
    owner, key = input_property(modifier, "Show As")
    if bpy.app.version >= (5, 2):
        items = [(item.name, item.value) for item in owner.bl_rna.properties[key].enum_items]
    else:
        items = [(item[1], item[4]) for item in owner.id_properties_ui(key[2:-2]).as_dict()["items"]]
    assert items == [("Automatic", 0), ("Quads", 1), ("Ellipsoids", 2), ("Points", 3)]


def test_the_panel_of_edits_has_the_sliders_of_every_modifier(model):
    assert not DOGSPLAT_PT_edit.poll(bpy.context)
    obj = load(model)
    for operator in (bpy.ops.dogsplat.add_crop, bpy.ops.dogsplat.add_limits, bpy.ops.dogsplat.paint):
        bpy.context.view_layer.objects.active = obj
        operator()
    layout = Layout()  # the stand-in is active now
    assert DOGSPLAT_PT_edit.poll(bpy.context)
    DOGSPLAT_PT_edit.draw(SimpleNamespace(layout=layout), bpy.context)
    assert {name for names in EDITED.values() for name in names} <= set(layout.drawn)
    assert "dogsplat.finish_painting" in layout.drawn


@pytest.mark.parametrize("menu, count", [(import_menu, 3), (export_menu, 2), (apply_menu, 2), (object_menu, 2)])
def test_menus(model, menu, count):
    load(model)
    layout = Layout()
    menu(SimpleNamespace(layout=layout), bpy.context)
    assert len(layout.drawn) == count


def test_presets_and_undo_are_offered():
    assert {"REGISTER", "UNDO", "PRESET"} <= bpy.types.IMPORT_SCENE_OT_dogsplat.bl_options
