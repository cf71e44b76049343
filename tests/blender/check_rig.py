"""The rig of cameras around or inside of a subject: where it stands, and what an artist may change."""

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector
from model_files import load
from package_command import by_package
from scattering import only_as_instance
from training_scene import CENTER, RADIUS

from blender_addon.training.rendering import Rendering
from blender_addon.training.result import place_result
from blender_addon.training.rig import around, held_out
from blender_addon.training.rig_operator import make_rig, rig_cameras
from blender_addon.training.subject import framed, surface_points

CAPTURED = """
import json, sys
import numpy as np
from mi_dogsplat.datasets.camera_paths import circling_shots
from mi_dogsplat.datasets.capture import _tests
from mi_dogsplat.datasets.capture_config import CaptureConfig
config = CaptureConfig(views=12, size=(40, 30), elevations=(-60.0, 90.0), zoom=1.5)
x, y, z, radius = map(float, sys.argv[1:])
cameras = [shot.camera for shot in circling_shots(config, 14, np.array([x, y, z]), radius, "z")]
print(json.dumps({
    "cameras": [{"c2w": camera.c2w.tolist(), "focal": [camera.fx, camera.fy]} for camera in cameras],
    "tests": [(n, sorted(_tests(CaptureConfig(views=n), n + n // 6))) for n in (5, 48, 51)],
}))
"""


def test_the_rig_is_that_of_capture(subject, scene):
    scene.dogsplat_training.size, scene.dogsplat_training.zoom = (40, 30), 1.5
    made = Rendering(bpy.context)
    made.close()
    captured = by_package(CAPTURED, *map(str, (*CENTER, RADIUS)))
    for camera, frame in zip(captured["cameras"], made.frames, strict=True):
        assert np.allclose(np.array(frame["transform_matrix"]) * (1, -1, -1, 1), camera["c2w"], atol=1e-4)
        assert np.allclose([frame["fl_x"], frame["fl_y"]], camera["focal"], rtol=1e-5)
    for n, tests in captured["tests"]:
        assert held_out(n + n // 6) == set(tests)


def test_a_camera_that_looks_straight_down_is_upright():
    (pose,) = around(np.zeros(3), 2.0, 1, (90.0, 90.0))
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3)) and np.linalg.det(pose[:3, :3]) > 0
    assert np.allclose(pose[:3, 3], (0, 0, 2)) and np.allclose(pose[:3, 2], (0, 0, 1))


def test_poses_are_those_that_blender_renders_with(subject, scene):
    """A camera that was moved, with lens shift, under a parent: where Blender sees a point, so does the data set."""
    made = make_rig(bpy.context)
    moved = made[3]
    moved.data = moved.data.copy()
    moved.data.lens, moved.data.shift_x, moved.data.shift_y = 31.0, 0.1, -0.07
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    moved.parent, parent.location, parent.rotation_euler = parent, (0.3, 0.1, 0.2), (0.05, 0, 0.1)
    scene.dogsplat_training.size = (60, 40)
    bpy.context.view_layer.update()
    rendering = Rendering(bpy.context)
    try:
        for point in (CENTER, (1.3, 2.2, 0.1), (0.7, 1.6, 0.9)):
            u, v, _ = world_to_camera_view(scene, moved, Vector(point))
            frame = rendering.frames[3]
            x, y, z = (np.linalg.inv(frame["transform_matrix"]) @ (*point, 1))[:3]
            pixel = frame["cx"] - frame["fl_x"] * x / z, frame["cy"] + frame["fl_y"] * y / z
            assert np.allclose(pixel, (60 * u, 40 * (1 - v)), atol=1e-3)
    finally:
        rendering.close()


def test_cameras_that_were_deleted_and_added_are_respected(subject, scene):
    made = make_rig(bpy.context)
    bpy.data.objects.remove(made[0])
    own = made[1].copy()
    own.name = "my own"
    del own["DoG Splat Rig"]
    scene.dogsplat_training.cameras.objects.link(own)
    bpy.context.view_layer.update()
    rendering = Rendering(bpy.context)
    rendering.close()
    names = [frame["file_path"] for frame in rendering.frames]
    assert names[0] == "images/View_001.png" and names[-1] == "images/my_own.png" and len(names) == 14
    assert len(make_rig(bpy.context)) == 15 and own.name in scene.dogsplat_training.cameras.objects


def test_a_rig_stays_in_the_collection_that_it_was_put_into(subject, scene):
    make_rig(bpy.context)
    rig, outer = scene.dogsplat_training.cameras, bpy.data.collections.new("outer")
    scene.collection.children.link(outer)
    outer.children.link(rig)
    scene.collection.children.unlink(rig)
    make_rig(bpy.context)
    assert list(outer.children) == [rig] and rig.name not in scene.collection.children
    outer.children.unlink(rig)
    make_rig(bpy.context)
    assert rig.name in scene.collection.children


def test_a_scene_with_the_settings_of_another_one_leaves_its_rig_alone(subject, scene, model):
    """As "New Scene, Copy Settings" makes it."""
    made, first = make_rig(bpy.context), scene.dogsplat_training
    first.result = load(model)
    bpy.ops.scene.new(type="EMPTY")
    settings = bpy.context.scene.dogsplat_training
    assert settings.cameras == first.cameras and settings.objects() == [] and rig_cameras(settings) == []
    bpy.ops.mesh.primitive_cube_add(location=(20, 0, 0))
    own = make_rig(bpy.context)
    assert settings.objects() == [bpy.context.object] and not set(own) & set(made)
    assert rig_cameras(first) == made and first.objects() == [subject]
    place_result(bpy.context, model)
    assert not first.result.hide_render


