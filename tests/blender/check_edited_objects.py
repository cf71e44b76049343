"""What artists do to whole objects: join, separate, duplicate, instance, append, link."""

import bpy
import numpy as np
import pytest
from edits import PLACED, cropped, local, paint, shown
from mathutils import Matrix
from model_files import export, load
from model_values import assert_equal, assert_moved, covariances
from references import REFERENCES, place_camera
from scattering import scattering

from blender_addon.editing.stand_in import stand_in_of
from blender_addon.evaluated.placed import placed_splats
from blender_addon.files.light import Light
from blender_addon.files.ply import read_ply
from blender_addon.files.sh import C0
from blender_addon.nodes.modifier import edit_modifiers, get_input, set_input, splat_modifier
from blender_addon.objects.attributes import read_attributes
from blender_addon.objects.conventions import light_of


@pytest.mark.parametrize("join", [bpy.ops.object.join, lambda: bpy.ops.dogsplat.join()])
def test_joined_models_keep_attributes_dog_rows_and_degrees(model, join):
    raw = read_ply(model)
    second, first = load(model, sh_degree=1), load(model)
    second.matrix_world = PLACED
    second.select_set(True)
    bpy.context.view_layer.update()
    assert join() == {"FINISHED"}
    bpy.context.view_layer.update()
    (obj,) = bpy.data.objects
    assert obj == first
    model_now = read_attributes(obj.data)
    assert model_now.n_splats == 2 * raw.n_splats and model_now.sh_degree == 3
    own = np.flatnonzero((model_now.means == raw.means[0]).all(axis=1))[0]
    assert own in (0, raw.n_splats)
    mine = np.arange(own, own + raw.n_splats)
    assert_equal(model_now.select(mine), raw)
    other = model_now.select(np.setdiff1d(np.arange(2 * raw.n_splats), mine))
    assert not other.sh_coeffs[:, 4:].any()
    assert_moved(other.with_degree(1), raw.with_degree(1), np.array(PLACED))


def test_our_join_turns_models_of_few_splats(model):
    """Of which Blender's own join leaves too little to tell how they were turned."""
    objects = [load(model, max_count=count) for count in (3, 1, 7, 20)]
    expected = [read_attributes(obj.data) for obj in objects]
    shear = np.array([[1.0, 0.4, 0, 0], [0, 0.7, 0, 0], [0, 0.2, 1.5, 0], [0, 0, 0, 1]])
    matrices = [np.array(PLACED), np.array(PLACED) @ shear, shear, np.eye(4)]
    for obj, matrix in zip(objects, matrices, strict=True):
        parent = bpy.data.objects.new("Parent", None)  # what it has of a shear is none that an object can have
        obj.parent, obj.matrix_parent_inverse = parent, Matrix(matrix)
        obj.select_set(True)
    bpy.context.view_layer.update()
    assert bpy.ops.dogsplat.join() == {"FINISHED"}
    bpy.context.view_layer.update()
    joined = bpy.context.object.data
    found = read_attributes(joined)
    assert found.n_splats == 31 and "dog:part" not in joined.attributes
    for part, matrix in zip(expected, matrices, strict=True):
        places = part.means @ matrix[:3, :3].T + matrix[:3, 3]
        rows = [np.abs(found.means - place).max(axis=1).argmin() for place in places]
        linear = matrix[:3, :3]
        assert np.allclose(covariances(found.select(rows)), linear @ covariances(part) @ linear.T, rtol=1e-3, atol=1e-5)


def test_our_join_leaves_hidden_splats_behind_and_refuses_what_splats_cannot_follow(model):
    second, first = load(model), load(model)
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(first)[0], "Maximum Count", 30)
    first.update_tag()
    second.select_set(True)
    second.scale = 1, 1, 0
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match='"dog".*cannot be flattened'):
        bpy.ops.dogsplat.join()
    assert len(bpy.data.objects) == 2
    first.scale, second.scale = second.scale.copy(), (1, 1, 1)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match='"dog.001".*cannot be flattened'):  # the active one
        bpy.ops.dogsplat.join()
    first.scale = second.scale = 1, 1, 1
    bpy.context.view_layer.update()
    bpy.ops.dogsplat.join()
    assert len(first.data.vertices) == 180 and not edit_modifiers(first)


