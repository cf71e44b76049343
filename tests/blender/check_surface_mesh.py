"""Surface Mesh: a ball of splats becomes a mesh that lies on it, wherever it stands, and whatever hides some of it."""

import shlex
import time

import bpy
import numpy as np
import pytest
from drawn_panels import Layout
from edits import PLACED
from mathutils import Matrix, Vector
from model_files import datablocks, load
from package_command import COMMAND

from blender_addon.evaluated.visible import _helps
from blender_addon.files.said import said_in
from blender_addon.files.sh import C0
from blender_addon.nodes.modifier import edit_modifiers, set_input, splat_modifier
from blender_addon.package.task import Task
from blender_addon.surface import operator
from blender_addon.surface.operator import DOGSPLAT_OT_surface_mesh, State, draw_surface
from blender_addon.surface.run import shown_model, written_comments

VOXEL = 0.1  # of a ball of radius 1
FEW = ["--views", "16", "--size", "96", "96"]
WARM, COOL = (1.0, 0.25, 0.0), (0.0, 0.5, 1.0)  # in the file above and below z = 0
NAMES = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()


def write_ball(path, hollow=False, n=800):
    """Opaque discs on the unit sphere, and, unless it is hollow, one opaque ball within."""
    k = np.arange(n)
    z, angle = 1 - (2 * k + 1) / n, np.pi * (3 - np.sqrt(5)) * k
    x, y = np.sqrt(1 - z * z) * (np.cos(angle), np.sin(angle))
    quats = np.stack([1 + z, -y, x, 0 * z], axis=1)  # from z to the normal
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    colors = (np.where(z[:, None] > 0, WARM, COOL) - 0.5) / C0
    scales = np.log(np.full((n, 3), (0.08, 0.08, 0.005)))
    rows = np.concatenate([np.stack([x, y, z], axis=1), colors, np.full((n, 1), 6.0), scales, quats], axis=1)
    within = [0, 0, 0, 0, 0, 0, 6, *np.log([0.4, 0.4, 0.4]), 1, 0, 0, 0]
    rows = rows if hollow else np.concatenate([rows, [within]])
    properties = [f"property float {name}" for name in NAMES]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}", *properties, "end_header\n"]
    path.write_bytes("\n".join(header).encode() + rows.astype("<f4").tobytes())
    return path


@pytest.fixture
def few(monkeypatch):
    """The package is found, and asked for fewer and smaller views than users have time for."""
    own = DOGSPLAT_OT_surface_mesh.flags
    monkeypatch.setattr(operator, "command_of", lambda context: shlex.join(COMMAND))
    monkeypatch.setattr(DOGSPLAT_OT_surface_mesh, "flags", lambda self: own(self) + FEW)


@pytest.fixture
def ball(few, tmp_path):
    """A ball whose z is Blender's y."""
    return load(write_ball(tmp_path / "ball.ply"), up_axis="-Y", scale=3.0)


@pytest.fixture
def in_window(monkeypatch):
    """The operator goes on as from its dialog, and what a timer would do is done by hand."""
    monkeypatch.setattr(DOGSPLAT_OT_surface_mesh, "in_dialog", True)
    told = []
    monkeypatch.setattr(operator, "tell", lambda context, trouble: told.append(trouble))  # needs a display
    yield told
    operator.stop()


def made(**options) -> bpy.types.Object:
    """What the operator makes; it is active then."""
    assert bpy.ops.dogsplat.surface_mesh(voxel=VOXEL, **options) == {"FINISHED"}
    bpy.context.view_layer.update()
    return bpy.context.object


def looked_after() -> None:
    """As the timer does, until it has nothing to look after."""
    while operator.look_after() is not None:
        time.sleep(0.02)


def points_of(surface: bpy.types.Object, matrix: Matrix) -> np.ndarray:
    """[V, 3] vertices in the world, and from there through a matrix."""
    points = np.empty(3 * len(surface.data.vertices), np.float32)
    surface.data.vertices.foreach_get("co", points)
    matrix = np.array(matrix @ surface.matrix_world)
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def bytes_of(surface: bpy.types.Object) -> np.ndarray:
    """[V, 3] as Blender keeps its colours."""
    attribute = surface.data.color_attributes["Color"]
    assert (attribute.data_type, attribute.domain) == ("BYTE_COLOR", "POINT")
    assert surface.data.color_attributes.active_color == attribute
    values = np.empty(4 * len(attribute.data), np.float32)
    attribute.data.foreach_get("color_srgb", values)
    return np.rint(255 * values.reshape(-1, 4))[:, :3]


