"""The views of a rig as a data set: settings given back, rendering that goes on, points, and what is refused."""

import bpy
import numpy as np
import pytest
from blender_pictures import EEVEE, choose_engine
from package_command import by_package
from training_scene import CENTER, RADIUS, folder_of, made_unlike, state

from blender_addon.engine.settings import ENGINE
from blender_addon.training import train_operator
from blender_addon.training.data_set import is_begun, is_complete
from blender_addon.training.render_jobs import RenderJobs
from blender_addon.training.rendering import Rendering
from blender_addon.training.rig_operator import make_rig, rig_cameras
from blender_addon.training.work import WORK
from blender_addon.viewport import rendered


@pytest.mark.parametrize("engine", ["CYCLES", EEVEE, ENGINE])
def test_all_settings_are_given_back_and_only_the_subject_is_seen(subject, scene, engine, by_command):
    """A subject, too, that a model has taken the place of."""
    choose_engine(scene, engine)
    scene.dogsplat_training.views = 1
    make_rig(bpy.context)
    subject.hide_render = True
    subject.hide_set(True)
    made_unlike(scene)
    before = state(scene)
    bpy.ops.dogsplat.render_views()
    assert state(scene) == before
    image = bpy.data.images.load(str(folder_of(scene) / "images" / "View_000.png"))
    assert tuple(image.size) == (40, 40)
    pixels = np.array(image.pixels[:]).reshape(40, 40, 4)
    seen = pixels[pixels[..., 3] > 0.99][:, :3]
    assert len(seen) > 300 and (pixels[..., 3] < 0.01).mean() > 0.1
    assert (seen[:, 0] > 1.5 * seen[:, 1]).all()  # red: neither the wall nor the green ball


@pytest.mark.parametrize("linear", [False, True])
def test_an_output_with_color_management_of_its_own_gets_it_back(subject, scene, linear):
    """And the views are those of any other scene."""
    scene.dogsplat_training.views, scene.dogsplat_training.linear, scene.cycles.seed = 1, linear, 1
    make_rig(bpy.context)
    pictures = []
    for own in (False, True):
        image = scene.render.image_settings
        if hasattr(image, "media_type"):
            image.media_type = "IMAGE"
        image.file_format = "OPEN_EXR"
        if own:
            image.color_management = "OVERRIDE"
            image.linear_colorspace_settings.name = "Non-Color"
            image.view_settings.view_transform, image.view_settings.exposure = "Raw", 2.0
            scene.render.use_multiview, image.views_format = True, "MULTIVIEW"
        owners = [image.linear_colorspace_settings, image.view_settings, image.display_settings] if own else []
        before = state(scene, *owners)
        bpy.ops.dogsplat.render_views()
        assert state(scene, *owners) == before
        file = bpy.data.images.load(str(folder_of(scene) / "images" / ("View_000.exr" if linear else "View_000.png")))
        pictures.append(np.array(file.pixels[:]))
        bpy.data.images.remove(file)
    assert np.array_equal(*pictures)


def test_views_are_of_the_view_layer_at_work(subject, scene):
    """Though the first one of the file, whose picture Blender would write, has no subject."""
    scene.dogsplat_training.views = 1
    make_rig(bpy.context)
    collection = bpy.data.collections.new("Subject")
    scene.collection.children.link(collection)
    collection.objects.link(subject)
    scene.collection.objects.unlink(subject)
    first, second = scene.view_layers[0], scene.view_layers.new("Second")
    first.layer_collection.children["Subject"].exclude = True
    with bpy.context.temp_override(view_layer=second):
        assert bpy.ops.dogsplat.render_views() == {"FINISHED"}
    image = bpy.data.images.load(str(folder_of(scene) / "images" / "View_000.png"))
    assert np.array(image.pixels[:])[3::4].mean() > 0.2 and first.use and second.use


