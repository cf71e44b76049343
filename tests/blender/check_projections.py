"""Cameras that are no pinholes: parallel rays, which all engines draw as the package does, and panoramas of Cycles."""

import bpy
import numpy as np
import pytest
from blender_pictures import EEVEE, of_fine_pixels, picture, psnr, rendered
from live_views import SIZE, space_of_camera
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera, reference
from surroundings import background, body, material, plane

from blender_addon import render_engine as engine
from blender_addon.engine.order import make_order
from blender_addon.nodes.modifier import get_input, set_input, splat_modifier
from blender_addon.objects.attributes import read_attributes
from blender_addon.viewport.view import view_of
from blender_addon.viewport.watcher import Shown, show_models


def orthographic(scene, name: str):
    """The camera of a reference of parallel rays. Its lens would make another picture."""
    place_camera(scene, name)
    data = scene.camera.data
    data.type, data.ortho_scale = "ORTHO", data.sensor_width / data.lens
    data.lens = 7.0
    return scene.camera


@pytest.mark.parametrize("name, name_of_engine, least", [
    ("parallel", "CYCLES", 50), ("parallel", engine.ENGINE, 60), ("parallel_plain", EEVEE, 40),
])  # fmt: skip
def test_the_picture_of_parallel_rays_is_that_of_the_package(scene, by_command, tmp_path, name, name_of_engine, least):
    """Pixels are not square, the principal point is off the middle, and splats reach behind the camera."""
    orthographic(scene, name)
    load(REFERENCES / f"{name}.ply")
    bpy.ops.dogsplat.exact_settings()
    scene.dogsplat_colors = "DISPLAY"
    expected = reference(name)["color"]
    assert expected.std() > 0.05
    assert psnr(rendered(scene, name_of_engine, tmp_path), expected) > least


@pytest.mark.parametrize("show", ["Automatic", "Ellipsoids"])
def test_parallel_rays_see_the_same_from_any_distance(scene, tmp_path, show):
    camera = orthographic(scene, "parallel")
    obj = load(REFERENCES / "parallel.ply")
    set_input(splat_modifier(obj), "Show As", show)
    bpy.ops.dogsplat.exact_settings()
    camera.matrix_world @= Matrix.Translation((0, 0, 5))
    near = picture(scene, "CYCLES", tmp_path)
    camera.matrix_world @= Matrix.Translation((0, 0, 40))
    assert near.std() > 0.02 and psnr(picture(scene, "CYCLES", tmp_path), near) > 60


def test_quads_of_an_orthographic_view_are_those_of_such_a_camera(scene):
    camera = orthographic(scene, "parallel")
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    obj = load(REFERENCES / "parallel.ply")
    obj.matrix_world = Matrix.Rotation(0.3, 4, "Z") @ Matrix.Scale(1.2, 4)
    set_input(splat_modifier(obj), "Show As", "Quads")
    space = space_of_camera(scene, *SIZE)
    space.is_perspective = False
    corners = []
    for view in (None, view_of(space, *SIZE)):
        show_models(scene, Shown(), view)
        obj.update_tag()
        mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
        corners.append(np.array([vertex.co for vertex in mesh.vertices]))
        camera.location.x += 3  # the quads of the view do not follow
        bpy.context.view_layer.update()
    assert len(corners[0]) > 400 and np.allclose(*corners, atol=1e-4)


def test_a_scene_is_seen_along_parallel_rays(scene, by_command, tmp_path):
    """The edges of a wall, turned and off the middle, are where Cycles has them, near and far."""
    orthographic(scene, "parallel")
    scene.cycles.samples = scene.dogsplat.samples = 64
    background(scene, (0, 0, 0, 1))
    walls = [body(plane(0.5), material("ShaderNodeEmission", Color=(1, 1, 1, 1), Strength=1.0)) for _ in range(2)]
    for wall, place in zip(walls, ((-0.4, 0.2, -3), (0.5, 0.3, -30)), strict=True):
        wall.matrix_world = scene.camera.matrix_world @ Matrix.Translation(place) @ Matrix.Rotation(0.4, 4, (1, 2, 3))
    cycles, ours = (of_fine_pixels(scene, name, tmp_path)[..., 0] for name in ("CYCLES", engine.ENGINE))
    assert 0.05 < cycles.mean() < 0.5 and psnr(ours, cycles) > 30
    assert ours.sum() == pytest.approx(cycles.sum(), rel=0.02)


