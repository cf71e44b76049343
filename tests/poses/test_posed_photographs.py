"""Photographs are copied as they are, or turned as their EXIF says; it also says which device took them, and how."""

import os
import sys
from dataclasses import replace
from unicodedata import normalize

import numpy as np
import pytest
from heif_files import assert_shows, write_heif
from icc_profiles import ADOBE_CURVE, ADOBE_RGB, DISPLAY_P3, SRGB_CURVE, profile, srgb_of
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.images import FORMS, read_image
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.poses.exif import read_exif
from mi_dogsplat.poses.photographs import Photograph, prepare, prepare_masks
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.errors import DataError
from PIL import ExifTags, Image

WIDTH, HEIGHT = 60, 40
ORIENTATION, MAKE, MODEL, EXIF = 0x0112, 0x010F, 0x0110, 0x8769
FOCAL, FOCAL_35MM, TAKEN_WIDTH, TAKEN_HEIGHT, DENSITY, UNIT = 0x920A, 0xA405, 0xA002, 0xA003, 0xA20E, 0xA210
DIGITAL_ZOOM = 0xA404
# what undoes each value of the tag, by the definition of EXIF 2.32: where row 0 and column 0 of the file are shown
SHOWN = {
    1: lambda p: p, 2: lambda p: p[:, ::-1], 3: lambda p: p[::-1, ::-1], 4: lambda p: p[::-1],
    5: lambda p: p.swapaxes(0, 1), 6: lambda p: np.rot90(p, -1), 7: lambda p: np.rot90(p, 2).swapaxes(0, 1),
    8: lambda p: np.rot90(p, 1),
}  # fmt: skip


def pixels() -> np.ndarray:
    """Blocks of random colours, no two sides of which are alike."""
    return np.kron(np.random.default_rng(0).integers(0, 256, (4, 6, 3)), np.ones((10, 10, 1))).astype(np.uint8)


def tags(orientation: int = 1) -> Image.Exif:
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    return exif


def prepared(folder, out):
    sources = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return prepare(sources, out, lambda done, n: None)


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("orientation", SHOWN)
def test_pixels_are_turned_once_as_the_tag_says(tmp_path, orientation, suffix):
    (tmp_path / "in").mkdir()
    Image.fromarray(pixels()).save(tmp_path / "in" / f"a.{suffix}", exif=tags(orientation))
    photograph = prepared(tmp_path / "in", tmp_path / "out")[0]
    assert prepared(tmp_path / "in", tmp_path / "out") == [photograph]  # now without reading pixels
    with Image.open(tmp_path / "out" / "a.png") as image:
        assert image.getexif().get(ORIENTATION, 1) == 1
        np.testing.assert_array_equal(np.asarray(image), SHOWN[orientation](pixels()))
        assert image.size == (photograph.width, photograph.height)


@pytest.mark.parametrize("orientation", [1, 6])
@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_colours_stay_those_of_the_profile_also_where_pixels_are_turned(tmp_path, orientation, suffix):
    file, icc = tmp_path / "in" / f"a.{suffix}", profile(DISPLAY_P3, SRGB_CURVE)
    file.parent.mkdir()
    Image.fromarray(np.full((8, 8, 3), (204, 77, 51), np.uint8)).save(file, exif=tags(orientation), icc_profile=icc)
    photograph = prepared(tmp_path / "in", tmp_path / "out")[0]
    shown = 255 * read_image(tmp_path / "out" / photograph.name)[4, 4]
    expected = 255 * srgb_of(np.array([204, 77, 51]) / 255, DISPLAY_P3, SRGB_CURVE)
    np.testing.assert_allclose(shown, expected, atol=2.5)


