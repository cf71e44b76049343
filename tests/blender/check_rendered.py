"""Viewports that our engine draws: their cameras, stages and pictures; the window itself would need a display."""

import json
import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import gpu
import numpy as np
import pytest
from check_render import place_camera
from conftest import REFERENCES, load
from mathutils import Matrix, Vector
from surroundings import background, body, link, material, plane

from blender_addon.editing.stand_in import build_stand_in
from blender_addon.engine.live import LiveCommand, LiveInProcess, live_renderer
from blender_addon.engine.order import camera_request, make_order, make_stage, tidy
from blender_addon.engine.passes import world_color
from blender_addon.engine.served import RendererError
from blender_addon.engine.settings import ENGINE
from blender_addon.nodes.modifier import get_input, splat_modifier
from blender_addon.scene.images import decoded
from blender_addon.scene.sockets import output_of
from blender_addon.viewport import rendered
from blender_addon.viewport.blit import Blit
from blender_addon.viewport.changes import Changes
from blender_addon.viewport.handlers import BEHIND_OURS, at_rest
from blender_addon.viewport.pace import LEVELS, REST, Level
from blender_addon.viewport.region import rendered_part, seen_by
from blender_addon.viewport.rendered import PATIENCE, PAUSE, Rendered, request_of
from blender_addon.viewport.watcher import Shown, Watcher

COMMAND = tuple(json.loads(os.environ["DOGSPLAT_COMMAND"]))
SIZE = 96, 64
VIEWS = {  # window matrices: as a person looks, through a camera that is zoomed and shifted, and along parallel rays
    "perspective": ((1.5, 0, 0, 0), (0, 2.2, 0, 0), (0, 0, -1.002, -0.2002), (0, 0, -1, 0)),
    "camera": ((3.1, 0, 0.4, 0), (0, 4.4, -0.7, 0), (0, 0, -1.002, -0.2002), (0, 0, -1, 0)),
    "orthographic": ((0.4, 0, 0, 0.1), (0, 0.6, 0, -0.2), (0, 0, -0.01, 0), (0, 0, 0, 1)),
    "orthographic camera": ((0.4, 0, 0, 0.1), (0, 0.6, 0, -0.2), (0, 0, -0.02, -1.02), (0, 0, 0, 1)),
}


@pytest.fixture(params=VIEWS)
def space(request):
    """A ``RegionView3D`` that has a pose."""
    pose = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.7, 4, (1, 2, 3))
    return SimpleNamespace(
        view_matrix=pose.inverted(),
        window_matrix=Matrix(VIEWS[request.param]),
        is_perspective=request.param in ("perspective", "camera"),
    )


def test_points_are_where_blender_draws_them(space):
    """To a hundredth of a pixel, whatever the resolution and the part of the region."""
    width, height = 300, 200
    seen = seen_by(space, width, height)
    assert seen.camera.w2c.shape == (4, 4) and seen.orthographic is not space.is_perspective
    for local in ((0.3, -0.2, -5.0), (-0.5, 0.8, -20.0), (0.1, 0.1, -90.0)):
        point = space.view_matrix.inverted() @ Vector(local)
        x, y, z, w = space.window_matrix @ Vector((*local, 1.0))
        expected = width / 2 * (1 + x / w), height / 2 * (1 - y / w)
        assert np.allclose(seen.pixels(np.array([point])), expected, atol=1e-2)
        small = seen.scaled(0.5)
        assert (small.camera.width, small.camera.height) == (150, 100)
        assert np.allclose(small.pixels(np.array([point])), np.divide(expected, 2), atol=1e-2)
        part = seen.window(40, 30, 100, 90)
        assert np.allclose(part.pixels(np.array([point])), np.subtract(expected, (40, 30)), atol=1e-2)
        depth = (seen.camera.w2c @ (*point, 1.0))[2]
        near, far = seen.clip
        if space.is_perspective:
            share = far / (far - near) * (1 - near / depth)  # as OpenGL has it, from 0 to 1
        else:
            share = (depth - near) / (far - near)
        assert near >= 0 and share == pytest.approx((z / w + 1) / 2, abs=1e-3)


def test_the_same_view_is_told_from_another(space):
    seen = seen_by(space, *SIZE)
    assert seen.same(seen_by(space, *SIZE)) and not seen.same(None) and not seen.same(seen_by(space, 96, 65))
    space.view_matrix = space.view_matrix @ Matrix.Translation((0, 0, 1e-3))
    assert not seen.same(seen_by(space, *SIZE))