def test_depth_of_parallel_rays_is_the_same_with_a_scene_and_without(scene, command, tmp_path):
    """Along the axis, from the camera on."""
    orthographic(scene, "square_parallel")
    load(REFERENCES / "square_parallel.ply")
    scene.dogsplat.samples = 1
    found = []
    for send in ("SPLATS", "SCENE"):
        scene.dogsplat.send = send
        order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, ["depth"])
        assert order.whole is (send == "SCENE") and order.request["near_clip"] == pytest.approx(0.01)
        found.append(command.render(order.request, lambda: False, lambda share: None, lambda picture: None))
        wall = body(plane(0.01), material("ShaderNodeEmission", Strength=1.0))  # there is a scene from now on
        wall.location = scene.camera.matrix_world.translation + scene.camera.matrix_world.to_3x3().col[2]  # behind
    hit = found[0]["alpha"] > 0.5
    expected = reference("square_parallel")["depth"]
    assert hit.sum() > 100
    for picture_of in found:
        np.testing.assert_allclose(picture_of["depth"][hit], expected[hit], rtol=1e-3)


def test_what_takes_a_pinhole_refuses_an_orthographic_camera(scene, model, tmp_path):
    place_camera(scene, "dog")
    load(model)
    scene.camera.data.type = "ORTHO"
    with pytest.raises(RuntimeError, match="is orthographic; this needs a perspective camera"):
        bpy.ops.export_scene.dogsplat_path(filepath=str(tmp_path / "keys.json"))
    assert not any(tmp_path.iterdir())


def test_depth_of_field_of_an_orthographic_camera_is_said_to_be_left_out(scene, tmp_path):
    orthographic(scene, "parallel").data.dof.use_dof = True
    load(REFERENCES / "parallel.ply")
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert order.notes == ["depth of field is left out; it needs a perspective camera"]


def test_a_panorama_is_refused_by_our_engine(scene, by_command):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.camera.data.type = "PANO"
    scene.render.engine = engine.ENGINE
    with pytest.raises(RuntimeError, match="splats need a perspective or orthographic camera"):
        bpy.ops.render.render()


@pytest.mark.parametrize("lens", ["EQUIRECTANGULAR", "FISHEYE_EQUIDISTANT"])
def test_a_panorama_shows_points_as_large_as_its_pixels(scene, tmp_path, lens):
    """Three points around the camera: what the low-pass makes of each adds up to 0.6 π px² times its opacity, and as
    much more as the lens stretches there."""
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))  # along -z
    scene.collection.objects.link(scene.camera)
    scene.camera.data.type = "PANO"
    scene.camera.data.panorama_type, scene.camera.data.fisheye_fov = lens, 2.5
    obj = load(REFERENCES / "around.ply")
    bpy.ops.dogsplat.exact_settings()
    scene.render.resolution_x, scene.render.resolution_y = 256, 128 if lens == "EQUIRECTANGULAR" else 256
    seen = picture(scene, "CYCLES", tmp_path)
    assert get_input(splat_modifier(obj), "Show As") == "Automatic"
    means = read_attributes(obj.data).means
    _, up, back = (means / np.linalg.norm(means, axis=1, keepdims=True)).T
    if lens == "EQUIRECTANGULAR":
        stretched = 1 / np.sqrt(1 - up**2)
    else:
        angle = np.arccos(-back)
        stretched = np.where(angle < 1.25, angle / np.sin(angle), 0)
    assert (stretched > 1).sum() > 1
    assert seen.sum((0, 1)) == pytest.approx(0.6 * np.pi * 0.5 * stretched, rel=0.05)
