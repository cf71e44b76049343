"""transforms.json of instant-ngp, nerfstudio and NeRF synthetic, and one line for each kind of damage."""

import json

import numpy as np
import pytest
from dataset_folders import (
    HEIGHT,
    WIDTH,
    colmap_folder,
    error_of,
    transforms_folder,
    write_images,
)
from icc_profiles import DISPLAY_P3, SRGB_CURVE, profile, srgb_of
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.masks import Masks, mask_files
from mi_dogsplat.datasets.transforms import not_read
from mi_dogsplat.scene.cameras import OPENCV_FROM_OPENGL, affine
from mi_dogsplat.scene.orientation import rotation_between
from PIL import Image


def test_a_transforms_file_with_an_angle_and_no_extensions_gives_opengl_cameras(tmp_path):
    dataset = load_dataset(transforms_folder(tmp_path, n=9))
    assert [view.name for view in dataset.test] == ["r_0", "r_8"]
    camera = dataset.train[0].camera
    np.testing.assert_allclose(camera.fx, 0.5 * WIDTH / np.tan(0.35))
    assert camera.fy == camera.fx and (camera.cx, camera.cy) == (WIDTH / 2, HEIGHT / 2)
    np.testing.assert_allclose(camera.project([(0.2, 0, -2)])[1], 2)


def test_intrinsics_of_a_frame_override_those_at_the_top(tmp_path):
    transforms_folder(tmp_path, fl_x=30, fl_y=31, cx=9, cy=8, w=WIDTH, h=HEIGHT)
    content = json.loads((tmp_path / "transforms.json").read_text())
    content["frames"][1] |= {"fl_x": 40, "fl_y": 42}
    content["frames"][2]["cx"] = 10
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    focal = {
        view.name: (view.camera.fx, view.camera.fy, view.camera.cx) for view in load_dataset(tmp_path).views
    }
    assert focal == {"r_0": (30, 31, 9), "r_1": (40, 42, 9), "r_2": (30, 31, 10)}


@pytest.mark.parametrize(
    "top, said, expected",
    [
        ({"fl_x": 30, "fl_y": 31}, {"fl_x": 40}, (40, 40)),
        ({"fl_x": 30, "fl_y": 31}, {"fl_y": 40}, (40, 40)),
        ({"fl_x": 30}, {"fl_y": 40}, (30, 40)),  # each says one
        ({"fl_y": 31}, {"fl_x": 40}, (40, 31)),
        ({"camera_angle_y": 0.5}, {"fl_y": 40}, (40, 40)),
    ],
)
def test_a_focal_length_of_a_frame_alone_means_square_pixels(tmp_path, top, said, expected):
    """As instant-ngp has it; that along the other side at the top was kept, which is of other frames."""
    content = json.loads((transforms_folder(tmp_path) / "transforms.json").read_text())
    del content["camera_angle_x"]
    content["frames"][1] |= said
    (tmp_path / "transforms.json").write_text(json.dumps({**content, **top}))
    camera = next(view.camera for view in load_dataset(tmp_path).views if view.name == "r_1")
    assert (camera.fx, camera.fy) == expected


def test_an_angle_of_a_frame_overrides_focal_lengths_at_the_top(tmp_path):
    """As instant-ngp has it."""
    content = json.loads((transforms_folder(tmp_path) / "transforms.json").read_text())
    content["frames"][1]["camera_angle_x"] = 0.35
    transforms_folder(tmp_path, fl_x=30, fl_y=31, frames=content["frames"])
    focal = {view.name: (view.camera.fx, view.camera.fy) for view in load_dataset(tmp_path).views}
    wide = pytest.approx(0.5 * WIDTH / np.tan(0.175))
    assert focal == {"r_0": (30, 31), "r_1": (wide, wide), "r_2": (30, 31)}


def test_cameras_of_mitsuba_look_ahead_along_z(tmp_path):
    """instant-ngp knows them by this key; x points left in them, and y up."""
    camera = load_dataset(transforms_folder(tmp_path, normal_mts_args=[])).views[0].camera
    (pixel,), (depth,) = camera.project([camera.position + (0.5, 0.5, 2)])
    assert depth == pytest.approx(2)
    assert pixel == pytest.approx((WIDTH / 2 - camera.fx / 4, HEIGHT / 2 - camera.fy / 4))