def test_the_surface_lies_on_the_ball_wherever_it_stands(scene, ball):
    home = bpy.data.collections.new("home")
    scene.collection.children.link(home)
    scene.collection.objects.unlink(ball)
    home.objects.link(ball)
    ball.matrix_world = PLACED @ ball.matrix_world
    bpy.context.view_layer.update()
    radius, middle = 3 * PLACED.to_scale()[0], PLACED.to_translation()
    surface = made()
    points = points_of(surface, Matrix.Translation(-middle))
    distances = np.linalg.norm(points, axis=1)
    away = np.sort(abs(distances / radius - 1))
    assert len(away) > 500 and away[int(0.9 * len(away))] < 0.07 and away.max() < 0.3
    warm = points[bytes_of(surface)[:, 0] > 128].mean(axis=0)
    assert warm @ (PLACED.to_3x3().normalized() @ Vector((0, 1, 0))) > 0.99 * np.linalg.norm(warm)
    assert surface.parent == ball and surface.matrix_basis == surface.matrix_parent_inverse == Matrix()
    assert surface.name == "ball surface" and list(surface.users_collection) == [home]
    assert surface.hide_render and surface.display_type == "WIRE" and _helps(surface)
    assert bpy.context.selected_objects == [surface] and not surface.data.validate()
    ball.location.x += 5
    bpy.context.view_layer.update()
    moved = points_of(surface, Matrix.Translation(-middle))
    assert np.allclose(np.linalg.norm(moved - (5, 0, 0), axis=1), distances, atol=1e-4)


def test_the_surface_is_as_fine_as_its_voxel(ball):
    count = len(made().data.vertices)
    bpy.context.view_layer.objects.active = ball
    bpy.ops.dogsplat.surface_mesh(voxel=2 * VOXEL)
    assert 3 < count / len(bpy.context.object.data.vertices) < 5


def test_colors_are_those_of_the_splats(ball):
    """Bytes of the sRGB curve, in the file and in Blender. Few triangles have them, too."""
    surface = made(triangles=600)
    assert 300 < len(surface.data.polygons) <= 600
    z = points_of(surface, ball.matrix_world.inverted())[:, 2]
    for side, color in ((z > 0.2, WARM), (z < -0.2, COOL)):
        assert abs(np.median(bytes_of(surface)[side], axis=0) - 255 * np.array(color)).max() <= 2


def test_a_texture_has_the_colors_of_the_splats_and_is_there_to_be_seen(ball):
    """Where each vertex has its place in the picture, which the file keeps; it shines by itself."""
    before = datablocks()
    with pytest.raises(RuntimeError, match="set Most Triangles as well"):
        bpy.ops.dogsplat.surface_mesh(texture=128)
    assert datablocks() == before
    surface = made(triangles=600, texture=128)
    assert 300 < len(surface.data.polygons) <= 600 and not surface.data.validate()
    assert not surface.hide_render and surface.display_type == "TEXTURED" and surface.parent == ball
    (material,) = surface.data.materials
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    (link,) = shader.inputs["Emission Color"].links
    image = link.from_node.image
    assert tuple(image.size) == (128, 128) and image.packed_file and image.colorspace_settings.name == "sRGB"
    pixels, uv = np.empty(4 * 128 * 128, np.float32), np.empty(6 * len(surface.data.polygons), np.float32)
    image.pixels.foreach_get(pixels)
    surface.data.uv_layers[0].uv.foreach_get("vector", uv)
    column, row = np.clip((128 * uv.reshape(-1, 2)).astype(int), 0, 127).T  # rows count up from the bottom here
    corners = np.empty(3 * len(surface.data.polygons), np.int32)
    surface.data.loops.foreach_get("vertex_index", corners)
    z = points_of(surface, ball.matrix_world.inverted())[corners, 2]
    for side, color in ((z > 0.3, WARM), (z < -0.3, COOL)):
        shown = pixels.reshape(128, 128, 4)[row[side], column[side], :3]
        assert abs(np.median(shown, axis=0) - color).max() <= 0.02


