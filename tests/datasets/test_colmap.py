"""COLMAP folders: layouts, encodings, smaller images, lenses, and one line for each kind of damage."""

import shutil
import struct

import numpy as np
import pytest
from dataset_folders import HEIGHT, N_VIEWS, WIDTH, colmap_folder, error_of, write_images
from mi_dogsplat.datasets import check_cameras, load_dataset, load_largest
from mi_dogsplat.datasets.world import World, metres_of_unit, world_of, write_world
from mi_dogsplat.inspection.dataset import describe_dataset
from PIL import Image


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


def test_smaller_images_do_without_those_at_full_size(tmp_path):
    """Of large captures people keep no others."""
    colmap_folder(tmp_path)
    write_images(tmp_path / "images_3", [f"img_{i:02d}.png" for i in range(N_VIEWS)], (7, 5), color=(0, 0, 255))
    expected = load_dataset(tmp_path, 3)
    shutil.rmtree(tmp_path / "images")
    for path in (tmp_path, tmp_path / "sparse" / "0"):
        found = load_dataset(path, 3)
        assert [view.name for view in found.views] == [view.name for view in expected.views]
        assert found.train[0].camera.width == 7
    for downscale in (1, 2):
        said = "images: no such folder, only images_3; give --downscale 3, or put the images at full size there"
        assert said in error_of(tmp_path, downscale=downscale)


def test_what_asks_for_cameras_alone_takes_the_largest_images_that_are_there(tmp_path):
    """``dogsplat info``, ``film`` and ``--scale``, which have no --downscale."""
    colmap_folder(tmp_path)
    info = describe_dataset(tmp_path)
    scale = ("img_01:10.9,7.5+img_09:14.1,7.5", "img_02", "2")  # the point (0, 0, 5)
    length = metres_of_unit(tmp_path, scale)
    np.testing.assert_allclose(length, 2 / np.hypot(0.2, 5), rtol=1e-6)
    for k, size in ((3, (WIDTH // 3, HEIGHT // 3)), (4, (WIDTH // 4, HEIGHT // 4))):
        write_images(tmp_path / f"images_{k}", [f"img_{i:02d}.png" for i in range(N_VIEWS)], size)
    shutil.rmtree(tmp_path / "images")
    dataset, factor = load_largest(tmp_path)
    assert factor == 3 and dataset.train[0].camera.width == WIDTH // 3
    np.testing.assert_allclose(metres_of_unit(tmp_path, scale), length)
    smaller = describe_dataset(tmp_path)
    (images,) = [line for line in smaller if "--downscale" in line]
    assert images.endswith("none at full size, only those for --downscale 3") and len(smaller) == len(info)


@pytest.mark.parametrize("before", ["images/", "images\\", "/home/somebody/photos/", "C:\\photos\\of it\\", "left/"])
@pytest.mark.parametrize("downscale", [1, 3])
def test_images_are_found_by_the_last_part_of_a_path_that_leads_nowhere(tmp_path, before, downscale):
    """As the loader of 3DGS finds them, and so what is made for it."""
    colmap_folder(tmp_path)
    write_images(tmp_path / "images_3", [f"img_{i:02d}.png" for i in range(N_VIEWS)], (7, 5), color=(0, 0, 255))
    path = tmp_path / "sparse" / "0" / "images.txt"
    path.write_text(path.read_text().replace("img_", f"{before}img_"))
    dataset = load_dataset(tmp_path, downscale)
    assert len(dataset.views) == N_VIEWS and dataset.train[0].camera.width == WIDTH // downscale
    assert (dataset.train[0].image[0, 0, 2] == 1) == (downscale == 3)
    (tmp_path / "images" / "img_04.png").unlink()
    if downscale == 1:
        assert f"img_04.png: image not found (1 of {N_VIEWS} are missing)" in error_of(tmp_path)


def test_images_of_one_name_in_folders_that_are_not_there_are_not_mixed_up(tmp_path):
    colmap_folder(tmp_path)
    path = tmp_path / "sparse" / "0" / "images.txt"
    names = {f"img_{i:02d}": f"camera_{i}/0" for i in range(N_VIEWS)}
    text = path.read_text()
    for old, new in names.items():
        text = text.replace(old, new)
    path.write_text(text)
    write_images(tmp_path / "images", ["0.png"])
    assert f"camera_0/0.png: image not found (10 of {N_VIEWS} are missing)" in error_of(tmp_path)


def test_text_files_of_windows_are_read(tmp_path):
    colmap_folder(tmp_path, text=True)
    expected = load_dataset(tmp_path)
    for path in (tmp_path / "sparse" / "0").glob("*.txt"):
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    found = load_dataset(tmp_path)
    assert [view.name for view in found.views] == [view.name for view in expected.views]
    np.testing.assert_array_equal(found.points, expected.points)


def test_the_model_folder_itself_finds_the_images_above_it(tmp_path):
    colmap_folder(tmp_path)
    write_world(tmp_path, World("z", 0.25))  # beside the images, and found there too
    dataset = load_dataset(tmp_path / "sparse" / "0")
    assert len(dataset.views) == N_VIEWS
    assert world_of(dataset, [view.camera for view in dataset.views]) == World("z", 0.25)


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
    colmap_folder(tmp_path, text=False)
    file = tmp_path / "sparse" / "0" / "cameras.bin"
    file.write_bytes(file.read_bytes().replace(struct.pack("<ii", 7, 1), struct.pack("<ii", 7, 10)))
    assert "the model THIN_PRISM_FISHEYE, which is none of" in error_of(tmp_path)
    assert "image_undistorter" in error_of(tmp_path)


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
        ("cameras.txt", "10.5 7.5", "0.5 0.5", "camera 7: cx 0.5 and cy 0.5 of an image of 21x15 are shares of its"),
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


def test_images_without_a_line_for_their_points_are_told_what_is_missing(tmp_path):
    """As people write them who know the poses."""
    colmap_folder(tmp_path)
    path = tmp_path / "sparse" / "0" / "images.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if line.endswith(".png")))
    said = 'line 2 is of an image, and not of the points that "img_09.png" sees; put an empty line after that of each'
    assert said in error_of(tmp_path)
    path.write_text("\n".join(f"{line}\n" for line in lines if line.endswith(".png")))
    assert len(load_dataset(tmp_path).views) == N_VIEWS


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