def test_the_split_is_taken_from_the_train_and_test_files_or_from_test_filenames(tmp_path):
    transforms_folder(tmp_path / "a", "transforms_train.json", 3, "train")
    transforms_folder(tmp_path / "a", "transforms_test.json", 2, "test")
    dataset = load_dataset(tmp_path / "a")
    assert [view.name for view in dataset.test] == ["test_r_0", "test_r_1"] and len(dataset.train) == 3
    dataset = load_dataset(transforms_folder(tmp_path / "b", test_filenames=["images/r_1.png", "", "/"]))
    assert [view.name for view in dataset.test] == ["r_1"]


@pytest.mark.parametrize("tests", [{}, {"test_filenames": []}, {"test_filenames": ["images/r_4.png"]}])
def test_no_image_is_trained_on_that_the_train_filenames_leave_out(tmp_path, tests):
    """As nerfstudio has it; where no test images are named, those of ``val_filenames`` are measured."""
    named = {"train_filenames": ["images/r_0.png", "images/r_1.png"], "val_filenames": ["images/r_2.png"], **tests}
    dataset = load_dataset(transforms_folder(tmp_path, n=5, **named))
    assert [view.name for view in dataset.train] == ["r_0", "r_1"]
    assert [view.name for view in dataset.test] == (["r_4"] if tests.get("test_filenames") else ["r_2"])


def test_train_filenames_alone_are_split_and_one_line_where_they_name_no_image(tmp_path):
    named = [f"images/r_{i}.png" for i in range(1, 11)]
    dataset = load_dataset(transforms_folder(tmp_path, n=12, train_filenames=named))
    assert sorted(view.name for view in dataset.test) == ["r_1", "r_8"] and len(dataset.train) == 8
    problem = '"train_filenames" names none of its images'
    assert problem in error_of(transforms_folder(tmp_path, train_filenames=["images/s_1.png"]))


@pytest.mark.parametrize("absolute", ["file_path", "test_filenames"])
def test_a_test_image_is_found_by_any_path_to_it(tmp_path, absolute):
    """As nerfstudio finds it: paths are relative to the folder, or absolute."""
    frames = json.loads((transforms_folder(tmp_path) / "transforms.json").read_text())["frames"]
    relative, whole = "images/r_1.png", str(tmp_path / "images" / "r_1.png")
    frames[1]["file_path"], test = (whole, relative) if absolute == "file_path" else (relative, whole)
    transforms_folder(tmp_path, frames=frames, test_filenames=[test])
    assert [view.name[-3:] for view in load_dataset(tmp_path).test] == ["r_1"]


def test_test_images_that_are_not_there_are_one_line_and_not_a_set_without_test_views(tmp_path):
    problem = '"test_filenames" names none of its images'
    assert problem in error_of(transforms_folder(tmp_path, test_filenames=["images/s_1.png", "images/s_2.png"]))


def test_what_follows_a_dot_in_a_name_without_extension_tells_images_apart(tmp_path):
    frames = json.loads((transforms_folder(tmp_path, n=2) / "transforms.json").read_text())["frames"]
    for frame, name in zip(frames, ("r_0.5", "r_0.25"), strict=True):
        write_images(tmp_path / "images", [f"{name}.png"])
        frame["file_path"] = f"images/{name}"
    for tests in (["images/r_0.25"], ["images/r_0.25.png"]):
        transforms_folder(tmp_path, frames=frames, test_filenames=tests)
        assert [view.name for view in load_dataset(tmp_path).views] == ["r_0.5", "r_0.25"]
    write_images(tmp_path / "masks", ["r_0.25.png"])
    assert list(mask_files(tmp_path / "masks")) == ["r_0.25"]


def test_masks_that_frames_name_are_said_not_to_be_read(tmp_path):
    assert not_read(transforms_folder(tmp_path)) == not_read(tmp_path / "transforms.json") == []
    content = json.loads((tmp_path / "transforms.json").read_text())
    for i in (0, 2):
        content["frames"][i]["mask_path"] = f"masks/r_{i}.png"
    content["frames"].append(3)  # the reader refuses it in words
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    said = f'the "mask_path" of 2 of its frames; --masks {tmp_path / "masks"} uses them'
    assert not_read(tmp_path) == not_read(tmp_path / "transforms.json") == [said]
    write_images(tmp_path / "images", ["dynamic_mask_r_1.png"])
    (also,) = not_read(tmp_path)[1:]
    assert also.startswith("the dynamic_mask_*.png of 1 of its images, white where nothing counts")
    colmap_folder(tmp_path)  # is what is read then
    assert not_read(tmp_path) == []