def test_what_a_crop_hides_has_no_surface(ball):
    assert bpy.ops.dogsplat.add_crop(shape="BOX") == {"FINISHED"}
    target = next(other for other in bpy.context.selected_objects if other != ball)
    target.location.x += 3  # half of the ball
    bpy.context.view_layer.update()
    surface = made()
    x = points_of(surface, Matrix())[:, 0]
    assert -0.5 < x.min() < 0.4 and x.max() > 2.8


def test_the_largest_part_can_be_had_alone(ball, tmp_path):
    """Of two balls, one of which is smaller."""
    load(write_ball(tmp_path / "small.ply"), up_axis="-Y", scale=1.5).location.x = 8
    ball.select_set(True)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = ball
    bpy.ops.dogsplat.join()
    for largest, far in ((False, True), (True, False)):
        bpy.context.view_layer.objects.active = ball
        x = points_of(made(largest=largest), Matrix())[:, 0]
        assert (x.max() > 6) == far and x.min() < -2.7


def test_a_room_is_looked_at_from_within(few, tmp_path):
    """Of a hollow ball, the inner side alone is seen then."""
    room = load(write_ball(tmp_path / "room.ply", hollow=True))
    both = made()
    bpy.context.view_layer.objects.active = room
    inner = made(room=True)
    assert 0 < len(inner.data.polygons) < 0.8 * len(both.data.polygons)


def test_the_package_is_given_what_the_object_shows(model):
    """Up, near clip and antialiasing in the space of the object; DoG and bands of colour as they are drawn."""
    obj = load(model, up_axis="-Y", scale=4.0, antialiased=True)
    obj.rotation_euler.x += np.pi / 2
    bpy.context.view_layer.update()
    said = said_in(written_comments(obj))
    assert np.allclose(said.up, (0, 0, 1) if obj.matrix_world[2][2] > 0 else (0, 0, -1), atol=1e-6)
    assert said.antialiased and said.near_clip in (None, 0.2) and said.scale is None
    raw = shown_model(obj, bpy.context.evaluated_depsgraph_get())
    assert raw.is_dog.any() and raw.sh_degree == 3
    set_input(splat_modifier(obj), "DoG", False)
    set_input(splat_modifier(obj), "SH Degree", 1)
    obj.update_tag()
    drawn = shown_model(obj, bpy.context.evaluated_depsgraph_get())
    assert not drawn.is_dog.any() and drawn.sh_degree == 1


@pytest.mark.parametrize("lower", [0, 0.7])
def test_a_body_carries_what_falls_on_it(scene, ball, lower):
    """A small ball comes to rest on top of the splats, also where these are moved."""
    surface = made(body=True)
    body = surface.rigid_body
    assert (body.type, body.collision_shape, body.kinematic) == ("PASSIVE", "MESH", True)
    ball.location.z -= lower
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5, location=(0.01, 0.0, 4.5))
    bpy.ops.rigidbody.object_add(type="ACTIVE")
    falling = bpy.context.object
    falling.rigid_body.collision_shape = "SPHERE"
    heights = []
    for frame in range(1, 41):
        scene.frame_set(frame)
        heights.append(np.linalg.norm(falling.matrix_world.translation - ball.matrix_world.translation))
    assert heights[0] > 4.4 and 3.3 < min(heights) < 3.6


@pytest.mark.parametrize("background", [True, False])
def test_an_error_is_one_line_and_leaves_nothing(ball, in_window, monkeypatch, background, tmp_path):
    monkeypatch.setattr(DOGSPLAT_OT_surface_mesh, "in_dialog", not background)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    before = datablocks()
    if background:
        with pytest.raises(RuntimeError, match=r'^Error: "ball": .*voxel.*; use .*$') as caught:
            bpy.ops.dogsplat.surface_mesh(voxel=1e-7)
        assert len(str(caught.value).strip().splitlines()) == 1
    else:
        assert bpy.ops.dogsplat.surface_mesh(voxel=1e-7) == {"FINISHED"}
        looked_after()
        assert in_window == [State.trouble] and State.trouble.startswith('"ball": ') and "\n" not in State.trouble
    assert datablocks() == before and not list((tmp_path / "temporary").iterdir())
    assert bpy.context.object == ball and bpy.ops.dogsplat.surface_mesh.poll()


