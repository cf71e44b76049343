"""The render engine: the picture of ``dogsplat render`` as a final frame, and what it refuses."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_pictures import as_srgb, picture, psnr, rendered, with_alpha
from edits import cropped, shown
from mathutils import Matrix
from model_files import load
from references import REFERENCES, place_camera, reference
from surroundings import background, link

from blender_addon import render_engine as engine
from blender_addon.cameras.objects import camera_numbers, rendered_part
from blender_addon.engine.order import make_order
from blender_addon.nodes.modifier import set_input, splat_modifier
from blender_addon.scene.sensor import sensor


class Rows:
    """Draws in place of the package: red is the column, green the row, blue how many pictures there were before."""

    name = "rows"

    def __init__(self, folder):
        self.folder, self.requests = folder, []

    def render(self, request, cancelled, progress, preview):
        camera = request["camera"]
        y, x = np.mgrid[0 : camera["height"], 0 : camera["width"]].astype(np.float32)
        color = np.stack([x, y, np.full_like(x, len(self.requests))], axis=2)
        self.requests.append(request)
        return {"color": color, "alpha": np.ones_like(x), "depth": x}


@pytest.fixture
def rows(scene, monkeypatch, tmp_path) -> Rows:
    """The engine draws by that, for the camera of a model."""
    renderer = Rows(tmp_path)
    monkeypatch.setattr(engine, "choose_renderer", lambda words: renderer)
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    scene.render.engine, scene.dogsplat_colors = engine.ENGINE, "DISPLAY"
    return renderer


@pytest.mark.parametrize("crop", [False, True])
def test_a_region_is_rendered_where_it_belongs(scene, rows, tmp_path, crop):
    """Alone, by the camera of that part."""
    render, (height, width) = scene.render, reference("square")["alpha"].shape
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.1, 0.55, 0.25, 0.8
    left, right = int(0.1 * width), int(0.55 * width)
    top, bottom = height - int(0.8 * height), height - int(0.25 * height)
    seen = picture(scene, engine.ENGINE, tmp_path)
    part = seen if crop else seen[top:bottom, left:right]
    assert part.shape[:2] == (bottom - top, right - left)
    assert part[0, 0].tolist() == [0, 0, 0] and part[-1, -1].tolist() == [right - left - 1, bottom - top - 1, 0]
    assert crop or (seen.shape[:2] == (height, width) and seen.sum() == pytest.approx(part.sum()))
    (request,) = rows.requests
    assert (request["camera"]["cx"], request["camera"]["cy"]) == pytest.approx((width / 2 - left, height / 2 - top))
    assert request["film"] == [-left, -top, width - left, height - top]


def test_a_region_is_what_the_whole_picture_has_there(scene, by_command, tmp_path, model):
    """Also of splats that are far outside of the region, whose shapes are held near the sides of the picture alone."""
    place_camera(scene, "dog")
    load(model)
    render, scene.dogsplat_colors = scene.render, "LINEAR"
    render.pixel_aspect_y = 1.25
    expected = with_alpha(scene, engine.ENGINE, tmp_path)
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.4, 0.6, 0.4, 0.6
    found = with_alpha(scene, engine.ENGINE, tmp_path)
    assert np.abs(found - expected[64 - 38 : 64 - 25, 38:57]).max() < 1e-5


def test_a_region_with_depth_of_field_is_what_the_whole_picture_has_there(scene, by_command, tmp_path, model):
    """Also where the lens is shifted, whose axis is in the middle of a larger film."""
    place_camera(scene, "dog")
    load(model)
    render, data = scene.render, scene.camera.data
    render.pixel_aspect_x = render.pixel_aspect_y = 1
    scene.dogsplat_colors, scene.dogsplat.samples = "LINEAR", 2
    data.shift_x, data.dof.use_dof, data.dof.focus_distance, data.dof.aperture_fstop = 0.1, True, 3.0, 0.5
    expected = with_alpha(scene, engine.ENGINE, tmp_path)
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.4, 0.6, 0.4, 0.6
    found = with_alpha(scene, engine.ENGINE, tmp_path)
    assert np.abs(found - expected[64 - 38 : 64 - 25, 38:57]).max() < 1e-5


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_the_sensor_of_a_region_of_a_scene_is_that_of_the_whole_picture(scene, kind):
    """Its film is a window of it."""
    place_camera(scene, "dog")
    obj, render = scene.camera, scene.render
    obj.data.type, obj.data.shift_x = kind, 0.1
    whole = camera_numbers(scene, obj)
    expected = sensor(scene, obj, whole)
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.4, 0.6, 0.4, 0.6
    window = {"crop_offset_x": 38, "crop_offset_y": 64 - 38, "crop_width": 19, "crop_height": 13}
    found = sensor(scene, obj, rendered_part(render, whole))
    assert found.pop("film") == {**expected.pop("film"), **window}
    assert found == expected


def test_a_size_in_percent_is_that_of_blender(scene, rows, tmp_path):
    """29 % of 800 is 232, though 0.29 times 800 is a little less."""
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 800, 100, 29
    seen = picture(scene, engine.ENGINE, tmp_path)
    assert seen.shape[:2] == (29, 232) and seen[-1, -1].tolist() == [231, 28, 0]


def test_each_eye_has_its_own_picture(scene, rows, tmp_path):
    """What is as far away as the eyes converge is at the same place in both."""
    scene.render.use_multiview = True
    scene.camera.data.stereo.convergence_distance = distance = 3.0
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.views_format = "PNG", "RGBA", "INDIVIDUAL"  # 4.2 reads no EXR
    scene.view_settings.view_transform, scene.render.filepath = "Raw", str(tmp_path / "eye.png")
    bpy.ops.render.render(write_still=True)
    for number, name in enumerate(("eye_L.png", "eye_R.png")):
        image = bpy.data.images.load(str(tmp_path / name))
        assert image.pixels[2:4] == pytest.approx((number, 1), abs=0.01)  # of 8 bits, dithered
    left, right = (request["camera"] for request in rows.requests)
    moved = np.array(right["w2c"]) @ np.linalg.inv(left["w2c"])
    assert np.allclose(moved[:3, 3], (-scene.camera.data.stereo.interocular_distance, 0, 0), atol=1e-5)
    ahead = moved @ (0, 0, distance, 1)
    assert right["fx"] * ahead[0] / ahead[2] + right["cx"] == pytest.approx(left["cx"], abs=1e-3)


def test_views_of_several_cameras_are_theirs(scene, rows):
    scene.render.use_multiview, scene.render.views_format = True, "MULTIVIEW"
    scene.camera.name = "camera_L"
    other = scene.camera.copy()
    other.name = "camera_R"
    scene.collection.objects.link(other)
    other.location.x += 1
    bpy.ops.render.render()
    cameras = [np.linalg.inv(request["camera"]["w2c"]) for request in rows.requests]
    places = [scene.camera.location, other.location]
    assert np.allclose([camera[:3, 3] for camera in cameras], [tuple(place) for place in places], atol=1e-5)


@pytest.mark.parametrize("kind", ["objects", "collections"])
def test_splats_of_a_linked_file_are_rendered_as_they_are_there(scene, rows, tmp_path, kind):
    """As objects, or as an instance of their collection; with what a crop leaves."""
    import addon_utils

    collection, obj = bpy.data.collections.new("Linked"), bpy.context.object
    obj.name = "Model"
    scene.collection.children.link(collection)
    collection.objects.link(obj)
    scene.collection.objects.unlink(obj)
    cropped(obj, "BOX")
    left = shown(obj).n_splats
    assert 0 < left < 150
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("blender_addon")
    scene = bpy.context.scene
    place_camera(scene, "square")
    with bpy.data.libraries.load(str(tmp_path / "source.blend"), link=True) as (_, wanted):
        setattr(wanted, kind, ["Model" if kind == "objects" else "Linked"])
    if kind == "objects":
        scene.collection.objects.link(wanted.objects[0])
    else:
        empty = bpy.data.objects.new("Instance", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", wanted.collections[0]
        scene.collection.objects.link(empty)
    scene.render.engine = engine.ENGINE
    for _ in range(2):  # the first leaves everything as it was
        bpy.ops.render.render()
    assert [request["counts"] for request in rows.requests] == 2 * [[left]]


def test_the_final_frame_is_the_picture_of_the_command(scene, by_command, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.view_settings.view_transform = "Raw"
    scene.dogsplat_colors = "DISPLAY"
    assert psnr(rendered(scene, engine.ENGINE, tmp_path), reference()["color"]) > 70


def test_nothing_colors_the_exact_picture(scene, rows, tmp_path):
    """Neither the look of the scene nor its white balance, which holds under Raw too."""
    view, render = scene.view_settings, scene.render
    view.exposure, view.gamma = 1.0, 2.0
    if hasattr(view, "use_white_balance"):
        view.use_white_balance, view.white_balance_temperature = True, 3000
    bpy.ops.dogsplat.exact_settings()
    render.image_settings.file_format, render.dither_intensity = "PNG", 0.0
    render.filepath = str(tmp_path / "out.png")
    rows.render = lambda request, *_: {"color": np.full((64, 96, 3), 0.5), "alpha": np.ones((64, 96))}
    bpy.ops.render.render(write_still=True)
    assert bpy.data.images.load(render.filepath).pixels[:3] == pytest.approx((0.5, 0.5, 0.5), abs=0.003)


def test_a_transparent_picture_over_white_is_the_exact_one(scene, by_command, tmp_path):
    """As any program lays a PNG over a page; so is it over any other color."""
    place_camera(scene, "plain")
    load(REFERENCES / "plain.ply")
    render, (color, alpha) = scene.render, (reference("plain")[name] for name in ("color", "alpha"))
    scene.view_settings.view_transform, render.engine, render.film_transparent = "Standard", engine.ENGINE, True
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGBA"
    render.filepath, render.dither_intensity = str(tmp_path / "out.png"), 0.0
    bpy.ops.render.render(write_still=True)
    pixels = np.array(bpy.data.images.load(render.filepath).pixels).reshape(*alpha.shape, 4)[::-1]
    over = pixels[..., 3:] * pixels[..., :3] + 1 - pixels[..., 3:]
    assert 0.1 < alpha.mean() < 0.9 and psnr(over, color + 1 - alpha[..., None]) > 45


def test_a_pixel_with_more_color_than_alpha_is_white(scene, rows, tmp_path):
    """As negative lobes leave it: no number that outshines all others."""
    scene.dogsplat_colors, scene.render.film_transparent = "LINEAR", True
    rows.render = lambda request, *_: {"color": np.full((64, 96, 3), 0.3), "alpha": np.full((64, 96), 0.001)}
    assert with_alpha(scene, engine.ENGINE, tmp_path) == pytest.approx(0.001, abs=1e-6)


def test_linear_colors_are_those_of_the_integrator(scene, by_command, tmp_path):
    place_camera(scene, "dog")
    load(REFERENCES / "dog.ply")
    scene.view_settings.view_transform = "Standard"
    linear = rendered(scene, engine.ENGINE, tmp_path)
    assert psnr(as_srgb(linear), reference()["color"]) > 70


def test_a_moved_and_hidden_model(scene, by_command, tmp_path):
    """Two models, of which one is hidden; the other is moved together with the camera."""
    place_camera(scene, "dog")
    hidden, shown = load(REFERENCES / "plain.ply"), load(REFERENCES / "dog.ply", up_axis="-Y", scale=2.0)
    hidden.hide_render = True
    matrix = shown.matrix_world.copy()
    scene.camera.matrix_world = (matrix @ scene.camera.matrix_world).normalized()
    set_input(splat_modifier(shown), "Near Clip", 0.4)  # twice as far now
    scene.dogsplat_colors = "DISPLAY"
    assert psnr(rendered(scene, engine.ENGINE, tmp_path), reference()["color"]) > 50


def test_what_is_done_so_far_is_shown_and_then_the_picture(scene, monkeypatch, tmp_path):
    """Blender takes one result after the other, and keeps the last."""
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    picture, shown = reference("square"), []

    class Gradual:
        name, folder = "gradual", tmp_path

        def render(self, request, cancelled, progress, preview):
            for factor in (0.0, 0.5):
                preview({**picture, "color": factor * picture["color"]})
                shown.append(factor)
            return picture

    monkeypatch.setattr(engine, "choose_renderer", lambda words: Gradual())
    scene.view_settings.view_transform, scene.dogsplat_colors = "Raw", "DISPLAY"
    assert np.abs(rendered(scene, engine.ENGINE, tmp_path) - picture["color"]).max() < 1e-5 and len(shown) == 2


@pytest.mark.parametrize(
    "prepare, message",
    [
        (lambda scene: load(REFERENCES / "dog.ply"), "no camera"),
        (lambda scene: place_camera(scene, "dog"), "no splats"),
    ],
)
def test_what_is_missing_in_the_scene_is_said(scene, by_command, prepare, message):
    prepare(scene)
    scene.render.engine = engine.ENGINE
    assert message in refusal()


def test_an_error_that_nobody_expects_writes_no_frame(scene, by_command, monkeypatch, tmp_path):
    """Blender writes one without a picture where an engine ends by an exception, and of OpenEXR ends itself."""

    def fails(*_):
        raise KeyError("color")

    monkeypatch.setattr(engine, "make_order", fails)
    place_camera(scene, "dog")
    scene.render.engine, scene.render.filepath = engine.ENGINE, str(tmp_path / "frame_")
    scene.frame_end = 2
    with pytest.raises(RuntimeError, match="KeyError: 'color'"):
        bpy.ops.render.render(animation=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", [lambda: None, lambda: bpy.data.meshes.new("mesh")])
def test_an_object_that_is_no_camera_is_refused(scene, by_command, make):
    """Blender looks through any."""
    load(REFERENCES / "dog.ply")
    scene.camera = bpy.data.objects.new("window", make())
    scene.collection.objects.link(scene.camera)
    scene.render.engine = engine.ENGINE
    assert '"window" has the type' in refusal()


def refusal() -> str:
    """What Blender reports of a render that fails, a line that it may repeat."""
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.render.render()
    (line,) = set(str(caught.value).strip().splitlines())
    return line


def test_nodes_of_the_world_that_are_left_out_are_said(scene, tmp_path):
    """Not where nobody sees the world."""
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    graph = bpy.context.evaluated_depsgraph_get
    assert make_order(graph(), tmp_path, []).notes == []
    strength = background(scene).inputs["Strength"]
    link(scene.world.node_tree, "ShaderNodeMath", "Value", strength)
    (note,) = make_order(graph(), tmp_path, []).notes
    assert "viewport color" in note
    scene.render.film_transparent = True
    assert make_order(graph(), tmp_path, []).notes == []


@pytest.mark.parametrize("send, colors, blurred", [
    ("SCENE", "LINEAR", True), ("SCENE", "DISPLAY", False), ("SPLATS", "LINEAR", False),
])  # fmt: skip
def test_depth_of_field_is_drawn_by_paths_or_said_to_be_left_out(scene, tmp_path, send, colors, blurred):
    """Of splats alone, too, of which the picture is sharp otherwise; motion blur there is in no picture."""
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    scene.dogsplat.send, scene.dogsplat_colors = send, colors
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert not order.whole and order.notes == []
    scene.camera.data.dof.use_dof = scene.render.use_motion_blur = True
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert order.whole == blurred and order.notes[0] == "motion blur is left out"
    if blurred:
        assert json.loads(Path(order.request["scene"]).read_text())["sensor"]["type"] == "thinlens"
    said = ["depth of field is left out; it needs Whole Scene and Linear colors"]
    assert order.notes[1:] == ([] if blurred else said)
    scene.camera.data.dof.aperture_blades = 5
    order = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, [])
    assert order.notes[1:] == (["the aperture is round, whatever its blades and ratio"] if blurred else said)


def test_a_bone_is_in_focus_where_it_is_posed(scene, tmp_path):
    place_camera(scene, "square")
    load(REFERENCES / "square.ply")
    bpy.ops.object.armature_add(enter_editmode=False)
    rig, dof = bpy.context.object, scene.camera.data.dof
    rig.matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -2))
    rig.pose.bones[0].matrix = Matrix.Translation((0, 0, -1))
    dof.use_dof, dof.focus_object = True, rig
    for bone, distance in (("", 2.0), (rig.pose.bones[0].name, 3.0)):
        dof.focus_subtarget = bone
        request = make_order(bpy.context.evaluated_depsgraph_get(), tmp_path, []).request
        assert json.loads(Path(request["scene"]).read_text())["sensor"]["focus_distance"] == pytest.approx(distance)
