"""HEIF as phones and cameras write it: upright, in tiles, with colours that it names in either of two ways."""

import sys

import numpy as np
import pytest
from heif_files import assert_shows, picture, write_heif
from icc_profiles import ADOBE_CURVE, ADOBE_RGB, DISPLAY_P3, SRGB, SRGB_CURVE, profile, srgb_of
from mi_dogsplat.cli import main
from mi_dogsplat.datasets.color_profiles import space_of
from mi_dogsplat.datasets.images import header, is_opaque, is_turned, read_image
from mi_dogsplat.support.errors import DataError
from PIL import Image

ORIENTATION = 0x0112
BT2020 = (0.708, 0.292), (0.170, 0.797), (0.131, 0.046)
# where row 0 and column 0 of the file are shown, by the definition of EXIF 2.32
SHOWN = {
    1: lambda p: p, 2: lambda p: p[:, ::-1], 3: lambda p: p[::-1, ::-1], 4: lambda p: p[::-1],
    5: lambda p: p.swapaxes(0, 1), 6: lambda p: np.rot90(p, -1), 7: lambda p: np.rot90(p, 2).swapaxes(0, 1),
    8: lambda p: np.rot90(p, 1),
}  # fmt: skip


@pytest.mark.parametrize("orientation", SHOWN)
def test_pixels_come_upright_and_nothing_asks_to_turn_them_again(tmp_path, orientation):
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    file, shown = write_heif(tmp_path / "a.heic", picture(), exif=exif.tobytes()), SHOWN[orientation](picture())
    assert_shows(read_image(file), shown / 255)
    assert header(file) == (shown.shape[1::-1], False) and not is_turned(file)


@pytest.mark.parametrize("brand", [b"heic", b"heix", b"mif1"])
def test_what_an_encoder_names_first_does_not_matter(tmp_path, brand):
    file = write_heif(tmp_path / "a.heic", picture())
    data = file.read_bytes()
    file.write_bytes(data[:8] + brand + data[12:])
    assert_shows(read_image(file), picture() / 255)


def test_a_picture_in_tiles_is_whole_whatever_its_file_is_called(tmp_path):
    pixels = np.tile(picture(), (2, 2, 1))[:100, :150]
    file = write_heif(tmp_path / "a.jpg", pixels, tile_size=64)
    assert_shows(read_image(file), pixels / 255)


@pytest.mark.parametrize(
    ("code", "primaries"), [((1, 13), SRGB), ((2, 2), SRGB), ((12, 13), DISPLAY_P3), ((9, 1), BT2020)]
)
def test_colours_become_srgb_by_the_numbers_of_the_file(tmp_path, code, primaries):
    named = {"color_primaries": code[0], "transfer_characteristics": code[1]}
    found = read_image(write_heif(tmp_path / "a.heic", picture(), **named))
    assert_shows(found, srgb_of(picture() / 255, primaries, SRGB_CURVE))


def test_a_profile_comes_before_the_numbers(tmp_path):
    icc = profile(ADOBE_RGB, ADOBE_CURVE)
    file = write_heif(tmp_path / "a.heic", picture(), icc_profile=icc)
    assert_shows(read_image(file), srgb_of(picture() / 255, ADOBE_RGB, ADOBE_CURVE))
    both = Image.new("RGB", (8, 6))  # as a file has it that is not written here
    both.info = {"icc_profile": icc, "nclx_profile": {"color_primaries": 9, "transfer_characteristics": 16}}
    assert space_of(both) == icc


@pytest.mark.parametrize("code", [(9, 16), (9, 18), (11, 13)])
def test_colours_that_are_not_read_are_refused(tmp_path, code):
    named = {"color_primaries": code[0], "transfer_characteristics": code[1]}
    file = write_heif(tmp_path / "a.hif", picture(), **named)
    with pytest.raises(DataError, match=rf"a\.hif: .*its colours, {code[0]}/{code[1]} by nclx, are not read; save it"):
        read_image(file)


def test_alpha_stays_and_colours_are_premultiplied(tmp_path):
    alpha = np.repeat(np.linspace(0, 255, 96).astype(np.uint8)[None, :, None], 64, axis=0)
    file = write_heif(tmp_path / "a.heic", np.concatenate([picture(), alpha], axis=2))
    found = read_image(file)
    assert header(file) == ((96, 64), True) and not is_opaque(file)
    assert_shows(found[..., 3:], alpha / 255)
    assert_shows(found[..., :3], picture() / 255 * (alpha / 255))


def test_a_damaged_file_is_one_line(tmp_path):
    """Cut off, and with the pixels of another picture's length, which libheif notices only when it decodes them."""
    file = write_heif(tmp_path / "a.heic", picture())
    data = file.read_bytes()
    pixels = data.index(b"mdat") + 4
    for damaged in (data[:12], data[:200], data[:-20], data[:pixels] + bytes(len(data) - pixels)):
        file.write_bytes(damaged)
        with pytest.raises(DataError, match=r"a\.heic: cannot be read as an image \(") as raised:
            read_image(file)
        assert "\n" not in str(raised.value)


@pytest.mark.parametrize("command", ["poses", "train"])
def test_without_the_package_a_line_says_what_to_install(tmp_path, monkeypatch, capsys, command):
    for name in ("1.heic", "2.heic"):
        write_heif(tmp_path / name, picture())
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    assert main([command, str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line == "dogsplat: this needs the package pillow_heif: pip install 'mi_dogsplat[poses]'"
    assert not (tmp_path / "out").exists()
