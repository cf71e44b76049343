"""Each data format on real data and on small folders written here, and one line for each kind of damage."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.datasets import View, camera_extent, check_cameras, load_dataset
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.errors import DataError
from mi_dogsplat.scene.cameras import Camera, opengl_c2w_to_opencv_w2c
from PIL import Image

DATA = Path(__file__).parents[1].parent / "shared" / "data"
WIDTH, HEIGHT, N_VIEWS = 21, 15, 10
QUATERNION = (0.9921567416492215, 0.0, 0.125, 0.0)  # w, x, y, z: turned by 14 degrees about y


def real(name: str) -> Path:
    if not (DATA / name).is_dir():
        pytest.skip(f"real data not there; put them in {DATA / name}")
    return DATA / name


def write_images(folder: Path, names: list[str], size=(WIDTH, HEIGHT), color=(200, 100, 50)) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGBA" if len(color) == 4 else "RGB", size, color).save(folder / name)


def colmap_folder(
    root: Path,
    model: str = "sparse/0",
    text: bool = True,
    camera: str = "PINHOLE",
    params=(20, 20, 10.5, 7.5),
):
    """Ten views that look along z at a grid of points; view 0 observes all. Returns the points [P, 3]."""
    folder = root / model
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"img_{i:02d}.png" for i in range(N_VIEWS)]
    write_images(root / "images", names)
    points = np.array([(x, y, 5.0) for x in (-0.5, 0, 0.5) for y in (-0.5, 0, 0.5)])
    translations = [(0.1 * i, 0.0, 0.0) for i in range(N_VIEWS)]
    poses = [(*((1.0, 0, 0, 0) if i else QUATERNION), *translations[i]) for i in range(N_VIEWS)]
    seen = project_by_hand(points, *translations[0])
    values = " ".join(str(v) for v in params)
    (folder / "cameras.txt").write_text(f"# comment\n7 {camera} {WIDTH} {HEIGHT} {values}\n")
    lines = ["# comment"]
    for i in reversed(range(N_VIEWS)):  # the file's order is not the order of the names
        lines.append(f"{i + 1} {' '.join(str(v) for v in poses[i])} 7 {names[i]}")
        lines.append(
            " ".join(f"{u} {v} {k + 1}" for k, (u, v) in enumerate(seen)) + " 3.0 4.0 -1" if i == 0 else ""
        )
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    rows = [f"{k + 1} {x} {y} {z} 200 100 50 0.1 1 {k}" for k, (x, y, z) in reversed(list(enumerate(points)))]
    (folder / "points3D.txt").write_text("\n".join(rows) + "\n")
    if not text:
        text_to_binary(folder, seen, points, poses, names, params)
    return points


def project_by_hand(points, tx, ty, tz):
    """Pixels [P, 2] of the turned first view, written out independently of Camera."""
    w, _, y, _ = QUATERNION
    c, s = 1 - 2 * y * y, 2 * w * y
    local = np.stack(
        [
            c * points[:, 0] + s * points[:, 2] + tx,
            points[:, 1] + ty,
            -s * points[:, 0] + c * points[:, 2] + tz,
        ],
        1,
    )
    return local[:, :2] / local[:, 2:] * 20 + (10.5, 7.5)


def text_to_binary(folder, seen, points, poses, names, params):
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 7, 1, WIDTH, HEIGHT, *params))
    blob = struct.pack("<Q", N_VIEWS)
    for i, (pose, name) in enumerate(zip(poses, names, strict=True)):
        blob += struct.pack("<I7dI", i + 1, *pose, 7) + name.encode() + b"\0"
        rows = [(*uv, k + 1) for k, uv in enumerate(seen)] + [(3.0, 4.0, -1)] if i == 0 else []
        blob += struct.pack("<Q", len(rows)) + b"".join(struct.pack("<ddq", *row) for row in rows)
    (folder / "images.bin").write_bytes(blob)
    blob = struct.pack("<Q", len(points))
    for k, point in enumerate(points):
        blob += struct.pack("<Q3d3BdQII", k + 1, *point, 200, 100, 50, 0.1, 1, 1, k)
    (folder / "points3D.bin").write_bytes(blob)
    for file in folder.glob("*.txt"):
        file.unlink()


def transforms_folder(
    root: Path, name: str = "transforms.json", n: int = 3, folder: str = "images", **content
) -> Path:
    frames = []
    for i in range(n):
        pose = np.eye(4)
        pose[:3, 3] = (0.2 * i, 0, 0)
        frames.append({"file_path": f"./{folder}/r_{i}", "transform_matrix": pose.tolist()})
    write_images(root / folder, [f"r_{i}.png" for i in range(n)])
    (root / name).write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames, **content}))
    return root


def error_of(path: Path, **arguments) -> str:
    """The message of the DataError that loading raises: always a single line."""
    with pytest.raises(DataError) as caught:
        load_dataset(path, **arguments)
    message = str(caught.value)
    assert "\n" not in message and "; " in message
    return message


# --- real data ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "n", "size"), [("fox", 50, (112, 200)), ("fern", 20, (200, 150))])
def test_real_colmap_captures_load_with_every_eighth_image_for_test_and_cameras_that_see_the_points(
    name, n, size
):
    dataset = load_dataset(real(name), downscale=4)
    names = sorted(view.name for view in dataset.views)
    assert len(names) == n and [view.name for view in dataset.test] == names[::8]
    assert all((v.camera.width, v.camera.height) == size for v in dataset.views)
    assert all(v.image.shape == (size[1], size[0], 3) and v.image.dtype == np.float32 for v in dataset.views)
    check = check_cameras(dataset)
    assert check.n_points == len(dataset.points) == len(dataset.point_colors) > 9000
    assert check.in_front is not None and check.in_front > 0.99
    assert check.seen is not None and check.seen > 0.99
    assert check.color_difference is not None and check.color_difference < 0.15
    assert check.reprojection_px is None  # these models come without observations


def test_colour_agreement_is_far_better_than_with_shuffled_colours():
    dataset = load_dataset(real("fox"), downscale=4)
    agreement = check_cameras(dataset).color_difference
    dataset.point_colors = np.random.default_rng(0).permutation(dataset.point_colors)
    shuffled = check_cameras(dataset).color_difference
    assert agreement is not None and shuffled is not None and agreement < 0.6 * shuffled


def test_both_descriptions_of_fox_give_the_same_cameras_and_points():
    colmap = load_dataset(real("fox"), downscale=8)
    transforms = load_dataset(real("fox") / "transforms.json", downscale=8)
    for a, b in zip(colmap.views, transforms.views, strict=True):
        assert a.name == b.name
        np.testing.assert_allclose(a.camera.w2c, b.camera.w2c, atol=1e-4)
        np.testing.assert_allclose(a.camera.K, b.camera.K, rtol=1e-6)
    np.testing.assert_array_equal(colmap.points, transforms.points)


def test_lego_keeps_its_given_split_and_its_alpha_premultiplied():
    dataset = load_dataset(real("lego"), downscale=4)
    assert (len(dataset.train), len(dataset.test)) == (100, 100)
    assert dataset.has_alpha and len(dataset.points) == 0
    image = dataset.train[0].image
    assert image.shape == (100, 100, 4)
    assert (image[..., :3] <= image[..., 3:] + 1e-6).all()
    assert (dataset.train[0].name, dataset.test[0].name) == ("train_r_0", "test_r_0")
    axes = np.array([view.camera.c2w[:3, 2] for view in dataset.train])  # [V, 3]
    centres = np.array([view.camera.position for view in dataset.train])
    assert (np.einsum("vi,vi->v", axes, -centres) > 0).all()  # all of them look at the object in the origin


def test_our_reader_agrees_with_pycolmap_on_real_models():
    pycolmap = pytest.importorskip("pycolmap")
    folder = real("fox")
    model = pycolmap.Reconstruction(folder / "sparse/0")
    images = sorted(model.images.values(), key=lambda image: image.name)
    dataset = load_dataset(folder, downscale=8)
    for image, view in zip(images, sorted(dataset.views, key=lambda view: view.name), strict=True):
        np.testing.assert_allclose(view.camera.w2c[:3], image.cam_from_world().matrix(), atol=1e-12)
    expected = np.array([model.points3D[i].xyz for i in sorted(model.points3D)], np.float32)
    np.testing.assert_array_equal(dataset.points, expected)


# --- COLMAP ------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [True, False], ids=["text", "binary"])
@pytest.mark.parametrize("model", ["sparse/0", "sparse", "."])
def test_colmap_layouts_and_both_encodings_give_the_same_views_points_and_observations(tmp_path, text, model):
    points = colmap_folder(tmp_path, model, text)
    dataset = load_dataset(tmp_path)
    assert [view.name for view in dataset.test] == ["img_00", "img_08"]
    assert len(dataset.train) == 8 and not dataset.has_alpha
    np.testing.assert_allclose(dataset.points, points)
    np.testing.assert_allclose(dataset.point_colors, np.array([[200, 100, 50]] * 9) / 255, rtol=1e-6)
    np.testing.assert_allclose(dataset.train[0].camera.w2c[:3, 3], (0.1, 0, 0))
    check = check_cameras(dataset)
    assert check.reprojection_px is not None and check.reprojection_px < 1e-5
    assert check.color_difference is not None and check.color_difference < 1e-6


def test_the_model_folder_itself_finds_the_images_above_it(tmp_path):
    colmap_folder(tmp_path)
    assert len(load_dataset(tmp_path / "sparse" / "0").views) == N_VIEWS


def test_downscaling_averages_blocks_and_moves_cameras_and_observations_along(tmp_path):
    colmap_folder(tmp_path)
    pixels = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "images" / "img_00.png")
    dataset = load_dataset(tmp_path, downscale=4)
    view = dataset.test[0]
    assert view.image.shape == (3, 5, 3) and (view.camera.width, view.camera.height) == (5, 3)
    np.testing.assert_allclose(view.image[1, 2], pixels[4:8, 8:12].mean(axis=(0, 1)) / 255, atol=1e-6)
    assert (view.camera.fx, view.camera.cy) == (5, 7.5 / 4)
    check = check_cameras(dataset)
    assert check.reprojection_px is not None and check.reprojection_px < 1e-5


def test_a_folder_of_smaller_images_is_used_with_the_exact_ratio_and_refused_at_another_size(tmp_path):
    colmap_folder(tmp_path)
    names = [f"img_{i:02d}.png" for i in range(N_VIEWS)]
    write_images(tmp_path / "images_4", names, size=(5, 4), color=(0, 0, 255))
    view = load_dataset(tmp_path, downscale=4).train[0]
    np.testing.assert_allclose(view.image[0, 0], (0, 0, 1))
    np.testing.assert_allclose((view.camera.fx, view.camera.fy), (20 * 5 / 21, 20 * 4 / 15))
    write_images(tmp_path / "images_4", names[3:4], size=(7, 4))
    assert "img_03.png: the image is 7x4, its camera says 1/4 of 21x15" in error_of(tmp_path, downscale=4)


def test_distortion_of_zero_is_a_pinhole_and_a_lens_that_is_not_known_asks_for_the_undistorter(tmp_path):
    colmap_folder(tmp_path, camera="OPENCV", params=(20, 20, 10.5, 7.5, 0, 0, 0, 0))
    view = load_dataset(tmp_path).train[0]
    assert (view.camera.fx, view.camera.width, view.camera.height) == (20, WIDTH, HEIGHT)
    colmap_folder(tmp_path, camera="THIN_PRISM_FISHEYE", params=(20, 20, 10.5, 7.5, *[0.0] * 8))
    assert "THIN_PRISM_FISHEYE, which is none of SIMPLE_PINHOLE" in error_of(tmp_path)
    colmap_folder(tmp_path, camera="FULL_OPENCV", params=(20, 20, 10.5, 7.5, *[0.01] * 8))
    assert "FULL_OPENCV with" in error_of(tmp_path) and "image_undistorter" in error_of(tmp_path)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_binary_model_cut_at_any_length_or_grown_is_one_line_that_names_the_file(tmp_path, file):
    colmap_folder(tmp_path, text=False)
    path = tmp_path / "sparse" / "0" / file
    whole = path.read_bytes()
    for size in {0, 5, 8, len(whole) // 2, len(whole) - 20, len(whole) - 1}:
        path.write_bytes(whole[:size])
        assert file in error_of(tmp_path)
    path.write_bytes(whole + b"\0")
    assert "too many" in error_of(tmp_path)
    path.write_bytes(b"\xff" * 7 + b"\0" + whole[8:])  # a count of 10^16 entries allocates nothing
    assert file in error_of(tmp_path)


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("cameras.txt", "21 15 20", "21 15 x", "line 2"),
        ("cameras.txt", "21 15 20 20", "21 15 20", "parameters"),
        ("cameras.txt", "7 PINHOLE", "8 PINHOLE", "camera 7"),
        ("images.txt", "10 1.0 0 0 0", "10 1.0 0 0", "line 2"),
        ("images.txt", "10 1.0 0 0 0", "10 2.0 0 0 0", "no valid pose"),
        ("images.txt", "10 1.0 0 0 0", "10 nan 0 0 0", "no valid pose"),
        ("images.txt", "img_09.png", "img_08.png", 'two views have the name "img_08"'),
        ("points3D.txt", "9 0.5 0.5 5.0", "9 0.5 0.5 inf", "not finite"),
        ("points3D.txt", "9 0.5 0.5 5.0", "99 0.5 0.5 5.0", "sees a point that points3D lacks"),
        ("points3D.txt", "9 0.5 0.5 5.0 200", "9 0.5", "line 1"),
    ],
)
def test_a_damaged_text_model_is_one_line(tmp_path, file, old, new, expected):
    colmap_folder(tmp_path)
    path = tmp_path / "sparse" / "0" / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    assert expected in error_of(tmp_path)


def test_a_model_without_images_or_without_points_says_so_or_loads(tmp_path):
    colmap_folder(tmp_path)
    (tmp_path / "sparse/0/points3D.txt").unlink()
    assert load_dataset(tmp_path).points.shape == (0, 3)
    (tmp_path / "sparse/0/images.txt").write_text("# none\n")
    assert "no registered image" in error_of(tmp_path)


def test_poses_in_the_wrong_direction_are_caught_by_the_points_and_the_message_names_the_convention(tmp_path):
    colmap_folder(tmp_path)
    path = tmp_path / "sparse/0/images.txt"
    lines = [line.replace(" 1.0 0 0 0 ", " 0 0 1.0 0 ") for line in path.read_text().splitlines()]
    lines = [line if line.count(" ") < 10 or ".png" in line else "" for line in lines]  # without observations
    path.write_text("\n".join(lines) + "\n")
    assert "world-to-camera" in error_of(tmp_path)


# --- transforms --------------------------------------------------------------------------------


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
    content["frames"][1]["fl_x"] = 40
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    focal = {
        view.name: (view.camera.fx, view.camera.fy, view.camera.cx) for view in load_dataset(tmp_path).views
    }
    assert focal == {"r_0": (30, 31, 9), "r_1": (40, 31, 9), "r_2": (30, 31, 9)}


def test_the_split_is_taken_from_the_train_and_test_files_or_from_test_filenames(tmp_path):
    transforms_folder(tmp_path / "a", "transforms_train.json", 3, "train")
    transforms_folder(tmp_path / "a", "transforms_test.json", 2, "test")
    dataset = load_dataset(tmp_path / "a")
    assert [view.name for view in dataset.test] == ["test_r_0", "test_r_1"] and len(dataset.train) == 3
    dataset = load_dataset(transforms_folder(tmp_path / "b", test_filenames=["images/r_1.png"]))
    assert [view.name for view in dataset.test] == ["r_1"]


def test_points_come_from_the_named_ply_and_wrong_poses_are_caught_by_them(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 2\n" + "".join(f"property float {a}\n" for a in "xyz")
    header += "".join(f"property uchar {c}\n" for c in ("red", "green", "blue")) + "end_header\n"
    (tmp_path / "cloud.ply").write_text(header + "0.1 0 -3 255 0 51\n0 0.1 -3 0 0 0\n")
    dataset = load_dataset(transforms_folder(tmp_path, ply_file_path="cloud.ply"))
    np.testing.assert_allclose(dataset.points[0], (0.1, 0, -3))
    np.testing.assert_allclose(dataset.point_colors[0], (1, 0, 0.2))
    (tmp_path / "cloud.ply").write_text(header + "0.1 0 3 255 0 51\n0 0.1 3 0 0 0\n")
    assert "x right, y up, z backward (OpenGL)" in error_of(tmp_path)
    (tmp_path / "cloud.ply").unlink()
    assert "cloud.ply" in error_of(tmp_path)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"k5": 0.1}, "k1 to k6"),
        ({"camera_model": "FULL_OPENCV", "k1": 0.1}, "FULL_OPENCV"),
        ({"camera_model": "EQUIRECTANGULAR"}, "EQUIRECTANGULAR"),
        ({"k1": -20.0, "cx": 40.0}, "leaves no pinhole image"),
        ({"frames": []}, "no cameras"),
        ({"frames": [{"file_path": "images/r_0.png"}]}, "lacks"),
        ({"camera_angle_x": 0}, "division"),
        ({"fl_x": "wide"}, "wide"),
        ({"w": 22, "h": HEIGHT}, "the image is 21x15, its camera says 22x15"),
        ({"frames": [{"file_path": "images/r_0", "transform_matrix": (2 * np.eye(4)).tolist()}]}, "last row"),
        (
            {"frames": [{"file_path": "images/r_0", "transform_matrix": np.diag([2.0, 2, 2, 1]).tolist()}]},
            "rotation",
        ),
        ({"frames": [{"file_path": "images/r_0", "transform_matrix": [[1, 2], [3]]}]}, "r_0"),
        (
            {"frames": [{"file_path": "images/r_0", "transform_matrix": [[float("nan")] * 4] * 4}]},
            "not finite",
        ),
    ],
)
def test_a_transforms_file_that_cannot_be_used_is_one_line(tmp_path, change, expected):
    assert expected in error_of(transforms_folder(tmp_path, **change))


def test_invalid_json_names_its_line(tmp_path):
    (tmp_path / "transforms.json").write_text('{\n"frames": [\n,]}')
    assert "line 3" in error_of(tmp_path)


def test_a_transforms_file_without_focal_length_names_the_keys(tmp_path):
    transforms_folder(tmp_path)
    text = (tmp_path / "transforms.json").read_text()
    (tmp_path / "transforms.json").write_text(text.replace("camera_angle_x", "angle"))
    assert "fl_x" in error_of(tmp_path)


# --- images and folders ------------------------------------------------------------------------


def test_alpha_is_premultiplied_and_dropped_where_every_image_is_opaque(tmp_path):
    transforms_folder(tmp_path)
    write_images(tmp_path / "images", ["r_0.png"], color=(255, 100, 0, 128))
    dataset = load_dataset(tmp_path)
    image = dataset.test[0].image
    assert dataset.has_alpha and dataset.train[0].image.shape[2] == 4
    np.testing.assert_allclose(
        image[0, 0], np.array([255 * 128 / 255, 100 * 128 / 255, 0, 128]) / 255, rtol=1e-6
    )
    write_images(tmp_path / "images", ["r_0.png"], color=(255, 100, 0, 255))
    dataset = load_dataset(tmp_path)
    assert not dataset.has_alpha and dataset.test[0].image.shape[2] == 3


def test_alpha_is_averaged_premultiplied_so_that_hidden_colour_does_not_leak(tmp_path):
    transforms_folder(tmp_path)
    pixels = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    pixels[:, :] = (0, 255, 0, 0)  # transparent green
    pixels[::2] = (255, 0, 0, 255)
    Image.fromarray(pixels).save(tmp_path / "images" / "r_0.png")
    np.testing.assert_allclose(load_dataset(tmp_path, downscale=2).test[0].image[0, 0], (0.5, 0, 0, 0.5))


def test_sixteen_bit_grey_and_palette_images_are_read(tmp_path):
    grey = np.array([[0, 65535], [32768, 1]], np.uint16)
    Image.fromarray(grey).save(tmp_path / "grey.png")
    np.testing.assert_allclose(read_image(tmp_path / "grey.png")[..., 1], grey / 65535, atol=1e-7)
    Image.new("RGB", (2, 2), (255, 0, 0)).quantize(4).save(tmp_path / "palette.png")
    np.testing.assert_allclose(read_image(tmp_path / "palette.png")[0, 0], (1, 0, 0))


def test_missing_and_corrupt_images_are_named_and_counted(tmp_path):
    transforms_folder(tmp_path)
    (tmp_path / "images/r_1.png").unlink()
    (tmp_path / "images/r_2.png").unlink()
    assert "r_1: image not found (2 of 3 are missing)" in error_of(tmp_path)
    transforms_folder(tmp_path)
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "images/r_1.png")
    whole = (tmp_path / "images/r_1.png").read_bytes()
    for damaged in (whole[:20], whole[: len(whole) // 2], b"hello"):
        (tmp_path / "images/r_1.png").write_bytes(damaged)
        assert "r_1.png: cannot be read as an image" in error_of(tmp_path)


def test_an_exif_orientation_is_ignored_and_named_when_the_size_does_not_fit(tmp_path):
    transforms_folder(tmp_path, w=WIDTH, h=HEIGHT)
    exif = Image.Exif()
    exif[274] = 6
    for size, fits in (((WIDTH, HEIGHT), True), ((HEIGHT, WIDTH), False)):
        Image.new("RGB", size).save(tmp_path / "images/r_1.png", exif=exif)
        if fits:
            assert load_dataset(tmp_path).train[0].image.shape == (HEIGHT, WIDTH, 3)
        else:
            assert "EXIF" in error_of(tmp_path)


def test_a_path_that_is_no_data_set_says_what_was_looked_for(tmp_path):
    assert "no such file or folder" in error_of(tmp_path / "nowhere")
    message = error_of(tmp_path)
    assert all(word in message for word in ("sparse/0", "transforms.json", "transforms_train.json", ".xml"))
    (tmp_path / "a.txt").write_text("")
    assert "not a known data set" in error_of(tmp_path / "a.txt")
    transforms_folder(tmp_path)
    assert "downscale is 0" in error_of(tmp_path, downscale=0)
    assert "smaller downscale factor" in error_of(tmp_path, downscale=100)


def test_camera_extent_is_a_tenth_more_than_the_largest_distance_from_the_mean_camera():
    def view(x: float) -> View:
        c2w = np.eye(4)
        c2w[0, 3] = x
        return View(
            str(x), Camera(opengl_c2w_to_opencv_w2c(c2w), 1, 1, 1, 1, 2, 2), np.zeros((2, 2, 3), np.float32)
        )

    np.testing.assert_allclose(camera_extent([view(0), view(1), view(5)]), 1.1 * 3)
    assert camera_extent([view(4)]) == 1


# --- Mitsuba scenes ----------------------------------------------------------------------------

SENSOR = """<sensor type="perspective" {id}><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="{x}, 0, -4" target="{x}, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/>
<string name="pixel_format" value="{format}"/><rfilter type="box"/></film></sensor>"""


def scene_file(folder: Path, pixel_format: str = "rgb", n: int = 3) -> Path:
    sensors = [
        SENSOR.format(id=f'id="cam{i}"' if i else "", x=0.1 * i, format=pixel_format) for i in range(n)
    ]
    emitter = '<emitter type="area"><rgb name="radiance" value="0.5, 0.2, 0.1"/></emitter>'
    sphere = f'<shape type="sphere">{emitter}</shape>'
    integrator = '<integrator type="path"><boolean name="hide_emitters" value="false"/></integrator>'
    file = folder / "scene.xml"
    file.write_text(f'<scene version="3.0.0">{integrator}{sphere}{"".join(sensors)}</scene>')
    return file


def test_a_mitsuba_scene_becomes_one_view_per_sensor_in_display_values(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    dataset = load_dataset(scene_file(tmp_path), spp=4)
    assert [view.name for view in dataset.test] == ["sensor_000"]
    assert [view.name for view in dataset.train] == ["cam1", "cam2"]
    view = dataset.train[0]
    assert view.image.shape == (6, 8, 3) and not dataset.has_alpha and len(dataset.points) == 0
    srgb = 1.055 * np.array([0.5, 0.2, 0.1]) ** (1 / 2.4) - 0.055
    np.testing.assert_allclose(view.image[3, 4], srgb, atol=1e-5)
    np.testing.assert_allclose(view.camera.position, (0.1, 0, -4), atol=1e-6)


def test_a_mitsuba_film_with_alpha_gives_premultiplied_display_values_and_is_averaged_linearly(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    dataset = load_dataset(scene_file(tmp_path, "rgba"), downscale=2, spp=16)
    image = dataset.train[0].image
    assert dataset.has_alpha and image.shape == (3, 4, 4)
    edge = (image[..., 3] > 0.05) & (image[..., 3] < 0.95)
    assert edge.any()
    srgb = 1.055 * np.array([0.5, 0.2, 0.1]) ** (1 / 2.4) - 0.055
    np.testing.assert_allclose(image[edge][:, :3], image[edge][:, 3:] * srgb, atol=1e-4)


def test_a_mitsuba_scene_that_cannot_be_loaded_or_has_a_lens_is_one_line(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    file = scene_file(tmp_path)
    good = file.read_text()
    file.write_text(good[:-20])
    assert "Mitsuba cannot load it" in error_of(file)
    lens = (
        '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4"/><float name="fov"'
    )
    file.write_text(good.replace('"perspective"', '"thinlens"').replace('<float name="fov"', lens))
    assert "perspective" in error_of(file, spp=1)