def test_views_are_those_of_the_rig_though_a_marker_of_the_timeline_has_a_camera(subject, scene):
    """Which looks away from the subject: without its marker a render would switch to it."""
    own = bpy.data.objects.new("Own", bpy.data.cameras.new("Own"))
    scene.collection.objects.link(own)
    scene.timeline_markers.new("shot", frame=scene.frame_current).camera = own
    scene.timeline_markers.new("later", frame=scene.frame_current + 1)
    scene.dogsplat_training.views = 1
    make_rig(bpy.context)
    before = state(scene)
    bpy.ops.dogsplat.render_views()
    assert state(scene) == before
    image = bpy.data.images.load(str(folder_of(scene) / "images" / "View_000.png"))
    assert np.array(image.pixels[:])[3::4].mean() > 0.2


def test_views_are_written_where_braces_are_in_the_path(subject, scene, tmp_path):
    """From Blender 4.5 on braces of a path that is rendered to stand for something else."""
    scene.dogsplat_training.folder, scene.dogsplat_training.views = str(tmp_path / "a{b}" / "{blend_name"), 1
    make_rig(bpy.context)
    assert bpy.ops.dogsplat.render_views() == {"FINISHED"}
    assert (folder_of(scene) / "images" / "View_000.png").is_file() and is_complete(folder_of(scene))


def test_settings_are_given_back_after_an_error(subject, scene, monkeypatch):
    make_rig(bpy.context)
    made_unlike(scene)
    before = state(scene)
    monkeypatch.setattr(Rendering, "keep", lambda self: (_ for _ in ()).throw(ValueError("no view")))
    with pytest.raises(RuntimeError, match="no view"):
        bpy.ops.dogsplat.render_views()
    assert state(scene) == before and not WORK.busy


def test_what_was_rendered_is_kept_when_it_is_stopped(subject, scene):
    make_rig(bpy.context)
    before = state(scene)
    jobs = RenderJobs(bpy.context)
    while jobs.rendering.done < 2:
        assert jobs.tick()
    bpy.app.handlers.render_cancel[-1](scene)  # as Esc does
    assert not jobs.tick()
    jobs.close()
    assert state(scene) == before
    data = folder_of(scene)
    assert is_begun(data) and not is_complete(data) and not bpy.ops.dogsplat.train.poll()
    first = data / "images" / "View_000.png"
    written = first.stat().st_mtime_ns
    rig_cameras(scene.dogsplat_training)[1].location.z += 0.1  # this one has to be rendered again
    second = (data / "images" / "View_001.png").stat().st_mtime_ns
    jobs = RenderJobs(bpy.context)
    assert jobs.rendering.done == 1
    while jobs.tick():
        pass
    jobs.close()
    assert is_complete(data) and first.stat().st_mtime_ns == written
    assert (data / "images" / "View_001.png").stat().st_mtime_ns != second
    again = Rendering(bpy.context)  # of a scene that may be another now
    again.close()
    assert again.done == 0 and is_begun(data)


def test_disabling_the_add_on_ends_a_rendering(subject, scene):
    """Also where Blender waits for its next look, and with a viewport and a training that are looked after."""
    import addon_utils  # found once bpy is there

    make_rig(bpy.context)
    before, timers = state(scene), (rendered.look, train_operator.look_after)
    WORK.begin_rendering(RenderJobs(bpy.context), None)
    assert state(scene) != before
    for timer in timers:
        bpy.app.timers.register(timer)
    addon_utils.disable("blender_addon")
    assert state(scene) == before and not WORK.busy
    assert not any(map(bpy.app.timers.is_registered, timers)) and not bpy.app.handlers.render_cancel


LOAD = """
import json, sys
from mi_dogsplat.datasets import load_dataset
data = load_dataset(sys.argv[1])
views = [*data.train, *data.test]
print(json.dumps({
    "views": [len(data.train), len(data.test)], "points": data.points.tolist(), "colors": data.point_colors.tolist(),
    "channels": sorted({view.image.shape[2] for view in views}), "white": sorted({view.white for view in views}),
    "solid": sum(int((view.image[..., 3] > 0.5).sum()) for view in data.train if view.image.shape[2] == 4),
    "brightest": max(float(view.image.max()) for view in views),
}))
"""