def test_a_border_is_a_part_of_the_region_or_of_the_picture_of_the_camera(scene, space):
    seen = seen_by(space, 300, 200)
    assert rendered_part(seen, None, None) == (0, 0, 300, 200)
    assert rendered_part(seen, None, (0.1, 0.5, 0.25, 0.75)) == (30, 50, 150, 150)
    local = [(x, y, -10.0) for x in (-0.5, 0.5) for y in (-0.25, 0.25)]
    corners = np.array([space.view_matrix.inverted() @ Vector(corner) for corner in local])
    pixels = seen.pixels(corners)
    left, top, right, bottom = rendered_part(seen, corners, (0.0, 1.0, 0.0, 1.0))
    assert np.allclose((left, top), pixels.min(0), atol=0.5) and np.allclose((right, bottom), pixels.max(0), atol=0.5)
    half = rendered_part(seen, corners, (0.0, 0.5, 0.5, 1.0))  # its upper left quarter
    assert half[:2] == (left, top) and half[2] <= (left + right) / 2 + 1 and half[3] <= (top + bottom) / 2 + 1
    assert rendered_part(seen, corners + 1e3, (0.0, 1.0, 0.0, 1.0))[2] > 0  # outside: still a pixel


@pytest.fixture(scope="module")
def command():
    """The process that all tests of this file share."""
    renderer = LiveCommand(COMMAND)
    yield renderer
    renderer.close()
    assert not renderer.folder.exists()


@pytest.fixture(params=["command", "process"])
def renderer(request, command):
    """Both of them."""
    if request.param == "command":
        return command
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    return LiveInProcess()


def through_the_camera(scene):
    """What a region of the size of the picture sees through the camera."""
    render, camera = scene.render, scene.camera
    size = render.resolution_x, render.resolution_y
    aspect = {"scale_x": render.pixel_aspect_x, "scale_y": render.pixel_aspect_y}
    projection = camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=size[0], y=size[1], **aspect)
    view = camera.matrix_world.normalized().inverted()
    return seen_by(SimpleNamespace(view_matrix=view, window_matrix=projection, is_perspective=True), *size)


def last(renderer, request):
    (*_, (share, picture)) = renderer.pictures(request, lambda: False)
    assert share == 1
    return picture


def never(*_):
    return False


def test_a_viewport_at_rest_shows_the_final_picture(scene, renderer, tmp_path):
    """Through the same camera, of pixels that are not square: what make_order asks for, drawn by the same package."""
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    seen, depsgraph = through_the_camera(scene), bpy.context.evaluated_depsgraph_get()
    stage = make_stage(depsgraph, tmp_path, seen.camera)
    assert not stage.whole
    expected = np.load(REFERENCES / "dog.npz")
    scene.render.film_transparent, scene.dogsplat_colors = True, "DISPLAY"
    found = last(renderer, request_of(stage, scene, seen, Level(), rests=True))
    assert np.abs(found[..., :3] - expected["color"]).max() < 2e-3
    assert np.abs(found[..., 3] - expected["alpha"]).max() < 2e-3
    scene.render.film_transparent, scene.dogsplat_colors = False, "LINEAR"
    scene.world = bpy.data.worlds.new("World")
    for node in scene.world.node_tree.nodes if scene.world.node_tree else ():
        if node.type == "BACKGROUND":
            node.inputs["Color"].default_value = (0.25, 0.25, 0.25, 1)
    scene.world.color = (0.25, 0.25, 0.25)
    found = last(renderer, request_of(stage, scene, seen, Level(), rests=True))
    behind = 1.055 * 0.25 ** (1 / 2.4) - 0.055
    color = decoded(expected["color"] + (1 - expected["alpha"][..., None]) * behind)
    assert np.abs(found[..., :3] - color).max() < 4e-3 and (found[..., 3] == 1).all()


def test_a_scene_is_lit_at_the_camera_while_it_moves_and_path_traced_at_rest(scene, renderer, tmp_path):
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    wall = plane(200)
    wall.matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -20))
    scene.dogsplat.samples = 3
    seen = through_the_camera(scene)
    stage = make_stage(bpy.context.evaluated_depsgraph_get(), tmp_path, seen.camera)
    assert stage.whole
    small = seen.scaled(0.25)
    moving = last(renderer, request_of(stage, scene, small, LEVELS[-1], rests=False))
    assert moving.shape == (16, 24, 4) and (moving[..., 3] == 1).all() and moving[..., :3].max() > 0.3
    resting = list(renderer.pictures(request_of(stage, scene, small, Level(), rests=True), never))
    assert [share for share, _ in resting] == pytest.approx([1 / 3, 1])
    far = np.load(REFERENCES / "square.npz")["alpha"].reshape(16, 4, 24, 4).max((1, 3)) == 0
    assert far.any() and moving[far][:, :3].min() > 0.2
    assert resting[-1][1][far][:, :3].mean() < 0.05  # no lamp, no world: only splats shine on the wall


