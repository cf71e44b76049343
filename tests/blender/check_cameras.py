"""Imported cameras: Blender sees a point at the pixel where the data set has it."""

import json
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from edits import only_an_instance
from mathutils import Matrix, Vector
from model_files import datablocks, load
from package_command import by_package
from references import REFERENCES

from blender_addon.cameras.objects import camera_numbers, look_through
from blender_addon.cameras.read import read_cameras
from blender_addon.evaluated.placed import placed_splats
from blender_addon.nodes.modifier import get_input, splat_modifier

HALF_A_PIXEL = 0.5


def blender_pixels(scene, camera, points):
    """Pixels [P, 2] from the top left, by Blender's own function (which knows the shift, not the size)."""
    look_through(scene, camera)
    bpy.context.view_layer.update()
    width, height = scene.render.resolution_x, scene.render.resolution_y
    seen = [world_to_camera_view(scene, camera, Vector(p)) for p in points]
    return np.array([(s.x * width, (1 - s.y) * height) for s in seen])


def projected(w2c, fx, fy, cx, cy, points):
    local = points @ w2c[:3, :3].T + w2c[:3, 3]
    return local[:, :2] / local[:, 2:] * (fx, fy) + (cx, cy)


def points_before(w2c, n=20):
    """In front of a camera, inside of its picture or nearly so."""
    rng = np.random.default_rng(0)
    local = rng.uniform((-0.5, -0.5, 1), (0.5, 0.5, 1), (n, 3)) * rng.uniform(1, 5, (n, 1))
    return (local - w2c[:3, 3]) @ w2c[:3, :3]