def test_a_scene_that_looks_through_the_rig_does_so_again_when_it_is_made_anew(subject, scene):
    made = make_rig(bpy.context)
    scene.camera = made[2]
    made = make_rig(bpy.context)
    assert scene.camera == made[0]


def test_cameras_inside_stand_free_and_look_around(scene):
    bpy.ops.mesh.primitive_cube_add(size=6, location=(0, 0, 3))
    room = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(size=2, location=(0, 0, 3))
    cupboard = bpy.context.object
    room.select_set(True)
    settings = scene.dogsplat_training
    settings.rig, settings.views = "INSIDE", 24
    assert tuple(settings.elevations) == (-35, 35)
    made = make_rig(bpy.context)
    places = np.array([obj.matrix_world.translation for obj in made])
    assert len(made) == 28 and (np.abs(places - (0, 0, 3)) < 3 * 0.6 + 1e-5).all()
    assert (np.abs(places - (0, 0, 3)).max(axis=1) > 1).all()  # outside of the cupboard
    ways = -np.array([obj.matrix_world.col[2][:3] for obj in made])
    assert np.linalg.norm(ways.mean(axis=0)) < 0.1
    bpy.data.objects.remove(cupboard)
    room.scale = (1, 1, 0.03)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="there is room for 0 of 28 cameras inside; use fewer"):
        bpy.ops.dogsplat.make_cameras()


def test_a_region_marks_what_is_framed(subject, scene):
    empty = bpy.data.objects.new("Region", None)
    scene.collection.objects.link(empty)
    empty.location, empty.empty_display_size = (5, 5, 5), 2.0
    settings = scene.dogsplat_training
    settings.subject = "REGION"
    with pytest.raises(RuntimeError, match="no region is chosen"):
        bpy.ops.dogsplat.make_cameras()
    settings.region = empty
    bpy.context.view_layer.update()
    places = np.array([obj.matrix_world.translation for obj in make_rig(bpy.context)])
    reach = 2 * np.sqrt(3) / np.sin(np.radians(20))
    assert np.allclose(np.linalg.norm(places - 5, axis=1), reach, rtol=1e-4)


@pytest.mark.parametrize("kind", ["empty", "mesh"])
@pytest.mark.parametrize("setting", ["disable", "exclude", "object"])
def test_a_region_that_is_hidden_marks_where_it_is_now(subject, scene, kind, setting):
    """It was taken to be where it was when Blender last looked at it."""
    data = bpy.data.meshes.new("Box") if kind == "mesh" else None
    if data:
        data.from_pydata([(x, y, z) for x in (-2, 2) for y in (-2, 2) for z in (-2, 2)], [], [])
    region = bpy.data.objects.new("Region", data)
    scene.collection.objects.link(region)
    region.empty_display_size = 2.0
    if setting == "object":
        region.hide_viewport = True
    else:
        hide(region, setting)
    region.location = (5, 5, 5)
    objects = len(bpy.data.objects)
    settings = scene.dogsplat_training
    settings.subject, settings.region = "REGION", region
    corners = framed(bpy.context, settings, [])
    assert np.allclose(corners.min(axis=0), 3) and np.allclose(corners.max(axis=0), 7)
    assert len(bpy.data.objects) == objects


def hide(obj: bpy.types.Object, setting: str) -> tuple[bpy.types.LayerCollection, bpy.types.Collection]:
    """Put an object into a collection of its own, inside of one that hides it so."""
    outer, inner = bpy.data.collections.new("Outer"), bpy.data.collections.new("Inner")
    bpy.context.scene.collection.children.link(outer)
    outer.children.link(inner)
    for old in list(obj.users_collection):
        old.objects.unlink(obj)
    inner.objects.link(obj)
    made = bpy.context.view_layer.layer_collection.children["Outer"]
    setattr(outer if setting in ("hide_render", "disable") else made, HIDING.get(setting, setting), True)
    bpy.context.view_layer.update()
    return made, outer


HIDING = {"disable": "hide_viewport", "eye": "hide_viewport"}
"""The property, where it has the name of another's."""


@pytest.mark.parametrize("setting", ["exclude", "hide_render"])
def test_a_subject_that_its_collections_hide_is_no_subject(subject, scene, setting):
    """Renders would be empty. Whole Scene takes what renders show; one of a rig that was made before is refused."""
    make_rig(bpy.context)
    hide(subject, setting)
    with pytest.raises(ValueError, match='"Ball" is in no collection that this view layer renders; show one') as caught:
        Rendering(bpy.context)
    assert "\n" not in str(caught.value) and scene.render.resolution_x == 1920
    scene.dogsplat_training.subject = "SCENE"
    make_rig(bpy.context)
    assert {obj.name for obj in scene.dogsplat_training.objects()} == {"Small", "Wall"}
    Rendering(bpy.context).close()


@pytest.mark.parametrize("setting", ["disable", "eye"])
def test_a_subject_that_viewports_do_not_show_has_points(subject, scene, setting):
    """Renders have it, so its pictures are not empty, and its points are looked for where it is seen."""
    make_rig(bpy.context)
    hidden = hide(subject, setting)
    before = [owner.hide_viewport for owner in hidden]
    rendering = Rendering(bpy.context)
    try:
        shown = bpy.context.evaluated_depsgraph_get().objects
        assert subject.name in shown and len(surface_points(bpy.context.evaluated_depsgraph_get(), [subject]))
    finally:
        rendering.close()
    assert [owner.hide_viewport for owner in hidden] == before and sum(before) == 1


def test_instances_of_splats_are_no_surfaces(scene, model):
    only_as_instance(scene, load(model))
    scene.dogsplat_training.subject = "SCENE"
    with pytest.raises(RuntimeError, match="the subject has no surfaces"):
        bpy.ops.dogsplat.make_cameras()
