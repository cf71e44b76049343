"""Pictures of viewports that our engine draws, by both ways to the package; the window itself would need a display."""

from types import SimpleNamespace

import bpy
import gpu
import numpy as np
import pytest
from blender_pictures import as_srgb
from live_views import SIZE, last, staged, through_the_camera
from mathutils import Matrix
from model_files import load
from package_command import never
from references import REFERENCES, place_camera, reference
from surroundings import background, link, plane

from blender_addon.engine.passes import world_color
from blender_addon.files.srgb import decoded
from blender_addon.objects.working_space import to_working
from blender_addon.scene.sockets import output_of
from blender_addon.viewport.blit import Blit
from blender_addon.viewport.pace import LEVELS, Level
from blender_addon.viewport.region import seen_by
from blender_addon.viewport.rendered import request_of


def test_a_viewport_at_rest_shows_the_final_picture(scene, live, tmp_path):
    """Through the same camera, of pixels that are not square: what make_order asks for, drawn by the same package."""
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    seen = through_the_camera(scene)
    stage = staged(tmp_path, seen.camera)
    assert not stage.whole
    expected = reference("dog")
    scene.render.film_transparent, scene.dogsplat_colors = True, "DISPLAY"
    found = last(live, request_of(stage, scene, seen, Level(), rests=True))
    assert np.abs(found[..., :3] - expected["color"]).max() < 2e-3
    assert np.abs(found[..., 3] - expected["alpha"]).max() < 2e-3
    scene.dogsplat_colors = "LINEAR"
    found, share = last(live, request_of(stage, scene, seen, Level(), rests=True)), expected["alpha"][..., None]
    share = np.maximum(share, 1e-6)  # which rings may leave below
    color = share * decoded(np.minimum(expected["color"] / share, 1))
    assert np.abs(found[..., :3] - color).max() < 4e-3
    scene.render.film_transparent = False
    background(scene, (0.25, 0.25, 0.25, 1))
    found = last(live, request_of(stage, scene, seen, Level(), rests=True))
    color = decoded(expected["color"] + (1 - expected["alpha"][..., None]) * as_srgb(np.float64(0.25)))
    assert np.abs(found[..., :3] - color).max() < 4e-3 and (found[..., 3] == 1).all()


def test_a_scene_is_lit_at_the_camera_while_it_moves_and_path_traced_at_rest(scene, live, tmp_path):
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    wall = plane(200)
    wall.matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -20))
    scene.dogsplat.samples = 3
    seen = through_the_camera(scene)
    stage = staged(tmp_path, seen.camera)
    assert stage.whole
    small = seen.scaled(0.25)
    moving = last(live, request_of(stage, scene, small, LEVELS[-1], rests=False))
    assert moving.shape == (16, 24, 4) and (moving[..., 3] == 1).all() and moving[..., :3].max() > 0.3
    resting = list(live.pictures(request_of(stage, scene, small, Level(), rests=True), never))
    assert [share for share, _ in resting] == pytest.approx([1 / 3, 1])
    far = reference("square")["alpha"].reshape(16, 4, 24, 4).max((1, 3)) == 0
    assert far.any() and moving[far][:, :3].min() > 0.2
    assert resting[-1][1][far][:, :3].mean() < 0.05  # no lamp, no world: only splats shine on the wall


def test_the_color_behind_splats_is_of_the_node_that_the_world_shows(scene):
    """And of no node where they are not in use, which older Blenders offer."""
    unused = background(scene, (0.1, 0.1, 0.1, 1))
    tree = scene.world.node_tree
    shown = link(tree, "ShaderNodeBackground", "Background", output_of(tree).inputs["Surface"])
    shown.inputs["Color"].default_value, shown.inputs["Strength"].default_value = (0.2, 0.3, 0.4, 1), 2.0
    assert np.allclose(world_color(scene.world), (0.4, 0.6, 0.8)) and not unused.outputs[0].is_linked
    link(tree, "ShaderNodeRGB", "Color", shown.inputs["Color"]).outputs[0].default_value = (0.1, 0.3, 0.2, 1)
    link(tree, "ShaderNodeValue", "Value", shown.inputs["Strength"]).outputs[0].default_value = 3.0
    assert np.allclose(world_color(scene.world), (0.3, 0.9, 0.6))
    scene.world.color = (0.7, 0.6, 0.5)
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = False
        assert np.allclose(world_color(scene.world), (0.7, 0.6, 0.5))
        scene.world.use_nodes = True
    tree.nodes.remove(shown)
    assert not world_color(scene.world).any()
    assert not world_color(None).any()


def test_parallel_rays_show_what_the_near_clip_would_hide(scene, live_command, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    pose = scene.camera.matrix_world.normalized()
    projection = Matrix(((0.2, 0, 0, 0), (0, 0.3, 0, 0), (0, 0, -0.001, 0), (0, 0, 0, 1)))
    seen = seen_by(SimpleNamespace(view_matrix=pose.inverted(), window_matrix=projection, is_perspective=False), *SIZE)
    stage = staged(tmp_path, seen.camera)
    assert last(live_command, request_of(stage, scene, seen, Level(), rests=True))[..., :3].max() > 0.1


def blitted(pixels, **options):
    """[6, 8, 4] from the bottom: 3 rows and 5 columns of pixels, drawn by the ``gpu`` module at (2, 1)."""
    if not hasattr(gpu, "init"):
        pytest.skip("this Blender has no gpu.init: nothing can be drawn without a window")
    gpu.init()
    off = gpu.types.GPUOffScreen(8, 6, format="RGBA32F")
    with off.bind():
        framebuffer = gpu.state.active_framebuffer_get()
        framebuffer.clear(color=(0, 0, 0, 0))
        with gpu.matrix.push_pop():
            gpu.matrix.load_matrix(Matrix.Identity(4))
            gpu.matrix.load_projection_matrix(
                Matrix(((2 / 8, 0, 0, -1), (0, 2 / 6, 0, -1), (0, 0, 1, 0), (0, 0, 0, 1)))
            )
            Blit().draw(pixels, 2, 1, 5, 3, **options)
        read = framebuffer.read_color(0, 0, 8, 6, 4, 0, "FLOAT")
    found = np.array(read.to_list(), np.float32).reshape(6, 8, 4)
    off.free()
    return found


@pytest.fixture
def pixels():
    values = np.random.default_rng(1).random((3, 5, 4), np.float32)
    values[..., 3] = 1
    return values


def test_a_picture_is_drawn_where_it_belongs(pixels):
    expected = np.zeros((6, 8, 4), np.float32)
    expected[1:4, 2:7] = pixels[::-1]
    assert np.abs(blitted(pixels) - expected).max() < 1e-3


@pytest.mark.parametrize("linear", [False, True])
def test_linear_colors_are_drawn_in_the_working_space(pixels, linear):
    """Which values of a file know nothing of."""
    if not hasattr(bpy.data, "colorspace"):
        pytest.skip("files have a working space of their own from Blender 5.0 on")
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=True)
    expected = np.concatenate([to_working(pixels[..., :3]), pixels[..., 3:]], axis=2) if linear else pixels
    assert np.abs(blitted(pixels, linear=linear)[1:4, 2:7] - expected[::-1]).max() < 1e-3
    assert (np.abs(expected - pixels).max() > 0.05) == linear