@pytest.fixture
def odd(tmp_path):
    """A data set with a principal point off the middle and pixels that are not square."""
    camera = json.loads((REFERENCES / "dog.json").read_text())
    c2w = np.linalg.inv(camera["w2c"]) @ np.diag([1, -1, -1, 1])
    frame = {"file_path": "images/7.png", "transform_matrix": c2w.tolist()}
    names = {"fl_x": "fx", "fl_y": "fy", "cx": "cx", "cy": "cy", "w": "width", "h": "height"}
    content = {key: camera[name] for key, name in names.items()} | {"frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    return tmp_path, camera


def test_principal_point_and_pixel_aspect(odd, scene):
    folder, camera = odd
    bpy.ops.import_scene.dogsplat_cameras(filepath=str(folder))
    w2c = np.array(camera["w2c"])
    points = points_before(w2c)
    expected = projected(w2c, *(camera[k] for k in ("fx", "fy", "cx", "cy")), points)
    assert np.abs(blender_pixels(scene, scene.camera, points) - expected).max() < 1e-2
    numbers = camera_numbers(scene, scene.camera)
    assert np.allclose(numbers.w2c, w2c, atol=1e-5)
    for name in ("fx", "fy", "cx", "cy", "width", "height"):
        assert getattr(numbers, name) == pytest.approx(camera[name], rel=1e-5)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", [(300, 200), (200, 300)])
def test_any_camera_of_blender_has_the_intrinsics_that_the_nodes_are_told(scene, model, fit, size):
    obj = load(model)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    data, render = camera.data, scene.render
    data.sensor_fit, data.sensor_width, data.sensor_height = fit, 30.0, 22.0
    data.lens, data.shift_x, data.shift_y = 40.0, 0.1, -0.07
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 50
    render.pixel_aspect_x, render.pixel_aspect_y = 1.0, 1.25
    camera.matrix_world = Matrix.Translation((0.3, 0.2, 9)) @ Matrix.Rotation(0.1, 4, "X")
    bpy.context.view_layer.update()
    numbers = camera_numbers(scene, camera)
    points = points_before(numbers.w2c)
    seen = np.array([tuple(world_to_camera_view(scene, camera, Vector(p)))[:2] for p in points])
    expected = seen * (1, -1) * (numbers.width, numbers.height) + (0, numbers.height)
    found = projected(numbers.w2c, numbers.fx, numbers.fy, numbers.cx, numbers.cy, points)
    assert np.abs(found - expected).max() < 1e-2
    modifier = splat_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    names = {"Focal X": "fx", "Focal Y": "fy", "Center X": "cx", "Center Y": "cy", "Width": "width", "Height": "height"}
    for name, key in names.items():
        assert get_input(modifier, name) == pytest.approx(getattr(numbers, key), rel=1e-5)


@pytest.mark.parametrize("up_axis, applied", [("Z", False), ("-Z", False), ("Y", False), ("-Y", False), ("-Y", True)])
def test_cameras_follow_the_model(odd, scene, model, up_axis, applied):
    """Also where its transform became part of the splats."""
    folder, camera = odd
    obj = load(model, up_axis=up_axis, scale=3.0)
    placed = obj.matrix_world.copy()
    if applied:
        bpy.ops.dogsplat.apply_transform()
    bpy.ops.import_scene.dogsplat_cameras(filepath=str(folder))
    w2c = np.array(camera["w2c"])
    points = points_before(w2c)
    moved = [placed @ Vector(p) for p in points]
    expected = projected(w2c, *(camera[k] for k in ("fx", "fy", "cx", "cy")), points)
    assert np.abs(blender_pixels(scene, scene.camera, moved) - expected).max() < 2e-2


def test_cameras_follow_a_model_that_was_moved_while_it_was_hidden(odd, scene, model):
    folder, camera = odd
    obj = load(model)
    obj.hide_viewport = True
    bpy.context.view_layer.update()
    obj.location = 1, 2, 3
    bpy.context.view_layer.objects.active = obj
    bpy.ops.import_scene.dogsplat_cameras(filepath=str(folder))
    w2c = np.array(camera["w2c"])
    points = points_before(w2c)
    expected = projected(w2c, *(camera[k] for k in ("fx", "fy", "cx", "cy")), points)
    moved = [Vector(p) + Vector((1, 2, 3)) for p in points]
    assert np.abs(blender_pixels(scene, scene.camera, moved) - expected).max() < 2e-2


def test_cameras_follow_the_instance_of_a_model(odd, scene, model):
    """As of a collection that is linked from another file."""
    folder, camera = odd
    only_an_instance(scene, load(model, up_axis="-Y", scale=3.0))
    ((_, placed, _),) = placed_splats(bpy.context.evaluated_depsgraph_get())
    bpy.ops.import_scene.dogsplat_cameras(filepath=str(folder))
    w2c = np.array(camera["w2c"])
    points = points_before(w2c)
    expected = projected(w2c, *(camera[k] for k in ("fx", "fy", "cx", "cy")), points)
    moved = [Matrix(placed) @ Vector(p) for p in points]
    assert np.abs(blender_pixels(scene, scene.camera, moved) - expected).max() < 2e-2


def test_cameras_of_a_mirrored_model_see_as_far(odd, scene, model):
    load(model).scale = -2, 2, 2
    bpy.context.view_layer.update()
    bpy.ops.import_scene.dogsplat_cameras(filepath=str(odd[0]))
    data = scene.camera.data
    assert (data.clip_start, data.clip_end, data.display_size) == pytest.approx((0.02, 2e4, 0.2))


SOURCES = "fox", "fox/transforms.json", "fern", "lego"
BY_PACKAGE = """
import json, sys
from mi_dogsplat.datasets import load_dataset
def read(source):
    cameras = {view.name: view.camera for view in load_dataset(source, 4).views}
    return {name: (c.w2c.tolist(), (c.fx, c.fy, c.cx, c.cy)) for name, c in cameras.items()}
print(json.dumps([read(source) for source in sys.argv[1:]]))
"""


@pytest.fixture(scope="module")
def of_package(shared):
    """The cameras of all real data sets, as the package reads them in a process of its own."""
    return dict(zip(SOURCES, by_package(BY_PACKAGE, *(str(shared / source) for source in SOURCES)), strict=True))


@pytest.mark.parametrize("source", SOURCES)
def test_real_data_sets_agree_with_the_package(shared, scene, of_package, source):
    """Every camera is compared."""
    expected = of_package[source]
    bpy.ops.import_scene.dogsplat_cameras(filepath=str(shared / source), downscale=4)
    (collection,) = (c for c in bpy.data.collections if c.name.startswith("Cameras"))
    cameras = {obj.name: obj for obj in collection.objects}
    assert set(cameras) == set(expected) and scene.camera in cameras.values()
    for name, (w2c, k) in expected.items():
        w2c = np.array(w2c)
        points = points_before(w2c, 4)
        pixels = blender_pixels(scene, cameras[name], points)
        assert np.abs(pixels - projected(w2c, *k, points)).max() < 0.02 < HALF_A_PIXEL
    background = scene.camera.data.background_images[0]
    assert scene.camera.data.show_background_images and Path(bpy.path.abspath(background.image.filepath)).is_file()


def test_a_run_folder_has_the_cameras_of_its_data_at_its_size(shared, scene, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"data": str(shared / "fox"), "downscale": 2}))
    bpy.ops.import_scene.dogsplat_cameras(filepath=str(tmp_path / "config.json"))
    assert (scene.render.resolution_x, scene.render.resolution_y) == (225, 400)