def test_linear_models_join_linear_ones_only_and_stay_linear(model):
    """A tint multiplies radiance, so it is not encoded."""
    second, first = load(model), load(REFERENCES / "linear.ply")
    second.select_set(True)
    with pytest.raises(RuntimeError, match="some of these models hold radiance"):
        bpy.ops.dogsplat.join()
    bpy.data.objects.remove(second)
    first.select_set(True)
    bpy.ops.object.duplicate()
    first.select_set(True)
    assert bpy.ops.dogsplat.join() == {"FINISHED"}
    obj, raw = bpy.context.object, read_ply(REFERENCES / "linear.ply")
    assert light_of(obj) == Light(True, 2.5) and len(obj.data.vertices) == 2 * raw.n_splats
    bpy.ops.dogsplat.paint(what="TINT")
    paint(stand_in_of(obj), np.arange(2 * raw.n_splats), color=(1.0, 0.2, 0.0, 1.0))
    found = shown(obj).sh_coeffs[:, 0] * C0 + 0.5
    assert np.allclose(found, (read_attributes(obj.data).sh_coeffs[:, 0] * C0 + 0.5) * (1, 0.2, 0), atol=1e-5)


def test_separated_parts_are_models_with_all_their_bits(scene, model, tmp_path):
    place_camera(scene, "dog")
    obj, raw = load(model, up_axis="-Y"), read_ply(model)
    part = np.arange(raw.n_splats) % 3 == 0
    obj.data.vertices.foreach_set("select", part)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.separate(type="SELECTED")
    bpy.ops.object.mode_set(mode="OBJECT")
    other = next(o for o in bpy.context.selected_objects if o != obj)
    scene.camera.data.lens *= 2
    for piece, rows in ((obj, ~part), (other, part)):
        bpy.ops.object.select_all(action="DESELECT")
        piece.select_set(True)
        assert_equal(export(tmp_path / "out.ply"), raw.select(rows))
        seen = splat_modifier(piece.evaluated_get(bpy.context.evaluated_depsgraph_get()))
        assert get_input(seen, "Focal X") == get_input(splat_modifier(obj), "Focal X") > 0


def test_a_linked_duplicate_is_exported_twice_and_cropped_by_itself(model, tmp_path):
    obj, raw = load(model), read_ply(model)
    bpy.ops.object.duplicate(linked=True)
    copy = bpy.context.object
    assert copy.data == obj.data
    copy.location.x += 4
    _, target = cropped(copy, "BOX")
    keep = np.abs(local(copy, target, raw.means)).max(axis=1) <= 1
    for other in (obj, copy):
        other.select_set(True)
    assert export(tmp_path / "out.ply").n_splats == raw.n_splats + keep.sum()
    bpy.context.view_layer.objects.active = copy
    obj.select_set(False)
    bpy.ops.dogsplat.apply_edits()
    bpy.ops.dogsplat.apply_transform()
    assert_equal(read_attributes(obj.data), raw)
    assert np.allclose(read_attributes(copy.data).means, raw.means[keep] + (4, 0, 0), atol=1e-5)


@pytest.mark.parametrize("show, realised", [("Quads", False), ("Ellipsoids", False), ("Quads", True)])
def test_instances_of_a_collection_are_exported_where_they_stand(scene, model, tmp_path, show, realised):
    """Not the ellipsoids, which are instances too."""
    raw = read_ply(model)
    obj = load(model)
    set_input(splat_modifier(obj), "Show As", show)
    obj.update_tag()
    collection = bpy.data.collections.new("kept")
    for user in obj.users_collection:
        user.objects.unlink(obj)
    collection.objects.link(obj)
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(empty)
    empty.matrix_world = PLACED
    bpy.context.view_layer.update()
    empty.select_set(True)
    bpy.context.view_layer.objects.active = empty
    if realised:
        bpy.ops.object.duplicates_make_real()
        bpy.context.view_layer.update()
    placed = list(placed_splats(bpy.context.evaluated_depsgraph_get()))
    assert len(placed) == 1 and np.allclose(placed[0][1], np.array(PLACED), atol=1e-6)
    assert_moved(export(tmp_path / "out.ply"), raw, np.array(PLACED))


def square_of(obj, way):
    """A plane that repeats an object at each of its corners, by its points or by nodes."""
    bpy.ops.mesh.primitive_plane_add(size=2)
    square = bpy.context.object
    if way == "VERTS":
        square.instance_type, obj.parent = way, square
    else:
        square.modifiers.new("scatter", way).node_group = scattering(obj)
    return square


@pytest.mark.parametrize("show", ["Quads", "Ellipsoids"])
@pytest.mark.parametrize("way", ["VERTS", "NODES"])
def test_what_points_or_nodes_repeat_is_placed(scene, model, show, way):
    """Once for each corner of a square, and not the ellipsoids."""
    obj = load(model)
    set_input(splat_modifier(obj), "Show As", show)
    square = square_of(obj, way)
    square.matrix_world = PLACED
    bpy.context.view_layer.update()
    placed = list(placed_splats(bpy.context.evaluated_depsgraph_get(), lambda owner: owner == square))
    assert [(found, owner) for found, _, owner in placed] == 4 * [(obj, square)]
    corners = [tuple(square.matrix_world @ vertex.co) for vertex in square.data.vertices]
    assert np.allclose(sorted(tuple(matrix[:3, 3]) for _, matrix, _ in placed), sorted(corners), atol=1e-5)