def test_what_has_no_surface_is_refused(ball, monkeypatch):
    monkeypatch.setattr(operator, "command_of", lambda context: "nothing_of_this_name")
    with pytest.raises(RuntimeError, match="nothing_of_this_name"):
        bpy.ops.dogsplat.surface_mesh()
    ball.scale.x = 0
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match='"ball": splats cannot be flattened'):
        bpy.ops.dogsplat.surface_mesh()
    ball.scale.x = 1
    bpy.ops.dogsplat.add_limits()
    set_input(edit_modifiers(ball)[0], "Minimum Size", 1000.0)
    ball.update_tag()
    with pytest.raises(RuntimeError, match='"ball": it shows no splats'):
        bpy.ops.dogsplat.surface_mesh()
    assert len(bpy.data.objects) == 1


def test_a_window_goes_on_meanwhile_and_gets_one_step_of_undo(ball, in_window):
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.dogsplat.surface_mesh(voxel=VOXEL) == {"FINISHED"}
    assert len(bpy.data.objects) == 1 and not bpy.ops.dogsplat.surface_mesh.poll()
    ball.name = "called otherwise"
    bpy.ops.object.mode_set(mode="EDIT")
    State.work.run.task.wait()
    assert operator.look_after() == operator.INTERVAL and len(bpy.data.objects) == 1
    bpy.ops.object.mode_set(mode="OBJECT")
    looked_after()
    assert [obj.name for obj in bpy.data.objects] == ["called otherwise", "called otherwise surface"] and not in_window
    bpy.ops.ed.undo()
    assert [obj.name for obj in bpy.data.objects] == ["ball"]
    bpy.ops.ed.redo()
    assert len(bpy.data.objects) == 2


def test_a_surface_of_what_was_there_before_is_given_up(ball, in_window):
    assert bpy.ops.dogsplat.surface_mesh(voxel=VOXEL) == {"FINISHED"}
    ball.rotation_euler.x += 1
    bpy.context.view_layer.update()
    bpy.ops.dogsplat.apply_transform()
    looked_after()
    assert len(bpy.data.objects) == 1 and "were moved or deleted" in in_window[0]
    assert bpy.ops.dogsplat.surface_mesh(voxel=VOXEL) == {"FINISHED"}
    bpy.data.objects.remove(ball)
    looked_after()
    assert not bpy.data.objects and "were moved or deleted" in in_window[1]


def test_stopping_and_another_file_end_the_process(ball, in_window, tmp_path):
    for end in (lambda: bpy.ops.dogsplat.stop_surface_mesh(), lambda: bpy.ops.wm.read_homefile(use_empty=True)):
        assert bpy.ops.dogsplat.surface_mesh() == {"FINISHED"}
        run = State.work.run
        assert run.task.works and run.out.parent.is_dir()
        end()
        assert not run.task.works and not run.out.parent.exists()
        assert operator.look_after() is None and not bpy.ops.dogsplat.stop_surface_mesh.poll()


def test_the_panel_shows_how_far_it_is(ball, in_window):
    layout = Layout()
    draw_surface(layout)
    assert layout.drawn == ["dogsplat.surface_mesh"]
    assert bpy.ops.dogsplat.surface_mesh(voxel=VOXEL) == {"FINISHED"}
    layout.drawn.clear()
    draw_surface(layout)
    assert layout.drawn == ["Surface Mesh", "dogsplat.stop_surface_mesh"]


def test_a_task_tells_how_much_is_done(tmp_path):
    said = r"import sys; sys.stderr.write('  1%|  | 3/288\r 41%|##  | 118/288\r'); sys.exit(3)"
    task = Task([COMMAND[0], "-c", said], tmp_path / "log.txt")
    task.wait()
    assert task.share == 0.41 and not task.works