def test_points_are_on_the_surfaces_in_their_colors(subject, scene):
    """What hides the ball from a camera, but is not seen, does not catch the points."""
    bpy.data.objects["SUN"].rotation_euler = (0, 0.9, 0)  # which the small ball does not hide
    bpy.ops.dogsplat.render_views()
    seen = by_package(LOAD, str(folder_of(scene)))
    assert seen["views"] == [12, 2] and seen["channels"] == [4] and seen["white"] == [None]
    points, colors = np.array(seen["points"]), np.array(seen["colors"])
    assert len(points) > 0.97 * seen["solid"] > 2000  # no ray passes by
    assert np.abs(np.linalg.norm(points - CENTER, axis=1) - RADIUS).max() < 0.02  # a ball of facets
    assert (colors[:, 0] > 1.5 * colors[:, 1]).mean() > 0.95
    lit = np.linalg.norm(points - bpy.data.objects["Small"].location, axis=1) > 0.6
    towards_sun = (points - CENTER)[lit] @ np.array(bpy.data.objects["SUN"].matrix_world.col[2][:3])
    assert np.corrcoef(towards_sun, colors[lit, 1])[0, 1] > 0.8  # each has the colour of its own place


def test_linear_views_do_not_end_at_white(subject, scene):
    bpy.data.objects["SUN"].data.energy = 30
    scene.dogsplat_training.linear, scene.dogsplat_training.views = True, 6
    bpy.ops.dogsplat.render_views()
    seen = by_package(LOAD, str(folder_of(scene)))
    assert seen["views"] == [6, 1] and seen["channels"] == [4] and seen["brightest"] > 2
    assert 0 <= np.min(seen["colors"]) and np.max(seen["colors"]) <= 1


def nothing_selected(scene, tmp_path):
    bpy.ops.object.select_all(action="DESELECT")


def no_faces(scene, tmp_path):
    nothing_selected(scene, tmp_path)
    empty = bpy.data.objects.new("Empty", None)
    scene.collection.objects.link(empty)
    empty.select_set(True)


def no_lens(scene, tmp_path):
    data = bpy.data.cameras.new("Wide")
    data.type = "ORTHO"
    scene.camera = bpy.data.objects.new("Wide", data)


def elevations_the_wrong_way_round(scene, tmp_path):
    scene.dogsplat_training.elevations = (40, 20)


def other_contents(scene, tmp_path):
    folder_of(scene).mkdir(parents=True)
    (folder_of(scene) / "letter.txt").write_text("mine")


def a_file_in_its_place(scene, tmp_path):
    scene.dogsplat_training.folder = str(tmp_path / "file")
    (tmp_path / "file").write_text("mine")


def what_cannot_be_removed(scene, tmp_path):
    (folder_of(scene) / "transforms.json").mkdir(parents=True)
    (folder_of(scene) / "views.json").write_text("{}")


def never_saved(scene, tmp_path):
    scene.dogsplat_training.folder = "//training"


@pytest.mark.parametrize("spoil, message", [
    (nothing_selected, "nothing is selected; select"), (no_faces, "no surfaces; select"),
    (no_lens, "Wide.*perspective camera"), (elevations_the_wrong_way_round, "lowest elevation is above"),
    (other_contents, "is a folder with other contents; choose"), (a_file_in_its_place, "cannot be written.*choose"),
    (what_cannot_be_removed, "transforms.json: cannot be removed .*; close what has it open"),
    (never_saved, "save the file, or choose a folder"),
])  # fmt: skip
def test_what_is_wrong_is_said_in_one_line(subject, scene, tmp_path, spoil, message):
    spoil(scene, tmp_path)
    before = state(scene)
    with pytest.raises(RuntimeError, match=message) as caught:
        bpy.ops.dogsplat.render_views()
    assert len(str(caught.value).strip().splitlines()) == 1
    assert state(scene)[:4] == before[:4] and scene.camera == before[5]
    assert not list(tmp_path.rglob("*.png"))