@pytest.mark.parametrize("way", ["VERTS", "NODES"])
def test_what_shows_only_what_it_repeats_repeats_splats(scene, model, way):
    """Blender does not list it among the objects of a graph."""
    obj = load(model)
    square = square_of(obj, way)
    square.show_instancer_for_viewport = square.show_instancer_for_render = False
    bpy.context.view_layer.update()
    placed = list(placed_splats(bpy.context.evaluated_depsgraph_get(), lambda owner: owner == square))
    assert [(found, owner) for found, _, owner in placed] == 4 * [(obj, square)]


@pytest.mark.parametrize("kind", ["OBJECT", "COLLECTION"])
def test_particles_repeat_splats(scene, model, tmp_path, kind):
    obj = load(model)
    bpy.ops.mesh.primitive_plane_add(size=2)
    square = bpy.context.object
    settings = square.modifiers.new("particles", "PARTICLE_SYSTEM").particle_system.settings
    settings.type, settings.count, settings.render_type = "HAIR", 3, kind
    settings.use_advanced_hair = True
    if kind == "OBJECT":
        settings.instance_object = obj
    else:
        settings.instance_collection = bpy.data.collections.new("kept")
        settings.instance_collection.objects.link(obj)
    bpy.context.view_layer.update()
    placed = list(placed_splats(bpy.context.evaluated_depsgraph_get(), lambda owner: owner == square))
    assert [(found, owner) for found, _, owner in placed] == 3 * [(obj, square)]
    bpy.ops.object.select_all(action="DESELECT")
    square.select_set(True)
    assert export(tmp_path / "out.ply").n_splats == 3 * len(obj.data.vertices)


@pytest.mark.parametrize("inner", ["COLLECTION", "NODES"])
def test_what_an_instanced_collection_makes_instances_of_is_placed(scene, model, tmp_path, inner):
    """Though no splats are in that collection itself."""
    raw, obj = read_ply(model), load(model)
    own, around = (bpy.data.collections.new(name) for name in ("own", "around"))
    for user in obj.users_collection:
        user.objects.unlink(obj)
    own.objects.link(obj)
    if inner == "COLLECTION":
        host = instance_of(own, "inner")
    else:
        host = bpy.data.objects.new("inner", bpy.data.meshes.new("point"))
        host.data.vertices.add(1)
        host.modifiers.new("scatter", inner).node_group = scattering(obj)
    around.objects.link(host)
    outer = instance_of(around, "outer")
    scene.collection.objects.link(outer)
    outer.matrix_world = PLACED
    bpy.context.view_layer.update()
    placed = list(placed_splats(bpy.context.evaluated_depsgraph_get()))
    assert [(found, owner) for found, _, owner in placed] == [(obj, outer)]
    assert np.allclose(placed[0][1], np.array(PLACED), atol=1e-6)
    outer.select_set(True)
    assert_moved(export(tmp_path / "out.ply"), raw, np.array(PLACED))