@pytest.mark.parametrize(
    "mask, folder", [("masks/left/r_0.png", "masks"), ("masks/left_r_0.png", "masks"), ("m/left/m_0.png", None)]
)
def test_the_folder_of_masks_that_is_named_is_one_that_masks_are_found_in(tmp_path, mask, folder):
    transforms_folder(tmp_path, folder="images/left")
    content = json.loads((tmp_path / "transforms.json").read_text())
    content["frames"][0]["mask_path"] = mask
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    write_images(tmp_path, [mask])
    (said,) = not_read(tmp_path)
    assert f"--masks {tmp_path / folder} uses them" in said if folder else "--masks needs masks that are named" in said
    if folder:
        Masks(tmp_path / folder, load_dataset(tmp_path).views)  # which raises where it finds none


def test_points_come_from_the_named_ply_and_wrong_poses_are_caught_by_them(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 2\n" + "".join(f"property float {a}\n" for a in "xyz")
    header += "".join(f"property uchar {c}\n" for c in ("red", "green", "blue")) + "end_header\n"
    (tmp_path / "cloud.ply").write_text(header + "0.1 0 -3 255 0 51\n0 0.1 -3 0 0 0\n")
    dataset = load_dataset(transforms_folder(tmp_path, ply_file_path="cloud.ply"))
    np.testing.assert_allclose(dataset.points[0], (0.1, 0, -3))
    np.testing.assert_allclose(dataset.point_colors[0], (1, 0, 0.2))
    (tmp_path / "sparse").mkdir()
    (tmp_path / "sparse" / "cloud.ply").write_text(header + "0.1 0 -3 255 0 51\n0 0.1 -3 0 0 0\n")
    of_windows = load_dataset(transforms_folder(tmp_path, ply_file_path="sparse\\cloud.ply"))
    np.testing.assert_array_equal(of_windows.points, dataset.points)
    transforms_folder(tmp_path, ply_file_path="cloud.ply")
    (tmp_path / "cloud.ply").write_text(header + "0.1 0 3 255 0 51\n0 0.1 3 0 0 0\n")
    assert "x right, y up, z backward (OpenGL)" in error_of(tmp_path)
    (tmp_path / "cloud.ply").unlink()
    assert "cloud.ply" in error_of(tmp_path)


@pytest.mark.parametrize(("lens", "more"), [("PINHOLE", ()), ("FOV", (0.1,))])  # the second is none that is read
def test_points_come_from_a_colmap_model_of_the_same_poses_whatever_its_lenses_are(tmp_path, lens, more):
    transforms_folder(tmp_path)
    points = colmap_folder(tmp_path / "colmap", camera=lens, params=(20, 20, 10.5, 7.5, *more)) * (1, 1, -1)
    model = tmp_path / "colmap" / "sparse" / "0"
    poses = "".join(f"{i} 0 1 0 0 {-0.2 * i} 0 0 7 r_{i}.png\n\n" for i in range(3))
    (model / "images.txt").write_text(poses)
    lines = [f"{k} {x} {y} {z} 200 100 50 1\n" for k, (x, y, z) in enumerate(points)]
    (model / "points3D.txt").write_text("".join(lines))
    read = load_dataset(tmp_path / "transforms.json")  # the folder itself is one of COLMAP
    np.testing.assert_array_equal(read.points, points.astype(np.float32))
    np.testing.assert_allclose(255 * read.point_colors[0], (200, 100, 50), rtol=1e-6)
    for file in (tmp_path / "images").iterdir():
        with Image.open(file) as image:
            image.save(file, icc_profile=profile(DISPLAY_P3, SRGB_CURVE))
    expected = 255 * srgb_of(np.array([200, 100, 50]) / 255, DISPLAY_P3, SRGB_CURVE)
    wide = load_dataset(tmp_path / "transforms.json")
    np.testing.assert_allclose(255 * wide.point_colors[0], expected, atol=1)


AXES_OF_NERFSTUDIO = affine([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # its "applied_transform"
SET_UPRIGHT = affine(2.5 * rotation_between(np.array([0, 1, 0]), np.array([0.2, -0.5, 1])), (1, -2, 3))


@pytest.mark.parametrize("along", ["a line", "an arc"])
@pytest.mark.parametrize("placement", [AXES_OF_NERFSTUDIO, SET_UPRIGHT], ids=["nerfstudio", "instant-ngp"])
def test_points_of_a_colmap_model_go_where_a_converter_has_moved_its_cameras(tmp_path, placement, along):
    points = colmap_folder(tmp_path)
    model = tmp_path / "sparse" / "0"
    places = [(0.3 * i, 0, 0.1 * i * i if along == "an arc" else 0) for i in range(3)]
    poses = "".join(f"{i} 1 0 0 0 {-x} {-y} {-z} 7 r_{i}.png\n\n" for i, (x, y, z) in enumerate(places))
    (model / "images.txt").write_text(poses)
    scale = np.linalg.det(placement[:3, :3]) ** (1 / 3)
    frames = []
    for i, place in enumerate(places):
        pose = placement @ affine(OPENCV_FROM_OPENGL[:3, :3], place)
        pose[:3, :3] /= scale
        frames.append({"file_path": f"images/r_{i}", "transform_matrix": pose.tolist()})
    transforms_folder(tmp_path, frames=frames)
    read = load_dataset(tmp_path / "transforms.json")
    expected = points @ placement[:3, :3].T + placement[:3, 3]
    np.testing.assert_allclose(read.points[np.lexsort(read.points.T)], expected[np.lexsort(expected.T)], atol=1e-5)
    frames[1]["transform_matrix"][0][3] += 0.1  # other cameras
    transforms_folder(tmp_path, frames=frames)
    assert len(load_dataset(tmp_path / "transforms.json").points) == 0


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"k5": 0.1}, "k1 to k6"),
        ({"camera_model": "FULL_OPENCV", "is_fisheye": True}, "FULL_OPENCV"),
        ({"camera_model": "EQUIRECTANGULAR"}, "EQUIRECTANGULAR"),
        ({"ftheta_p0": 0.0, "ftheta_p1": 0.001}, "a lens ftheta_p0"),
        ({"latlong": True}, "a lens latlong"),
        ({"equirectangular": True}, "a lens equirectangular"),
        ({"k1": -20.0, "cx": 40.0}, "leaves no pinhole image"),
        ({"frames": []}, "no cameras"),
        ({"frames": [{"file_path": "images/r_0.png"}]}, "lacks"),
        ({"camera_angle_x": 0}, '"camera_angle_x" is 0, no angle'),
        ({"camera_angle_x": 60}, '"camera_angle_x" is 60, no angle of view in radians'),
        ({"fl_x": "wide"}, '"fl_x" is "wide", no number; correct it, or leave it out'),
        ({"fl_x": 0, "fl_y": 50}, "focal lengths must be positive, got fx=0.0, fy=50.0"),
        ({"cx": None}, '"cx" is null, no number; correct it, or leave it out'),
        ({"cx": 0.5, "cy": 0.5}, "21x15 are shares of its sides, not pixels; correct it, or leave it out"),
        ({"k1": None}, '"k1" is null, no number; correct it, or leave it out'),
        ({"distortion_params": [0.1, 0]}, '"distortion_params" is [0.1, 0], no list of k1, k2, k3, k4, p1, p2'),
        ({"camera_model": None}, '"camera_model" is null, no name of a lens; correct it, or leave it out'),
        ({"frames": [{"file_path": None, "transform_matrix": np.eye(4).tolist()}]}, 'lacks "file_path"'),
        ({"h": [15], "w": 21}, '"h" is [15], no number'),
        ({"w": 22, "h": HEIGHT}, "the image is 21x15, its camera says 22x15"),
        ({"frames": [{"file_path": "images/r_0", "transform_matrix": (2 * np.eye(4)).tolist()}]}, "last row"),
        (
            {"frames": [{"file_path": "images/r_0", "transform_matrix": np.diag([2.0, 2, 2, 1]).tolist()}]},
            "by 3; correct it (transform_matrix is camera-to-world",
        ),
        ({"frames": [{"file_path": "images/r_0", "transform_matrix": [[1, 2], [3]]}]}, "r_0"),
        ({"frames": [{"file_path": "/", "transform_matrix": np.eye(4).tolist()}]}, "image not found"),
        (
            {"frames": [{"file_path": "images/r_0", "transform_matrix": [[float("nan")] * 4] * 4}]},
            "not finite",
        ),
    ],
)
def test_a_transforms_file_that_cannot_be_used_is_one_line(tmp_path, change, expected):
    assert expected in error_of(transforms_folder(tmp_path, **change))


def test_the_mark_that_editors_of_windows_begin_a_file_with_is_passed_over(tmp_path):
    path = transforms_folder(tmp_path) / "transforms.json"
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load_dataset(tmp_path).views


def test_invalid_json_names_its_line(tmp_path):
    (tmp_path / "transforms.json").write_text('{\n"frames": [\n,]}')
    assert "line 3" in error_of(tmp_path)


def test_a_transforms_file_without_focal_length_names_the_keys(tmp_path):
    transforms_folder(tmp_path)
    text = (tmp_path / "transforms.json").read_text()
    (tmp_path / "transforms.json").write_text(text.replace("camera_angle_x", "angle"))
    assert "fl_x" in error_of(tmp_path)
