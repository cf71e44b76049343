"""Which changes of a file ask for another stage of a viewport, and which for another picture."""

from types import SimpleNamespace

import bpy
import pytest
from live_views import a_context, drawn_viewport, tell, update
from mathutils import Matrix
from model_files import load
from package_command import never, nothing
from references import place_camera
from surroundings import plane

from blender_addon.nodes.modifier import edit_modifiers, get_input, input_property, set_input, splat_modifier
from blender_addon.viewport import rendered
from blender_addon.viewport.changes import Changes
from blender_addon.viewport.pace import REST
from blender_addon.viewport.watcher import Shown, Watcher


def test_what_is_the_same_is_neither_written_nor_drawn_again(monkeypatch, tmp_path, scene, model):
    """By a viewport that comes to rest after each change, of which Blender tells it."""
    place_camera(scene, "dog")
    obj, clock, stages, asked = load(model), [100.0], [], []
    other_camera = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    scene.collection.objects.link(other_camera)
    stream = SimpleNamespace(ask=lambda request, tag: asked.append(request), busy=never, close=nothing)
    stream.frame, stream.error, stream.news = None, "", 0
    write = rendered.make_stage
    monkeypatch.setattr(rendered.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(rendered, "Stream", lambda draw, close: stream)
    monkeypatch.setattr(rendered, "make_stage", lambda *given: stages.append(write(*given)) or stages[-1])
    viewport, context = drawn_viewport(monkeypatch, tmp_path), a_context()

    def after(change, *given):
        """How many stages are written, and how many pictures asked for."""
        before = len(stages), len(asked)
        change(*given)
        tell(viewport.note)
        for _ in range(3):  # while the view moves, and at rest
            viewport.restage()
            viewport.draw(context, bpy.context.evaluated_depsgraph_get())
            clock[0] += 10 * REST
        return len(stages) - before[0], len(asked) - before[1]

    def look_from(x):
        context.region_data.view_matrix = Matrix.Translation((x, 0, 0))

    def move(other):
        other.location.x += 1

    def zoom():
        scene.camera.data.lens += 5

    def edit():
        obj.data.vertices[0].co.x += 1
        obj.data.update_tag()

    viewport.note(bpy.context.evaluated_depsgraph_get())  # as Blender does before it draws for the first time
    assert after(nothing) == (1, 1)
    assert after(nothing) == after(obj.select_set, False) == after(move, other_camera) == (0, 0)
    assert after(look_from, 0.5) == (0, 1)
    assert after(move, scene.camera) == after(zoom) == (0, 0) and len(list(tmp_path.iterdir())) == 1
    assert after(move, obj) == after(edit) == (1, 1)
    assert after(obj.hide_set, True) == after(obj.hide_set, False) == (1, 1) and viewport.error == ""
    assert after(bpy.data.objects.remove, obj) == (0, 0) and "no splats" in viewport.error
    assert after(nothing) == (0, 0)


def test_what_is_hidden_and_other_settings_ask_for_a_stage(scene, model):
    obj, changes = load(model), Changes()
    assert changes.pending
    changes.note(bpy.context.evaluated_depsgraph_get())
    obj.hide_set(True)
    bpy.context.view_layer.update()
    changes.pending = False
    changes.note(bpy.context.evaluated_depsgraph_get())
    assert changes.pending
    depsgraph = bpy.context.evaluated_depsgraph_get()
    changes.compare(depsgraph)
    changes.pending = False
    changes.compare(depsgraph)
    assert not changes.pending
    settings, render = scene.dogsplat, scene.render
    for owner, name, value in (
        (settings, "send", "SPLATS"),
        (settings, "bounces", 3),
        (settings, "mesh_shadows", True),
        (render, "film_transparent", True),
        (bpy.context.view_layer, "material_override", bpy.data.materials.new("Clay")),
    ):
        assert getattr(owner, name) != value
        setattr(owner, name, value)
        changes.compare(bpy.context.evaluated_depsgraph_get())
        assert changes.pending, name
        changes.pending = False


def test_what_the_watcher_changes_asks_for_no_stage(scene, model):
    """Nor is the next change, of anybody else, passed over."""
    obj, changes = load(model), [Changes(), Changes()]
    obj.update_tag()

    def told():
        """What two viewports make of what Blender tells."""
        found = []

        def note(depsgraph):
            assert obj.name in {update.id.original.name for update in depsgraph.updates if update.is_updated_geometry}
            for each in changes:
                each.note(depsgraph)
                found.append(each.pending)
                each.pending = False

        tell(note)
        return found

    told()
    for share in (0.1, 0.2):
        Watcher().show(scene, Shown(round(share * 150)))
        assert get_input(splat_modifier(obj), "Moving Share") == pytest.approx(share)
        assert told() == [False, False]
    obj.data.vertices[0].co.x += 1
    obj.data.update_tag()
    obj.update_tag()
    assert told() == [True, True]
    Watcher().show(scene, Shown())
    scene.frame_set(2)
    obj.update_tag()
    assert told() == [True, True]


def test_a_camera_that_moves_hides_no_other_change(scene, model):
    """Of edits, by whatever they come, at the same time; and what a camera edits is another stage."""
    place_camera(scene, "dog")
    obj, changes = load(model), Changes()
    assert bpy.ops.dogsplat.add_crop(shape="BOX") == bpy.ops.dogsplat.add_limits() == {"FINISHED"}
    crop, limits = edit_modifiers(obj)
    box = get_input(crop, "Object")

    def asked(*change) -> bool:
        """Whether a stage is, when the camera moves as well."""
        scene.camera.location.x += 0.1
        if change:
            change[0](*change[1:])
        found = []

        def note(depsgraph):
            changes.note(depsgraph)
            found.append(changes.pending)
            changes.pending = False

        tell(note)
        return any(found)

    def edit():
        obj.data.vertices[0].co.x += 1
        obj.data.update_tag()

    asked()
    assert not asked()
    for change in (
        (set_input, limits, "Minimum Opacity", 0.5),
        (set_input, crop, "Invert", True),
        (set_input, splat_modifier(obj), "SH Degree", 1),
        (setattr, limits, "show_viewport", False),
        (setattr, box.location, "x", 1),
        (setattr, obj.location, "x", 1),
        (setattr, box, "parent", scene.camera),
        (edit,),
    ):
        assert asked(*change), change
        obj.update_tag()
        tell(changes.note)
        changes.pending = False
        assert asked() == (box.parent is not None)
    box.parent = None
    assert asked() and not asked()
    owner, key = input_property(limits, "Minimum Opacity")
    driver = owner.driver_add(key).driver
    variable = driver.variables.new()
    variable.name, variable.type, variable.targets[0].id = "x", "TRANSFORMS", scene.camera
    driver.expression = "x / 100"
    assert asked() and asked()


def test_which_updates_matter(scene, model):
    """A camera that moves is no change of a stage; nor is a selection."""
    place_camera(scene, "dog")
    obj, wall = load(model), plane(1)
    empty = bpy.data.objects.new("Empty", None)
    scene.collection.objects.link(empty)
    material = bpy.data.materials.new("Material")
    found = []
    cases = [
        (update(obj, geometry=True), True), (update(obj, transform=True), True), (update(obj), False),
        (update(obj, shading=True), False), (update(wall, shading=True), True), (update(wall), False),
        (update(scene.camera, transform=True), False), (update(empty, transform=True), False),
        (update(material), True), (update(scene), False), (update(wall.data, geometry=True), False),
    ]  # fmt: skip
    for case, _ in cases:
        changes = Changes()
        changes.note(SimpleNamespace(objects=scene.objects, updates=[]))
        changes.pending = False
        changes.note(SimpleNamespace(objects=scene.objects, updates=[case]))
        found.append(changes.pending)
    assert found == [expected for _, expected in cases]