def instance_of(collection, name):
    empty = bpy.data.objects.new(name, None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    return empty


def test_only_what_makes_instances_has_to_be_selected_for_an_export(scene, model, tmp_path):
    raw, obj = read_ply(model), load(model)
    bpy.ops.mesh.primitive_plane_add(size=2)  # selects it alone
    bpy.context.object.modifiers.new("scatter", "NODES").node_group = scattering(obj)
    assert export(tmp_path / "out.ply").n_splats == 4 * raw.n_splats
    bpy.context.object.modifiers["scatter"].node_group = bpy.data.node_groups.new("nothing", "GeometryNodeTree")
    with pytest.raises(RuntimeError, match="what is selected shows no splats; select some"):
        export(tmp_path / "out.ply")


def test_what_is_parented_to_a_model_stays_when_its_transform_is_applied(scene, model):
    """Whatever the order in which a family of models is selected; and they are themselves applied."""
    objects = [load(model) for _ in range(3)]
    child, middle, top = objects
    empty = bpy.data.objects.new("empty", None)
    scene.collection.objects.link(empty)
    for below, above in ((child, middle), (middle, top), (empty, child)):
        below.parent, below.location = above, (1, 0, 2)
    top.matrix_world = PLACED
    bpy.context.view_layer.update()
    top.select_set(True)
    middle.select_set(False)
    child.select_set(True)
    before = {obj: np.array(obj.matrix_world) for obj in (middle, empty)}
    assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    bpy.context.view_layer.update()
    for obj, place in before.items():
        assert np.allclose(obj.matrix_world, place, atol=1e-5)
    assert np.allclose(top.matrix_world, np.eye(4), atol=1e-5) and np.allclose(child.matrix_world, np.eye(4), atol=1e-5)


@pytest.mark.parametrize("hidden", ["excluded", "disabled"])
def test_what_viewports_do_not_have_stays_at_its_parent_when_that_is_applied(scene, model, hidden):
    """Blender does not know where it is: it has not evaluated it since its parent was moved."""
    obj, empty, collection = load(model), bpy.data.objects.new("empty", None), bpy.data.collections.new("hidden")
    scene.collection.children.link(collection)
    collection.objects.link(empty)
    empty.parent, empty.location = obj, (1, 0, 2)
    bpy.context.view_layer.update()
    layer = bpy.context.view_layer.layer_collection.children["hidden"]
    layer.exclude, empty.hide_viewport = hidden == "excluded", hidden == "disabled"
    obj.matrix_world = PLACED
    bpy.context.view_layer.update()
    assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    layer.exclude, empty.hide_viewport = False, False
    bpy.context.view_layer.update()
    assert np.allclose(empty.matrix_world, PLACED @ Matrix.Translation((1, 0, 2)), atol=1e-5)


def test_keys_of_what_is_parented_mean_the_same_when_a_transform_is_applied(scene, model):
    obj, empty = load(model), bpy.data.objects.new("empty", None)
    scene.collection.objects.link(empty)
    empty.parent = obj
    for frame, location in ((1, (1, 2, 3)), (10, (3, 2, 1))):
        empty.location = location
        empty.keyframe_insert("location", frame=frame)
    obj.matrix_world = PLACED
    scene.frame_set(1)
    assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    scene.frame_set(10)
    assert np.allclose(empty.matrix_world, PLACED @ Matrix.Translation((3, 2, 1)), atol=1e-5)


def test_a_transform_is_applied_under_a_parent_that_is_scaled_unevenly(scene, model):
    """Location, rotation and scale cannot undo the shear there, nor keep a child in its place."""
    obj, empties = load(model), [bpy.data.objects.new(name, None) for name in ("above", "below")]
    for empty in empties:
        scene.collection.objects.link(empty)
    above, below = empties
    above.scale, above.rotation_euler = (2, 1, 0.5), (0.2, 0.5, 0.7)
    obj.parent, obj.rotation_euler, obj.scale = above, (0, 0.4, 0.9), (-1, 1, 0.5)
    below.parent, below.location, below.rotation_euler = obj, (1, 0, 2), (0.3, 0.1, 0)
    bpy.context.view_layer.update()
    before, place = np.array(obj.matrix_world), np.array(below.matrix_world)
    assert bpy.ops.dogsplat.apply_transform() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert np.allclose(obj.matrix_world, np.eye(4), atol=1e-5) and np.allclose(below.matrix_world, place, atol=1e-5)
    means = read_ply(model).means @ before[:3, :3].T + before[:3, 3]
    assert np.allclose(read_attributes(obj.data).means, means, atol=1e-4)


@pytest.mark.parametrize("change", [lambda: bpy.ops.dogsplat.apply_transform(), lambda: bpy.ops.dogsplat.paint()])
def test_the_data_of_another_file_is_not_changed(scene, model, tmp_path, change):
    """An object of this file may have it; what is written there is gone when the file is opened again."""
    import addon_utils

    load(model)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("blender_addon")
    bpy.ops.wm.link(directory=str(tmp_path / "source.blend" / "Object"), filename="dog")
    obj = bpy.data.objects["dog"].make_local()
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    linked = obj.data
    assert linked.library is not None and change() == {"FINISHED"}
    assert obj.data != linked and obj.data.library is None


@pytest.mark.parametrize("link", [False, True])
def test_edits_and_drivers_come_along_to_another_file(model, tmp_path, link):
    import addon_utils

    obj, raw = load(model), read_ply(model)
    _, target = cropped(obj, "BOX")
    keep = np.abs(local(obj, target, raw.means)).max(axis=1) <= 1
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("blender_addon")
    command = bpy.ops.wm.link if link else bpy.ops.wm.append
    command(directory=str(tmp_path / "source.blend" / "Object"), filename="dog")
    obj = bpy.data.objects["dog"]
    assert (obj.library is not None) == link and len(bpy.data.materials) == 4
    assert_equal(shown(obj), raw.select(keep))
    place_camera(bpy.context.scene, "dog")
    bpy.context.scene.camera.data.lens = 18
    bpy.context.view_layer.update()
    seen = splat_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    expected = 18 / bpy.context.scene.camera.data.sensor_width * bpy.context.scene.render.resolution_x
    assert get_input(seen, "Focal X") == pytest.approx(expected, rel=1e-3)
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.dogsplat.add_limits.poll() != link
    obj.select_set(True)
    assert_equal(export(tmp_path / "out.ply"), raw.select(keep))