@pytest.mark.parametrize("run, data, noted", [
    ("runs/run", "set", "set"),
    ("moved/run", "moved/set", "set"),  # both, since then
    ("run", "set", None),  # by a version that noted nothing
])  # fmt: skip
def test_a_run_folder_finds_data_that_were_named_relative_to_another_folder(odd, scene, run, data, noted):
    """By the place that the run notes, or beside it."""
    folder, _ = odd
    (folder / run / "checkpoint").mkdir(parents=True)
    (folder / run / "config.json").write_text(json.dumps({"data": "set"}))
    if noted:
        (folder / run / "checkpoint" / "inputs.json").write_text(json.dumps({"data": str(folder / noted)}))
    (folder / data).mkdir()
    (folder / "transforms.json").rename(folder / data / "transforms.json")
    assert bpy.ops.import_scene.dogsplat_cameras(filepath=str(folder / run)) == {"FINISHED"}
    assert scene.camera.name == "7"


def test_cameras_of_bent_photographs_come_with_a_warning(odd, scene, capfd):
    folder, camera = odd
    content = json.loads((folder / "transforms.json").read_text())
    (folder / "transforms.json").write_text(json.dumps({**content, "k1": -0.1}))
    assert bpy.ops.import_scene.dogsplat_cameras(filepath=str(folder)) == {"FINISHED"}
    assert camera_numbers(scene, scene.camera).fx == pytest.approx(camera["fx"], rel=1e-5)
    assert "Warning: 1 cameras imported, 1 without lens distortion" in capfd.readouterr().out


def test_text_and_binary_models_of_colmap_are_the_same(shared, tmp_path):
    binary = {c.name: c for c in read_cameras(shared / "fox", lambda path: (0, 0))[0]}
    folder = tmp_path / "sparse" / "0"
    folder.mkdir(parents=True)
    first = next(iter(binary.values()))
    (folder / "cameras.txt").write_text(
        f"# c\n1 PINHOLE {first.width} {first.height} {first.fx} {first.fy} {first.cx} {first.cy}\n"
    )
    lines = []
    for i, camera in enumerate(binary.values()):
        quat = Matrix(camera.w2c[:3, :3]).to_quaternion()
        lines += [
            f"{i} {' '.join(map(repr, quat))} {' '.join(map(repr, camera.w2c[:3, 3].tolist()))} 1 {camera.name}.jpg",
            "",
        ]
    (folder / "images.txt").write_text("\n".join(["# images", *lines]))
    text = read_cameras(tmp_path, lambda path: (0, 0))[0]
    assert [c.name for c in text] == sorted(binary)
    for camera in text:
        assert np.allclose(camera.w2c, binary[camera.name].w2c, atol=1e-5) and camera.fx == first.fx