@pytest.mark.parametrize("orientation", [1, 6])
def test_colours_that_exif_alone_names_become_srgb_where_pixels_are_turned(tmp_path, orientation):
    (tmp_path / "in").mkdir()
    exif = tags(orientation)
    exif[ExifTags.IFD.Exif] = {ExifTags.Base.ColorSpace: 65535, ExifTags.IFD.Interop: {1: "R03", 2: b"0100"}}
    Image.fromarray(np.full((8, 8, 3), (204, 77, 51), np.uint8)).save(tmp_path / "in" / "a.jpg", exif=exif)
    photograph = prepared(tmp_path / "in", tmp_path / "out")[0]
    shown = 255 * read_image(tmp_path / "out" / photograph.name)[4, 4]
    expected = 255 * srgb_of(np.array([204, 77, 51]) / 255, ADOBE_RGB, ADOBE_CURVE)
    np.testing.assert_allclose(shown, expected, atol=2.5)


def test_the_profile_of_other_channels_is_not_that_of_the_file_made_of_them(tmp_path):
    (tmp_path / "in").mkdir()
    grey = Image.fromarray(np.full((8, 8), 77, np.uint8))
    grey.save(tmp_path / "in" / "a.tif", icc_profile=b"of grey levels")
    prepared(tmp_path / "in", tmp_path / "out")
    with Image.open(tmp_path / "out" / "a.png") as image:
        assert image.mode == "RGB" and "icc_profile" not in image.info


def test_what_every_tool_reads_is_copied_to_the_byte_and_the_rest_becomes_png(tmp_path):
    folder = tmp_path / "in"
    (folder / "left side").mkdir(parents=True)
    Image.fromarray(pixels()).save(folder / "a.jpg", quality=90, exif=tags())
    Image.fromarray(pixels()).save(folder / "left side" / "b 1.PNG")
    Image.fromarray(pixels()).save(folder / "c.webp", lossless=True)
    Image.fromarray((pixels()[..., 0].astype(np.uint16) << 8) + 255).save(folder / "d.tif")
    Image.fromarray(pixels()).quantize().save(folder / "e.png", transparency=0)
    made = prepared(folder, tmp_path / "out")
    assert [p.name for p in made] == ["a.jpg", "c.png", "d.png", "e.png", "left_side/b_1.PNG"]
    assert (tmp_path / "out" / "a.jpg").read_bytes() == (folder / "a.jpg").read_bytes()
    assert (tmp_path / "out/left_side/b_1.PNG").read_bytes() == (folder / "left side/b 1.PNG").read_bytes()
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "out" / "c.png")), pixels())
    grey = np.asarray(Image.open(tmp_path / "out" / "d.png"))
    assert np.abs(grey[..., 0].astype(int) - pixels()[..., 0]).max() <= 1
    with Image.open(tmp_path / "out" / "e.png") as image:
        assert image.mode == "RGBA" and image.getextrema()[3] == (0, 255)


def test_a_transparent_png_that_is_called_a_jpeg_gets_its_own_name(tmp_path):
    """Programs write by the name what they make of it, and no JPEG is transparent."""
    (tmp_path / "in").mkdir()
    Image.fromarray(pixels()).convert("RGBA").save(tmp_path / "in" / "a.JPG", "PNG")
    (made,) = prepared(tmp_path / "in", tmp_path / "out")
    assert made.name == "a.png" and prepared(tmp_path / "in", tmp_path / "out") == [made]
    assert (tmp_path / "out" / "a.png").read_bytes() == (tmp_path / "in" / "a.JPG").read_bytes()


def test_floating_point_pixels_are_refused_and_not_made_black(tmp_path):
    (tmp_path / "in").mkdir()
    Image.fromarray(pixels()[..., 0].astype(np.float32) / 255).save(tmp_path / "in" / "a.tif")
    with pytest.raises(DataError, match="a.tif: .*floating-point pixels have no display range"):
        prepared(tmp_path / "in", tmp_path / "out")


