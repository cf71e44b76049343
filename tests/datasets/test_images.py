"""Images and folders of any data set: alpha, depths, sizes, what is missing, and how far cameras are apart."""

import numpy as np
import pytest
from dataset_folders import HEIGHT, WIDTH, error_of, transforms_folder, write_images
from mi_dogsplat.datasets import View, camera_extent, load_dataset
from mi_dogsplat.datasets.dataset import as_bytes, from_bytes, held
from mi_dogsplat.datasets.images import header, image_size, read_image
from mi_dogsplat.scene.cameras import Camera, affine, opengl_c2w_to_opencv_w2c
from mi_dogsplat.support.errors import DataError
from PIL import Image


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


def view_of(image: np.ndarray) -> View:
    height, width = image.shape[:2]
    return View("a", Camera(np.eye(4), 9, 9, width / 2, height / 2, width, height), image)


def test_a_photograph_is_held_as_its_bytes_and_read_as_floats(tmp_path):
    """The very floats that reading a file gives, in a quarter of the memory."""
    pixels = np.arange(256 * 3).astype(np.uint8).reshape(16, 16, 3)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    image = read_image(tmp_path / "a.png")
    view = held(view_of(image))
    assert view.n_bytes == 16 * 16 * 3
    assert view.image.dtype == np.float32
    np.testing.assert_array_equal(view.image, image)
    assert view_of(image).n_bytes == 4 * view.n_bytes


@pytest.mark.parametrize("change", [lambda v: v * 0.999, lambda v: v + 1, lambda v: v - 0.5])
def test_an_image_that_bytes_cannot_hold_stays_as_it_is(change):
    levels = np.random.default_rng(0).integers(0, 256, (4, 4, 3)).astype(np.uint8)
    view = view_of(change(from_bytes(levels)).astype(np.float32))
    assert as_bytes(view.image) is None and held(view) is view


def test_images_of_three_channels_get_an_alpha_beside_one_that_has_it(tmp_path):
    transforms_folder(tmp_path)
    write_images(tmp_path / "images", ["r_0.png"], color=(255, 100, 0, 128))
    opaque = [view for view in load_dataset(tmp_path).views if view.image[..., 3].min() == 1]
    assert opaque and all(view.image.shape[2] == 4 for view in opaque)


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


@pytest.mark.parametrize("on_disk", [False, True])
@pytest.mark.parametrize(("level", "hidden"), [(0, True), (65535, False)])
def test_the_level_of_sixteen_bit_grey_that_is_transparent_has_no_alpha(tmp_path, level, hidden, on_disk):
    grey = np.full((HEIGHT, WIDTH), 700, np.uint16)
    grey[:3] = 0
    transforms_folder(tmp_path)
    for path in (tmp_path / "images").iterdir():
        Image.fromarray(grey).save(path, transparency=level)
    dataset = load_dataset(tmp_path, on_disk=on_disk)
    image = dataset.train[0].image
    assert dataset.has_alpha == hidden and image.shape == (HEIGHT, WIDTH, 4 if hidden else 3)
    np.testing.assert_allclose(image[..., :3], np.repeat(grey[..., None] / 65535, 3, axis=2), rtol=1e-6)
    if hidden:
        np.testing.assert_array_equal(image[..., 3], grey > 0)


@pytest.mark.parametrize("beyond", [65536, -1])
def test_whole_numbers_beyond_sixteen_bits_are_refused(tmp_path, beyond):
    levels = np.array([[0, 65535]], np.int32)
    Image.fromarray(levels).save(tmp_path / "a.tif")
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif")[..., 0], [[0, 1]])
    levels[0, 0] = beyond
    Image.fromarray(levels).save(tmp_path / "a.tif")
    with pytest.raises(DataError, match=r"a\.tif: cannot be read as an image \(whole numbers beyond 16 bits"):
        read_image(tmp_path / "a.tif")


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


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_of_a_tiff_is_ignored_too(tmp_path, mode, orientation):
    """Pillow turns TIFFs by itself; what is not compressed it maps to memory, by the size of what it has turned."""
    pixels = np.random.default_rng(0).integers(0, 256, (6, 9, 3)).astype(np.uint8)
    image, exif = Image.fromarray(pixels).convert(mode), Image.Exif()
    exif[274] = orientation
    image.save(tmp_path / "a.tif", exif=exif)
    image.save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), read_image(tmp_path / "a.png"))
    assert header(tmp_path / "a.tif") == header(tmp_path / "a.png")


def test_a_path_that_is_no_data_set_says_what_was_looked_for(tmp_path):
    assert "no such file or folder" in error_of(tmp_path / "nowhere")
    message = error_of(tmp_path)
    assert all(word in message for word in ("sparse/0", "transforms.json", "transforms_train.json", ".xml"))
    (tmp_path / "a.txt").write_text("")
    assert "not a known data set" in error_of(tmp_path / "a.txt")
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / "history.jsonl").write_text("")
    assert "is a run, and its pictures are renders; give its data set" in error_of(tmp_path)
    (tmp_path / "history.jsonl").unlink()
    transforms_folder(tmp_path)
    assert "downscale is 0" in error_of(tmp_path, downscale=0)
    assert "smaller downscale factor" in error_of(tmp_path, downscale=100)


def test_camera_extent_is_a_tenth_more_than_the_largest_distance_from_the_mean_camera():
    def view(x: float) -> View:
        w2c = opengl_c2w_to_opencv_w2c(affine(np.eye(3), (x, 0, 0)))
        return View(str(x), Camera(w2c, 1, 1, 1, 1, 2, 2), np.zeros((2, 2, 3), np.float32))

    np.testing.assert_allclose(camera_extent([view(0), view(1), view(5)]), 1.1 * 3)
    assert camera_extent([view(4)]) == 1


def test_images_that_stay_on_disk_are_not_decoded_to_judge_the_cameras(data, monkeypatch):
    monkeypatch.setattr("mi_dogsplat.datasets.view_images.read_image", lambda path: pytest.fail(f"decodes {path}"))
    assert len(load_dataset(data, on_disk=True).points)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "it is empty"),
        (b"\0\0\0\x1cftypavif\0\0\0\0", "it is AVIF: export it as JPEG or PNG"),
        (b"no picture at all", "it is no PNG, JPEG, WEBP, TIFF, BMP, PPM, GIF or HEIF"),
    ],
)
@pytest.mark.parametrize("read", [read_image, image_size])
def test_files_of_other_formats_are_told_by_what_they_are(tmp_path, content, said, read):
    (tmp_path / "a.jpg").write_bytes(content)
    with pytest.raises(DataError, match=rf"a\.jpg: cannot be read as an image \({said}\); replace the file or remove"):
        read(tmp_path / "a.jpg")