def test_the_same_scene_is_the_same_file(scene, tmp_path):
    """The package then reads nothing again; what earlier scenes were goes."""
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    wall, camera = plane(5), through_the_camera(scene).camera
    body(wall, material("ShaderNodeBsdfDiffuse"))
    first = staged(tmp_path, camera)
    path = Path(first.request["scene"])
    before = path.stat().st_mtime_ns
    wall.update_tag()
    bpy.context.view_layer.update()
    assert staged(tmp_path, camera).request == first.request and path.stat().st_mtime_ns == before
    wall.location.x += 1
    bpy.context.view_layer.update()
    other = staged(tmp_path, camera)
    assert other.request["scene"] != str(path)
    tidy(tmp_path, other.files)
    assert {file.name for file in tmp_path.iterdir()} == other.files


@pytest.mark.parametrize("helper", ["crop", "stand-in"])
def test_what_renders_do_not_show_is_no_body_of_a_viewport(scene, model, tmp_path, helper):
    """The mesh of a crop, and what brushes paint; a mesh that renders show again is."""
    place_camera(scene, "dog")
    obj, changes = load(model), Changes()
    if helper == "crop":
        assert bpy.ops.dogsplat.add_crop(shape="MESH") == {"FINISHED"}
        made = get_input(obj.modifiers[0], "Object")
    else:
        made = build_stand_in(obj)
    bpy.context.view_layer.update()
    depsgraph, camera = bpy.context.evaluated_depsgraph_get(), through_the_camera(scene).camera
    assert depsgraph.mode == "VIEWPORT" and made.name in {seen.name for seen in depsgraph.objects}
    assert not make_stage(depsgraph, tmp_path, camera).whole
    plane(5)
    assert [name for name in staged(tmp_path, camera).objects if name == made.name] == []
    changes.note(bpy.context.evaluated_depsgraph_get())
    changes.pending, made.hide_render = False, False
    changes.note(bpy.context.evaluated_depsgraph_get())
    assert changes.pending and made.name in staged(tmp_path, camera).objects


def staged(folder, camera):
    """A scene as it is now."""
    stage = make_stage(bpy.context.evaluated_depsgraph_get(), folder, camera)
    assert stage.whole
    return stage


def test_the_color_behind_splats_is_of_the_node_that_the_world_shows(scene):
    """And of no node where they are not in use, which older Blenders offer."""
    unused = background(scene, (0.1, 0.1, 0.1, 1))
    tree = scene.world.node_tree
    shown = link(tree, "ShaderNodeBackground", "Background", output_of(tree).inputs["Surface"])
    shown.inputs["Color"].default_value, shown.inputs["Strength"].default_value = (0.2, 0.3, 0.4, 1), 2.0
    assert np.allclose(world_color(scene.world), (0.4, 0.6, 0.8)) and not unused.outputs[0].is_linked
    scene.world.color = (0.7, 0.6, 0.5)
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = False
        assert np.allclose(world_color(scene.world), (0.7, 0.6, 0.5))
        scene.world.use_nodes = True
    tree.nodes.remove(shown)
    assert not world_color(scene.world).any()
    assert not world_color(None).any()


def test_parallel_rays_show_what_the_near_clip_would_hide(scene, command, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    pose = scene.camera.matrix_world.normalized()
    projection = Matrix(((0.2, 0, 0, 0), (0, 0.3, 0, 0), (0, 0, -0.001, 0), (0, 0, 0, 1)))
    seen = seen_by(SimpleNamespace(view_matrix=pose.inverted(), window_matrix=projection, is_perspective=False), *SIZE)
    stage = make_stage(bpy.context.evaluated_depsgraph_get(), tmp_path, seen.camera)
    assert last(command, request_of(stage, scene, seen, Level(), rests=True))[..., :3].max() > 0.1


def test_one_process_serves_all_pictures_and_leaves_those_of_other_views(scene, command, tmp_path):
    place_camera(scene, "square")
    plane(200).matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -20))
    scene.dogsplat.samples = 100_000
    seen = through_the_camera(scene)
    stage = make_stage(bpy.context.evaluated_depsgraph_get(), tmp_path, seen.camera)
    request = request_of(stage, scene, seen.scaled(0.25), Level(), rests=True)
    shares: list[float] = []
    for share, _ in command.pictures(request, lambda: bool(shares)):
        shares.append(share)
    assert len(shares) >= 1 and max(shares) < 1
    with pytest.raises(RendererError, match="none.ply: cannot be read") as caught:
        last(command, {"model": "none.ply", "camera": camera_request(seen.camera)})
    assert "\n" not in str(caught.value)
    assert last(command, {**request, "samples": 1}).shape == (16, 24, 4)