@pytest.mark.skipif(sys.platform != "linux", reason="needs a file system whose names are bytes, as Linux has it")
def test_bytes_of_a_name_that_are_no_utf_8_become_underscores(tmp_path):
    (tmp_path / "in").mkdir()
    Image.fromarray(pixels()).save(tmp_path / "in" / os.fsdecode(b"caf\xe9.png"))  # as Windows of old has it
    assert [p.name for p in prepared(tmp_path / "in", tmp_path / "out")] == ["caf_.png"]
    assert (tmp_path / "out" / "caf_.png").is_file()


def test_no_name_begins_a_comment_of_colmaps_text_files(tmp_path):
    """Pairs to match are lines of names there, and a line that begins with ``#`` is passed over."""
    for folder, name in (("in", "#1/a#1.png"), ("in", "#2.png"), ("masks", "#2.png")):
        (tmp_path / folder / name).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels()).save(tmp_path / folder / name)
    made = prepared(tmp_path / "in", tmp_path / "out")
    assert [p.name for p in made] == ["_1/a#1.png", "_2.png"]
    assert prepare_masks(tmp_path / "masks", made, tmp_path / "made") == 1
    assert (tmp_path / "made" / "_2.png.png").is_file()


def test_a_mask_is_found_whose_letters_are_apart_from_their_marks(tmp_path):
    """As macOS writes them in an archive."""
    for folder, form in zip(("in", "masks"), FORMS, strict=True):
        (tmp_path / folder).mkdir()
        Image.fromarray(pixels()).save(tmp_path / folder / f"{normalize(form, 'ü')}.png")
    made = prepared(tmp_path / "in", tmp_path / "out")
    assert prepare_masks(tmp_path / "masks", made, tmp_path / "made") == 1


def test_a_jpeg_with_a_preview_behind_it_stays_a_jpeg(tmp_path):
    """As drones and phones write them (CIPA DC-007), which Pillow calls MPO."""
    folder = tmp_path / "in"
    folder.mkdir()
    preview = {"format": "MPO", "save_all": True, "append_images": [Image.fromarray(pixels()).resize((8, 6))]}
    Image.fromarray(pixels()).save(folder / "a.jpg", **preview)
    Image.fromarray(pixels()).save(folder / "b.jpg", exif=tags(6), **preview)
    assert [p.name for p in prepared(folder, tmp_path / "out")] == ["a.jpg", "b.jpg"]
    assert (tmp_path / "out" / "a.jpg").read_bytes() == (folder / "a.jpg").read_bytes()
    with Image.open(tmp_path / "out" / "b.jpg") as image:
        assert image.format == "JPEG"
        assert image.size == pixels().shape[:2]


@pytest.mark.parametrize("orientation", [1, 6])
def test_heif_becomes_an_upright_jpeg_of_the_same_colours(tmp_path, orientation):
    """Its pixels are compressed already, and a PNG of what a phone takes has 20 MB."""
    (tmp_path / "in").mkdir()
    exif = tags(orientation)
    exif[MAKE], exif[MODEL] = "Apple", "iPhone 15"
    exif.get_ifd(EXIF)[FOCAL_35MM] = 26
    icc = profile(DISPLAY_P3, SRGB_CURVE)
    file = write_heif(tmp_path / "in" / "IMG 1.HEIC", pixels(), exif=exif.tobytes(), icc_profile=icc)
    (photograph,) = prepared(tmp_path / "in", tmp_path / "out")
    assert prepared(tmp_path / "in", tmp_path / "out") == [photograph]  # now without reading pixels
    height, width = SHOWN[orientation](pixels()).shape[:2]
    assert photograph.name == "IMG_1.jpg" and photograph.camera == f"Apple iPhone 15 26 {width}x{height}"
    assert (photograph.width, photograph.height, photograph.turn) == (width, height, None)
    assert photograph.focal == pytest.approx(26 / np.hypot(36, 24) * np.hypot(width, height))
    with Image.open(tmp_path / "out" / photograph.name) as image:
        assert image.format == "JPEG" and image.getexif().get(ORIENTATION, 1) == 1
    expected = srgb_of(SHOWN[orientation](pixels()) / 255, DISPLAY_P3, SRGB_CURVE)
    for read in (file, tmp_path / "out" / photograph.name):
        assert_shows(read_image(read), expected)


