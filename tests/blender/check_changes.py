"""Which changes of a file ask for another stage of a viewport, and which for another picture."""

from types import SimpleNamespace

import bpy
import pytest
from live_views import through_the_camera, update
from model_files import load
from references import place_camera
from surroundings import plane

from blender_addon.engine.order import make_stage
from blender_addon.nodes.modifier import get_input, splat_modifier
from blender_addon.viewport.changes import Changes
from blender_addon.viewport.watcher import Shown, Watcher


def test_a_stage_is_written_again_only_if_splats_have_changed(scene, model, tmp_path):
    place_camera(scene, "dog")
    obj = load(model)
    changes, depsgraph = Changes(), bpy.context.evaluated_depsgraph_get()

    def noted():
        depsgraph.update()
        before, changes.pending = changes.pending, False
        changes.note(depsgraph)
        return before, changes.pending

    seen = through_the_camera(scene)
    assert changes.pending
    first = make_stage(depsgraph, tmp_path, seen.camera).request["model"]
    changes.note(depsgraph)
    noted()
    again = make_stage(depsgraph, tmp_path, seen.camera).request["model"]
    assert again == first and len(list(tmp_path.iterdir())) == 1
    obj.location.x += 1
    bpy.context.view_layer.update()
    assert make_stage(depsgraph, tmp_path, seen.camera).request["model"] != first
    obj.hide_set(True)
    bpy.context.view_layer.update()
    changes.pending = False
    changes.note(bpy.context.evaluated_depsgraph_get())
    assert changes.pending
    changes.pending = False
    changes.compare(scene)
    changes.pending = False
    changes.compare(scene)
    assert not changes.pending
    settings, render = scene.dogsplat, scene.render
    for owner, name, value in (
        (settings, "send", "SPLATS"),
        (settings, "bounces", 3),
        (settings, "mesh_shadows", True),
        (render, "film_transparent", True),
    ):
        assert getattr(owner, name) != value
        setattr(owner, name, value)
        changes.compare(scene)
        assert changes.pending, name
        changes.pending = False


def test_what_the_watcher_changes_asks_for_no_stage(scene, model):
    """Nor is the next change, of anybody else, passed over."""
    obj, changes = load(model), [Changes(), Changes()]
    obj.update_tag()

    def told():
        """What two viewports make of what Blender tells after it has evaluated, while it tells."""
        found = []

        def note(scene, depsgraph):
            assert obj.name in {update.id.original.name for update in depsgraph.updates if update.is_updated_geometry}
            for each in changes:
                each.note(depsgraph)
                found.append(each.pending)
                each.pending = False

        bpy.app.handlers.depsgraph_update_post.append(note)
        try:
            bpy.context.view_layer.update()
        finally:
            bpy.app.handlers.depsgraph_update_post.remove(note)
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