def test_a_process_that_has_ended_is_started_again(scene):
    dying = LiveCommand((sys.executable, "-c", "import sys; sys.exit('dogsplat: no memory')"))
    for _ in range(2):
        with pytest.raises(RendererError, match="no memory"):
            last(dying, {"camera": {"width": 1, "height": 1}})
    dying.close()


def test_the_package_is_found_as_for_final_pictures(monkeypatch):
    live = live_renderer(sys.executable)
    assert isinstance(live, LiveCommand) and live.folder.is_dir()
    live.close()
    with pytest.raises(RendererError, match="correct or clear"):
        live_renderer("/no/such")


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


def test_stages_leave_blender_some_time(monkeypatch, tmp_path, scene, model):
    place_camera(scene, "dog")
    load(model)
    clock, made = [100.0], []
    monkeypatch.setattr(rendered.time, "monotonic", lambda: clock[0])

    def slow(*_):
        clock[0] += 0.5
        made.append(clock[0])
        raise ValueError("no matter")

    viewport = drawn_viewport(monkeypatch, tmp_path)
    monkeypatch.setattr(rendered, "make_stage", slow)
    viewport.restage()
    again = SimpleNamespace(objects=[], updates=[update(bpy.data.materials.new("M"))])
    viewport.note(again)
    viewport.restage()
    assert len(made) == 1 and viewport.waits(clock[0])
    clock[0] += 0.5 * PAUSE
    viewport.restage()
    assert len(made) == 2


def test_a_viewport_tries_again_with_another_command(monkeypatch, tmp_path, scene, model):
    """Also where another one draws."""
    load(model)
    named, asked, closed = [""], [], []

    def live(command):
        asked.append(command)
        if not command:
            raise RendererError("the package is missing")
        return SimpleNamespace(folder=tmp_path, pictures=never, close=lambda: closed.append(command))

    viewport = drawn_viewport(monkeypatch, tmp_path)
    monkeypatch.setattr(rendered, "live_renderer", live)
    monkeypatch.setattr(rendered, "command_of", lambda context: named[0])
    viewport.restage()
    assert "missing" in viewport.error
    for named[0] in ("first", "second"):
        viewport.draw(a_context(), bpy.context.evaluated_depsgraph_get())
        viewport.restage()
        assert not viewport.error
    assert asked == ["", "first", "second"]
    limit = time.monotonic() + 10
    while not closed and time.monotonic() < limit:
        time.sleep(0.01)
    assert closed == ["first"]


def test_a_stage_that_fails_takes_no_file_from_the_one_before(monkeypatch, tmp_path, scene, model):
    """Which may still be read."""
    obj, viewport = load(model), drawn_viewport(monkeypatch, tmp_path)
    monkeypatch.setattr(rendered, "PAUSE", 0.0)
    whole = rendered.make_stage

    def stage(make):
        monkeypatch.setattr(rendered, "make_stage", make)
        obj.location.x += 1
        viewport.note(SimpleNamespace(objects=[], updates=[update(bpy.data.materials.new("M"))]))
        viewport.restage()
        return {path.name for path in tmp_path.iterdir()}

    def fails(*_):
        raise ValueError("no stage")

    (first,) = stage(whole)
    assert stage(fails) == {first}
    second = stage(whole)
    assert len(second) == 2 and first in second
    assert first not in stage(whole)


def test_a_file_that_cannot_be_removed_stays(monkeypatch, tmp_path):
    """As one that is being read on Windows; others go."""
    for name in ("a.ply", "b.ply"):
        (tmp_path / name).touch()
    remove = Path.unlink

    def unlink(path, *args, **options):
        if path.name == "a.ply":
            raise PermissionError("in use")
        remove(path, *args, **options)

    monkeypatch.setattr(Path, "unlink", unlink)
    tidy(tmp_path, set())
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]


def update(thing, geometry=False, transform=False, shading=False):
    flags = {"is_updated_geometry": geometry, "is_updated_transform": transform, "is_updated_shading": shading}
    return SimpleNamespace(id=thing, **flags)


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


