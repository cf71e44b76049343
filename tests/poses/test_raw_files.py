"""Raw photographs of a scene whose light is known: written here, developed by LibRaw."""

import struct
import sys

import numpy as np
import pytest
from dng_files import LONG, RATIONAL, SHORT, UNDEFINED, write_dng
from mi_dogsplat.cli import main
from mi_dogsplat.poses.raw_files import develop, is_raw, read_header
from mi_dogsplat.support.errors import DataError

rawpy = pytest.importorskip("rawpy", reason="needs rawpy: pip install 'mi_dogsplat[poses]'")
BLOCK = 16  # pixels of a side of one colour; the mosaic is smooth inside of them
NEUTRAL = (0.5, 1.0, 0.7)
FOCAL_35MM, ROWS_PER_STRIP = 0xA405, 0x0116


def scene(most: float = 0.5) -> np.ndarray:
    """Linear light [64, 96, 3] in blocks of random colours, no two sides of which are alike."""
    return np.kron(np.random.default_rng(0).uniform(0.02, most, (4, 6, 3)), np.ones((BLOCK, BLOCK, 1)))


def inside(pixels: np.ndarray, block: int = BLOCK) -> np.ndarray:
    return pixels[block // 2 :: block, block // 2 :: block]


@pytest.mark.parametrize("neutral", [(1, 1, 1), NEUTRAL])
def test_light_is_what_it_was_whatever_colours_the_sensor_has(tmp_path, neutral):
    file = write_dng(tmp_path / "a.dng", scene(), neutral)
    header = read_header(file)
    assert header.balance == pytest.approx([1 / n for n in neutral], rel=1e-3)
    np.testing.assert_allclose(inside(develop(file, header.balance)), inside(scene()), rtol=3e-3)
    np.testing.assert_allclose(inside(develop(file, header.balance, half=True), BLOCK // 2), inside(scene()), rtol=3e-3)


def test_without_a_balance_of_the_camera_it_is_that_of_daylight(tmp_path):
    header = read_header(write_dng(tmp_path / "a.dng", scene(), NEUTRAL, balanced=False))
    assert header.balance == pytest.approx([1 / n for n in NEUTRAL], rel=1e-3)


def test_the_balance_is_the_given_one(tmp_path):
    file = write_dng(tmp_path / "a.dng", scene(0.2), NEUTRAL)
    as_shot = read_header(file).balance
    warmer = develop(file, (2 * as_shot[0], 1.0, as_shot[2]))
    np.testing.assert_allclose(inside(warmer), inside(scene(0.2)) * (2, 1, 1), rtol=3e-3)


def test_brightness_depends_on_the_light_alone_and_ends_where_the_sensor_is_full(tmp_path):
    """Developers for people make each picture as bright as looks well."""
    dark = write_dng(tmp_path / "dark.dng", scene() / 50)
    np.testing.assert_allclose(inside(develop(dark, (1, 1, 1))), inside(scene()) / 50, atol=1e-4)
    nearly = write_dng(tmp_path / "nearly.dng", scene(0.95))
    np.testing.assert_allclose(inside(develop(nearly, (1, 1, 1))), inside(scene(0.95)), rtol=3e-3)
    bright = write_dng(tmp_path / "bright.dng", scene() * 4, NEUTRAL)
    found = inside(develop(bright, read_header(bright).balance))
    np.testing.assert_allclose(found, np.minimum(inside(scene()) * 4, 1), rtol=3e-3)


@pytest.mark.parametrize(("orientation", "shown"), [(1, 0), (3, 2), (6, -1), (8, 1)])
def test_pixels_come_upright(tmp_path, orientation, shown):
    file = write_dng(tmp_path / "a.dng", scene(), orientation=orientation)
    np.testing.assert_allclose(inside(develop(file, (1, 1, 1))), inside(np.rot90(scene(), shown)), rtol=3e-3)


@pytest.mark.parametrize(
    ("exposure", "expected"),
    [((1.0, 100, 1.0), 1), ((0.01, 400, 1.0), 0.04), ((0.5, 200, 2.0), 0.25), (None, None)],
)
def test_the_exposure_is_that_of_the_file(tmp_path, exposure, expected):
    found = read_header(write_dng(tmp_path / "a.dng", scene(), exposure=exposure)).exposure
    assert found is None if expected is None else found == pytest.approx(expected, rel=1e-5)


def test_tags_of_both_directories_are_read(tmp_path):
    exif = {FOCAL_35MM: (SHORT, 26), 0x927C: (UNDEFINED, b"a maker's note"), 0x920A: (RATIONAL, 4.5)}
    tags = read_header(write_dng(tmp_path / "a.dng", scene(), device=("Apple", "iPhone"), exif=exif)).tags
    assert (tags[0x010F], tags[0x0110], tags[FOCAL_35MM], tags[0x920A]) == ("Apple", "iPhone", 26, 4.5)
    assert tags[0x927C] == b"a maker's note"


def test_tags_as_cameras_write_them_are_no_warning(tmp_path):
    """Which would end this test: a tag of more values than TIFF gives it."""
    file = write_dng(tmp_path / "a.dng", scene(), exif={FOCAL_35MM: (SHORT, 26)})
    one, two = (struct.pack("<HHI", ROWS_PER_STRIP, LONG, n) for n in (1, 2))
    file.write_bytes(file.read_bytes().replace(one, two))
    assert read_header(file).tags[FOCAL_35MM] == 26


@pytest.mark.parametrize("read", [read_header, lambda path: develop(path, (1, 1, 1))])
def test_what_is_no_raw_photograph_is_one_line(tmp_path, read):
    whole = write_dng(tmp_path / "a.dng", scene()).read_bytes()
    for data in (b"", b"no picture at all", whole[:40]):
        (tmp_path / "a.dng").write_bytes(data)
        with pytest.raises(DataError, match=r"a\.dng: cannot be read as a raw photograph \(.*\); replace") as raised:
            read(tmp_path / "a.dng")
        assert "\n" not in str(raised.value)
    (tmp_path / "a.dng").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"a\.dng: cannot be read as a raw photograph"):
        develop(tmp_path / "a.dng", (1, 1, 1))


def test_files_are_told_by_their_names(tmp_path):
    assert is_raw(tmp_path / "a.CR3") and is_raw(tmp_path / "a.dng") and not is_raw(tmp_path / "a.tif")


@pytest.mark.parametrize("command", ["poses", "train"])
def test_without_the_package_a_line_says_what_to_install(tmp_path, monkeypatch, capsys, command):
    for name in ("1.dng", "2.dng"):
        write_dng(tmp_path / name, scene())
    monkeypatch.setitem(sys.modules, "rawpy", None)
    assert main([command, str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line == "dogsplat: this needs the package rawpy: pip install 'mi_dogsplat[poses]'"