def test_transparent_heif_becomes_png(tmp_path):
    (tmp_path / "in").mkdir()
    alpha = np.zeros((HEIGHT, WIDTH, 1), np.uint8)
    alpha[:, WIDTH // 2 :] = 255
    write_heif(tmp_path / "in" / "a.heic", np.concatenate([pixels(), alpha], axis=2))
    (photograph,) = prepared(tmp_path / "in", tmp_path / "out")
    assert photograph.name == "a.png"
    with Image.open(tmp_path / "out" / "a.png") as image:
        assert image.mode == "RGBA"
        assert_shows(np.asarray(image)[..., 3:] / 255, alpha / 255)


def test_a_mask_says_the_same_in_the_search_for_poses_as_in_training(tmp_path):
    """Erased to transparent, as painting programs do it, with more than 8 bits, or just about white."""
    left = np.zeros((HEIGHT, WIDTH), np.uint16)
    left[:, : WIDTH // 2] = 1
    white, shown = Image.new("L", (WIDTH, HEIGHT), 255), Image.fromarray((255 * left).astype(np.uint8))
    erased = Image.new("P", (WIDTH, HEIGHT), 0)
    erased.putpalette([255, 255, 255] * 2)
    erased.paste(1, None, shown)
    erased.info["transparency"] = 0
    masks = {
        "rgba": Image.merge("RGBA", [white] * 3 + [shown]),
        "la": Image.merge("LA", [white, shown]),
        "red": Image.merge("RGB", [white, shown, shown]),
        "p": erased,
        "deep": Image.fromarray(20_000 + 40_000 * left),
        "grey": Image.fromarray((127 + left).astype(np.uint8)),
    }
    (tmp_path / "masks").mkdir()
    for name, mask in masks.items():
        mask.save(tmp_path / "masks" / f"{name}.png")
    made = [Photograph(f"{name}.png", WIDTH, HEIGHT, "", None) for name in masks]
    assert prepare_masks(tmp_path / "masks", made, tmp_path / "out") == len(masks)
    view = View("", Camera(np.eye(4), 20, 20, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT), np.zeros((HEIGHT, WIDTH, 3)))
    views = [replace(view, name=name) for name in masks]
    for folder in ("masks", "out"):
        read = Masks(tmp_path / folder, views)
        for view in views:
            np.testing.assert_array_equal(read.of(view), left, f"{folder}, {view.name}")


def test_a_mask_of_ones_instead_of_white_is_refused(tmp_path):
    for name in ("in", "masks"):
        (tmp_path / name).mkdir()
    Image.fromarray(pixels()).save(tmp_path / "in" / "a.png")
    Image.fromarray(np.ones(pixels().shape[:2], np.uint8)).save(tmp_path / "masks" / "a.png")
    made = prepared(tmp_path / "in", tmp_path / "out")
    with pytest.raises(DataError, match="a.png: has only 0 and 1, and both are black; multiply it by 255"):
        prepare_masks(tmp_path / "masks", made, tmp_path / "out" / "masks")


def test_a_mask_that_stands_where_its_upright_image_lies_is_refused(tmp_path):
    for name in ("in", "masks"):
        (tmp_path / name).mkdir()
    Image.fromarray(pixels()).save(tmp_path / "in" / "a.png")
    Image.fromarray(np.rot90(pixels()[..., 0])).save(tmp_path / "masks" / "a.png")
    made = prepared(tmp_path / "in", tmp_path / "out")
    with pytest.raises(DataError, match="a.png: is 40x60, turned by 90° against its image, 60x40; turn it"):
        prepare_masks(tmp_path / "masks", made, tmp_path / "out" / "masks")


def test_a_second_start_writes_nothing_again(tmp_path):
    (tmp_path / "in").mkdir()
    Image.fromarray(pixels()).save(tmp_path / "in" / "a.jpg", exif=tags(6))
    first = prepared(tmp_path / "in", tmp_path / "out")
    before = (tmp_path / "out" / "a.jpg").stat().st_mtime_ns
    assert prepared(tmp_path / "in", tmp_path / "out") == first
    assert (tmp_path / "out" / "a.jpg").stat().st_mtime_ns == before


def test_a_file_that_is_cut_off_and_two_of_one_name_are_errors(tmp_path):
    (tmp_path / "in").mkdir()
    Image.fromarray(pixels()).save(tmp_path / "in" / "a.jpg")
    data = (tmp_path / "in" / "a.jpg").read_bytes()
    (tmp_path / "in" / "a.jpg").write_bytes(data[: len(data) // 2])
    with pytest.raises(DataError, match="a.jpg: cannot be read as an image .*; replace the file or remove it"):
        prepared(tmp_path / "in", tmp_path / "out")
    assert not (tmp_path / "out" / "a.jpg").exists()
    (tmp_path / "in" / "a.jpg").write_bytes(data)
    Image.fromarray(pixels()).save(tmp_path / "in" / "a.png")
    two = 'in/a.png: two views have the name "a", of this image and of a.jpg; keep one of them, or rename it'
    with pytest.raises(DataError, match=two):
        prepared(tmp_path / "in", tmp_path / "out")


def exif_of(inner: dict, size=(4000, 3000), tags: dict | None = None):
    image = Image.new("RGB", size)
    exif = Image.Exif()
    exif.update(tags or {})
    exif.get_ifd(EXIF).update(inner)
    image.getexif = lambda: exif  # as of a file with these tags
    return read_exif(image)


def test_the_focal_length_is_that_of_the_equivalent_by_the_diagonal():
    """26 mm of 35 mm film are a phone's main camera: 79.5° along the diagonal (CIPA DC-008)."""
    focal = exif_of({FOCAL_35MM: 26}).focal
    assert focal and abs(2 * np.degrees(np.arctan(2500 / focal)) - 79.5) < 0.1
    assert exif_of({FOCAL_35MM: 26}, size=(2000, 1500)).focal == pytest.approx(focal / 2)
    assert exif_of({FOCAL_35MM: 26, TAKEN_WIDTH: 4000}).focal == focal


@pytest.mark.parametrize("said, mm", [({}, 25.4), ({UNIT: 2}, 25.4), ({UNIT: 3}, 10)])
def test_the_focal_length_of_a_sensor_whose_pixels_per_inch_or_centimetre_are_known(said, mm):
    inner = {FOCAL: 50.0, DENSITY: 4000 / (36 / mm), **said, TAKEN_WIDTH: 4000, TAKEN_HEIGHT: 3000}
    assert exif_of(inner).focal == pytest.approx(50 / 36 * 4000)
    assert exif_of(inner, size=(1000, 750)).focal == pytest.approx(50 / 36 * 1000)


CROPPED = [{FOCAL_35MM: 26, TAKEN_WIDTH: 4000, TAKEN_HEIGHT: height} for height in (2000, 4000)]
NONSENSE = [{FOCAL_35MM: value} for value in (0, -26, np.inf, np.nan, "?")]
NO_SENSOR = [{FOCAL: 50.0} | more for more in ({}, {DENSITY: 1.0}, {DENSITY: 1e6}, {DENSITY: 4e3, UNIT: 1})]


@pytest.mark.parametrize("inner", [{}, *NONSENSE, *NO_SENSOR, *CROPPED])
def test_no_focal_length_is_taken_from_no_tag_from_nonsense_or_of_a_cropped_picture(inner):
    assert exif_of(inner).focal is None


def test_devices_differ_by_make_model_and_focal_length():
    cases = ((4.0, "A"), (9.0, "A"), (4.0, "B"))
    names = [exif_of({FOCAL: mm}, tags={MAKE: "Acme\0", MODEL: model}).device for mm, model in cases]
    assert len(set(names)) == 3 and names[0] == "Acme A 4.0"


@pytest.mark.parametrize("zoomed", [{FOCAL_35MM: 52}, {FOCAL_35MM: 26, DIGITAL_ZOOM: 2.0}])
def test_a_picture_that_a_phone_has_cut_out_and_enlarged_has_a_camera_of_its_own(tmp_path, zoomed):
    """Digital zoom: the lens stays, and so does the size of the picture."""
    (tmp_path / "in").mkdir()
    for name, inner in (("a", {FOCAL_35MM: 26}), ("b", zoomed), ("c", {FOCAL_35MM: 26})):
        exif = Image.Exif()
        exif.get_ifd(EXIF).update({FOCAL: 4.25, **inner})
        Image.fromarray(pixels()).save(tmp_path / "in" / f"{name}.jpg", exif=exif)
    a, b, c = (photograph.camera for photograph in prepared(tmp_path / "in", tmp_path / "out"))
    assert a == c != b


@pytest.mark.parametrize("on_the_file", [True, False])
def test_masks_of_photographs_turned_by_a_quarter_tell_how_those_of_others_lie(tmp_path, on_the_file):
    """Half a turn leaves the shape as it is; a photograph that was not turned has but one way."""
    quarters = {"quarter": (6, -1), "half": (3, 2), "none": (1, 0)}  # EXIF's number, turns that make it upright
    seen = np.full((HEIGHT, WIDTH), 255, np.uint8)
    seen[: HEIGHT // 2, : WIDTH // 3] = 0
    for folder in ("in", "masks"):
        (tmp_path / folder).mkdir()
    for name, (orientation, turns) in quarters.items():
        Image.fromarray(pixels()).save(tmp_path / "in" / f"{name}.jpg", exif=tags(orientation))
        mask = seen if on_the_file else np.rot90(seen, turns)
        Image.fromarray(mask).save(tmp_path / "masks" / f"{name}.png")
    photographs = prepared(tmp_path / "in", tmp_path / "out")
    assert prepare_masks(tmp_path / "masks", photographs, tmp_path / "made") == 3
    for name, (_, turns) in quarters.items():
        made = np.asarray(Image.open(tmp_path / "made" / f"{name}.jpg.png"))
        np.testing.assert_array_equal(made, np.rot90(seen, turns), err_msg=name)


@pytest.mark.parametrize("quarters", [0, 1], ids=["lying", "upright"])
def test_a_mask_painted_on_the_pixels_of_the_file_is_turned_along(tmp_path, quarters):
    (tmp_path / "in").mkdir()
    (tmp_path / "masks").mkdir()
    Image.fromarray(np.rot90(pixels(), quarters)).save(tmp_path / "in" / "a b.jpg", exif=tags(6))
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[:, : WIDTH // 3] = 0
    mask = np.rot90(mask, quarters)
    Image.fromarray(mask[::2, ::2]).save(tmp_path / "masks" / "a b.png")  # smaller than the photograph
    photographs = prepared(tmp_path / "in", tmp_path / "out")
    assert prepare_masks(tmp_path / "masks", photographs, tmp_path / "made") == 1
    made = np.asarray(Image.open(tmp_path / "made" / "a_b.jpg.png"))
    np.testing.assert_array_equal(made, np.rot90(mask, -1))
    Image.fromarray(mask).save(tmp_path / "masks" / "other.png")
    (tmp_path / "masks" / "a b.png").unlink()
    with pytest.raises(DataError, match="has no mask for any of the images; name them like the images, as a_b.png"):
        prepare_masks(tmp_path / "masks", photographs, tmp_path / "made")