@pytest.mark.parametrize("start", ["", "\ufeff", "\n"])
def test_text_files_may_begin_with_a_mark_or_an_empty_line(odd, tmp_path, start):
    """As the package reads them: an image may have no observed points, and more empty lines may follow."""
    file = tmp_path / "transforms.json"
    file.write_text(start + file.read_text(), encoding="utf-8")
    assert [camera.name for camera in read_cameras(tmp_path, lambda path: (0, 0))[0]] == ["7"]
    model = tmp_path / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text(f"{start}# cameras\n1 PINHOLE 40 30 50 51 20 15\n", encoding="utf-8")
    rows = [f"{i} 1 0 0 0 {i} 0 0 1 ü {i}.png\n{points}\n" for i, points in enumerate(("\n", "1 2 -1", ""))]
    (model / "images.txt").write_text(f"{start}# images\n{start}{''.join(rows)}".replace("\n\ufeff", "\n"), "utf-8")
    cameras = read_cameras(tmp_path, lambda path: (0, 0))[0]
    assert [(c.name, c.w2c[0, 3], c.fy) for c in cameras] == [(f"ü {i}", i, 51) for i in range(3)]


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("transforms.json", "{", "line 1"),
        ("transforms.json", '{"frames": []}', "no cameras"),
        ("transforms.json", '{"frames": [{"file_path": "a"}]}', "transform_matrix"),
        (
            "transforms.json",
            '{"frames": [{"file_path": "a", "transform_matrix": [[1]], "w": 1, "h": 1, "fl_x": 1}]}',
            "pose",
        ),
        (
            "transforms.json",
            '{"frames": [{"file_path": "a", "transform_matrix": [[1]], "w": 1, "h": 1, "fl_x": 1, '
            '"camera_model": "THIN_PRISM_FISHEYE"}]}',
            "lens THIN_PRISM_FISHEYE",
        ),
        (
            "transforms.json",
            '{"frames": [{"file_path": "a", "transform_matrix": [[1]], "w": 20, "h": 15, "fl_x": 1, "cx": 0.5, '
            '"cy": 0.4}]}',
            "cx 0.5 and cy 0.4 of an image of 20x15 are shares of its sides, not pixels; correct its numbers",
        ),
        ("config.json", '{"data": "/nowhere"}', "/nowhere"),
        ("config.json", '{"downscale": 2}', "data set"),
        ("config.json", '{"data": "/", "downscale": "x"}', "downscale"),
        ("config.json", '{"data": "/", "downscale": 0}', "downscale"),
    ],
)
def test_bad_cameras_are_one_line_and_leave_nothing(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    before = datablocks()
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.import_scene.dogsplat_cameras(filepath=str(tmp_path))
    line = str(caught.value).strip()
    assert "\n" not in line and name in line and message in line
    assert datablocks() == before


def test_a_colmap_camera_in_shares_of_its_sides_is_one_line(tmp_path):
    model = tmp_path / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text("1 PINHOLE 40 30 50 51 0.5 0.5\n")
    (model / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    message = "camera 1: cx 0.5 and cy 0.5 of an image of 40x30 are shares .*; multiply them by width and height"
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.import_scene.dogsplat_cameras(filepath=str(tmp_path))


def test_a_truncated_colmap_model_is_one_line(shared, tmp_path):
    folder = tmp_path / "sparse" / "0"
    shutil.copytree(shared / "fox" / "sparse" / "0", folder)
    (folder / "images.bin").chmod(0o644)
    whole = (folder / "images.bin").read_bytes()
    (folder / "images.bin").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RuntimeError, match="images.bin.*export the model again"):
        bpy.ops.import_scene.dogsplat_cameras(filepath=str(tmp_path))