def test_blender_draws_few_splats_itself_where_our_engine_draws_every_viewport(scene):
    def window(*kinds):
        spaces = [SimpleNamespace(shading=SimpleNamespace(type=kind)) for kind in kinds]
        areas = [SimpleNamespace(type="VIEW_3D", spaces=SimpleNamespace(active=space)) for space in spaces]
        return SimpleNamespace(screen=SimpleNamespace(areas=areas))

    assert at_rest(scene, [window("RENDERED")]) == Shown()
    scene.render.engine = ENGINE
    assert at_rest(scene, [window("RENDERED"), window("RENDERED")]) == Shown(BEHIND_OURS)
    assert at_rest(scene, [window("RENDERED", "MATERIAL")]) == at_rest(scene, []) == Shown()


def a_context():
    """Of a viewport that is drawn."""
    space = SimpleNamespace(view_matrix=Matrix.Identity(4), window_matrix=Matrix(VIEWS["perspective"]),
                            is_perspective=True, view_perspective="PERSP")  # fmt: skip
    view3d = SimpleNamespace(camera=None, use_render_border=False)
    region = SimpleNamespace(width=SIZE[0], height=SIZE[1])
    return SimpleNamespace(region=region, region_data=space, space_data=view3d, preferences=bpy.context.preferences)


def drawn_viewport(monkeypatch, folder):
    """One that was drawn once, and whose package draws nothing."""
    package = SimpleNamespace(folder=folder, pictures=never, close=never)
    monkeypatch.setattr(rendered, "live_renderer", lambda command: package)
    viewport = Rendered()
    viewport.draw(a_context(), bpy.context.evaluated_depsgraph_get())
    return viewport


def test_a_viewport_that_is_not_on_the_screen_is_not_waited_for(monkeypatch, tmp_path):
    """As one in another workspace; a timer would look at it for ever."""
    viewport = Rendered()
    assert not viewport.has_news(0.0) and viewport.waits(0.0)  # it has no stage yet
    viewport.restage()
    assert viewport.waits(0.0)  # nor has it been drawn
    viewport = drawn_viewport(monkeypatch, tmp_path)
    viewport.restage()
    assert "no splats" in viewport.error
    now = time.monotonic() + REST
    assert viewport.has_news(now) and viewport.waits(now + 0.9 * PATIENCE)
    assert not viewport.has_news(now + PATIENCE) and not viewport.waits(now + PATIENCE)
    viewport.draw(a_context(), bpy.context.evaluated_depsgraph_get())
    assert not viewport.waits(now)


def test_blender_shows_its_own_splats_again_when_our_engine_leaves(scene, model):
    modifier, watcher = splat_modifier(load(model)), Watcher()
    assert watcher.draws(True) and not watcher.draws(True)
    assert watcher.tick(scene, 100.0, Shown(), Shown(30)) is None
    assert get_input(modifier, "Moving Share") == pytest.approx(0.2)
    assert watcher.draws(False)
    watcher.tick(scene, 101.0, Shown(), Shown())
    assert get_input(modifier, "Moving Share") == 1


def test_a_final_picture_is_ordered_as_before(scene, tmp_path):
    place_camera(scene, "dog")
    obj = load(REFERENCES / "dog.ply")
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, ["depth"])
    assert order.request["passes"] == ["depth"] and order.request["counts"] == [150] and order.objects == [obj.name]
    assert order.request["near_clip"] == pytest.approx(get_input(splat_modifier(obj), "Near Clip"))
    assert order.camera.width == scene.render.resolution_x and "samples" not in order.request


def test_a_picture_is_drawn_where_it_belongs():
    """By the ``gpu`` module, into a picture of its own."""
    if not hasattr(gpu, "init"):
        pytest.skip("this Blender has no gpu.init: nothing can be drawn without a window")
    gpu.init()
    pixels = np.random.default_rng(1).random((3, 5, 4), np.float32)
    pixels[..., 3] = 1
    off = gpu.types.GPUOffScreen(8, 6, format="RGBA32F")
    with off.bind():
        framebuffer = gpu.state.active_framebuffer_get()
        framebuffer.clear(color=(0, 0, 0, 0))
        with gpu.matrix.push_pop():
            gpu.matrix.load_matrix(Matrix.Identity(4))
            gpu.matrix.load_projection_matrix(
                Matrix(((2 / 8, 0, 0, -1), (0, 2 / 6, 0, -1), (0, 0, 1, 0), (0, 0, 0, 1)))
            )
            Blit().draw(pixels, 2, 1, 5, 3)
        read = framebuffer.read_color(0, 0, 8, 6, 4, 0, "FLOAT")
    found = np.array(read.to_list(), np.float32).reshape(6, 8, 4)
    off.free()
    expected = np.zeros((6, 8, 4), np.float32)
    expected[1:4, 2:7] = pixels[::-1]
    assert np.abs(found - expected).max() < 1e-3
