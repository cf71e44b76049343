"""OpenEXR files as pictures: windows, parts, layers, kinds of values, and what is wrong with bad ones."""

import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from mi_dogsplat.datasets import claimed_size
from mi_dogsplat.datasets.exr import exr_header, exr_saturation, read_exr
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.pictures import SATURATION, write_radiance

RNG = np.random.default_rng(0)
RGB = RNG.uniform(0, 40, (6, 9, 3)).astype(np.float32)
COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA", "ZSTD", "HTJ2K32")


def window(left: int, top: int, right: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([right - 1, bottom - 1], np.int32)


def write(path: Path, channels: dict, **header) -> Path:
    with np.errstate(all="ignore"):
        OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels).write(str(path))
    return path


def error_of(path: Path) -> str:
    with pytest.raises(DataError) as raised:
        read_exr(path)
    assert str(raised.value).startswith(f"{path}: ") and "\n" not in str(raised.value)
    return str(raised.value)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_halves_and_floats_are_read_as_they_are_with_alpha_where_there_is_one(tmp_path, dtype):
    rgba = np.concatenate([RGB, RNG.uniform(0, 1, (6, 9, 1))], -1).astype(dtype)
    path = write(tmp_path / "a.exr", {"RGBA": rgba})
    np.testing.assert_array_equal(read_exr(path), rgba.astype(np.float32))
    assert exr_header(path) == ((9, 6), True)
    path = write(tmp_path / "b.exr", {name: np.ascontiguousarray(rgba[..., c]) for c, name in enumerate("RGB")})
    np.testing.assert_array_equal(read_exr(path), rgba[..., :3].astype(np.float32))
    assert exr_header(path) == ((9, 6), False)


@pytest.mark.parametrize(("across", "down"), [(2, 1), (1, 2)])
def test_channels_of_fewer_pixels_than_others_are_refused(tmp_path, across, down):
    """As of YCbCr: of R, the last in a line, every second pixel or line is there alone."""
    path = write(tmp_path / "a.exr", {"RGB": RGB[:4, :4].copy()}, compression=OpenEXR.NO_COMPRESSION)
    data = path.read_bytes()
    at = data.index(b"R\0" + struct.pack("<I", 2), data.index(b"chlist\0")) + 10
    first = data.index(struct.pack("<II", 0, 48))  # line 0, of 48 bytes
    lines, places, begin = [], [], first
    for y in range(4):
        values = np.ones(8 + (4 // across if y % down == 0 else 0), "<f4").tobytes()
        lines.append(struct.pack("<II", y, len(values)) + values)
        places.append(begin)
        begin += len(lines[-1])
    header = data[:at] + struct.pack("<II", across, down) + data[at + 8 : first - 32]
    path.write_bytes(header + struct.pack("<4Q", *places) + b"".join(lines))
    assert "has channels of fewer pixels than others" in error_of(path)


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_every_compression_is_read(tmp_path, name):
    ramp = np.linspace(0.5, 9, 32 * 48, dtype=np.float32).reshape(32, 48, 1).repeat(3, 2).astype(np.float16)
    path = write(tmp_path / "a.exr", {"RGB": ramp}, compression=getattr(OpenEXR, f"{name}_COMPRESSION"))
    np.testing.assert_allclose(read_exr(path), ramp.astype(np.float32), rtol=0.05)  # some lose a little


def test_tiles_are_read_as_scan_lines_are(tmp_path):
    path = write(tmp_path / "a.exr", {"RGB": RGB}, type=OpenEXR.tiledimage, tiles=OpenEXR.TileDescription())
    np.testing.assert_array_equal(read_exr(path), RGB)


def test_the_picture_is_the_display_window_black_where_the_data_window_ends(tmp_path):
    path = write(tmp_path / "a.exr", {"RGB": RGB}, dataWindow=window(2, 1, 11, 7), displayWindow=window(0, 0, 12, 8))
    picture = read_exr(path)
    assert picture.shape == (8, 12, 3) and exr_header(path)[0] == (12, 8)
    np.testing.assert_array_equal(picture[1:7, 2:11], RGB)
    assert picture.sum() == pytest.approx(RGB.sum(), rel=1e-5)
    path = write(tmp_path / "b.exr", {"RGB": RGB}, dataWindow=window(-2, -1, 7, 5), displayWindow=window(0, 0, 4, 8))
    picture = read_exr(path)
    np.testing.assert_array_equal(picture[:5], RGB[1:, 2:6])
    assert picture.shape == (8, 4, 3) and not picture[5:].any()


def test_the_first_part_with_colours_is_the_picture(tmp_path):
    depth = OpenEXR.Part({"name": "depth"}, {"Z": RGB[..., 0].copy()}, "depth")
    beauty = OpenEXR.Part({"name": "beauty"}, {"RGB": RGB}, "beauty")
    OpenEXR.File([depth, beauty]).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr"), RGB)


def test_unnamed_channels_come_before_layers_and_a_single_layer_will_do(tmp_path):
    layer = {f"diffuse.{name}": RGB[..., c] + 1 for c, name in enumerate("RGB")}
    plain = {name: RGB[..., c].copy() for c, name in enumerate("RGB")}
    np.testing.assert_array_equal(read_exr(write(tmp_path / "a.exr", layer | plain | {"Z": RGB[..., 0].copy()})), RGB)
    np.testing.assert_array_equal(read_exr(write(tmp_path / "b.exr", layer)), RGB + 1)
    other = {f"specular.{name}": RGB[..., c].copy() for c, name in enumerate("RGB")}
    several = write(tmp_path / "c.exr", layer | other)
    assert "several layers, and none is the picture: diffuse, specular" in error_of(several)


def test_luminance_alone_is_grey(tmp_path):
    path = write(tmp_path / "a.exr", {"Y": RGB[..., 0].copy()})
    np.testing.assert_array_equal(read_exr(path), RGB[..., :1].repeat(3, 2))


def test_negative_light_becomes_none(tmp_path):
    picture = read_exr(write(tmp_path / "a.exr", {"RGB": RGB - 20}))
    np.testing.assert_array_equal(picture, np.maximum(RGB - 20, 0))


def test_bad_files_get_one_line(tmp_path):
    good = write(tmp_path / "good.exr", {"RGB": RNG.uniform(0, 1, (64, 64, 3)).astype(np.float32)})
    data = good.read_bytes()
    for n in (0, 5, 150):
        (tmp_path / "cut.exr").write_bytes(data[:n])
        assert "cannot be read as OpenEXR" in error_of(tmp_path / "cut.exr")
    (tmp_path / "cut.exr").write_bytes(data[: len(data) // 2])
    assert "damaged" in error_of(tmp_path / "cut.exr")
    assert "cannot be read as OpenEXR" in error_of(tmp_path / "none.exr")
    broken = RGB.copy()
    broken[1, 2] = [np.nan, np.inf, 1]
    assert "has values that are NaN or infinite: 2 of 162" in error_of(write(tmp_path / "nan.exr", {"RGB": broken}))
    assert "no channels R, G, B or Y, but Z" in error_of(write(tmp_path / "z.exr", {"Z": RGB[..., 0].copy()}))
    whole = {name: np.ones((4, 4), np.uint32) for name in "RGB"}
    assert "whole numbers" in error_of(write(tmp_path / "id.exr", whole))
    huge = write(tmp_path / "huge.exr", {"RGB": RGB}, displayWindow=window(0, 0, 1 << 20, 1 << 20))
    assert "are no photograph" in error_of(huge)


def test_what_lies_outside_of_the_picture_is_no_way_to_fill_the_memory(tmp_path, monkeypatch):
    """A few bytes unpack to the whole data window, of every part."""
    monkeypatch.setattr(claimed_size, "ALWAYS_READ", 1 << 10)
    shown, dark = window(0, 0, 4, 4), np.zeros((1200, 1200), np.float16)
    large = {"RGB": np.broadcast_to(dark[..., None], (1200, 1200, 3)).copy()}
    path = write(tmp_path / "a.exr", large, displayWindow=shown)
    assert "1200x1200 pixels" in error_of(path)
    small = OpenEXR.Part({"name": "picture", "displayWindow": shown}, {"RGB": RGB[:4, :4].copy()}, "picture")
    beside = OpenEXR.Part({"name": "more", "displayWindow": shown}, {"Z": dark}, "more")
    OpenEXR.File([small, beside]).write(str(tmp_path / "b.exr"))
    assert "1200x1200 pixels" in error_of(tmp_path / "b.exr")


def test_what_halves_cannot_hold_becomes_the_most_that_they_can(tmp_path):
    write_radiance(tmp_path / "a.exr", np.full((2, 2, 3), 1e6, np.float32))
    assert read_exr(tmp_path / "a.exr").max() == 65504


def test_the_value_of_a_full_sensor_is_an_attribute_of_the_part_that_is_the_picture(tmp_path):
    write_radiance(tmp_path / "a.exr", RGB, 0.75)
    write_radiance(tmp_path / "b.exr", RGB)
    assert exr_saturation(tmp_path / "a.exr") == 0.75 and exr_saturation(tmp_path / "b.exr") is None
    beside = OpenEXR.Part({"name": "depth", SATURATION: 3.0}, {"Z": np.ones(RGB.shape[:2], np.float32)}, "depth")
    picture = OpenEXR.Part({"name": "picture", SATURATION: 2.0}, {"RGB": RGB.copy()}, "picture")
    OpenEXR.File([beside, picture]).write(str(tmp_path / "c.exr"))
    assert exr_saturation(tmp_path / "c.exr") == 2


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), "bright"])
def test_a_value_of_a_full_sensor_that_is_none_is_refused(tmp_path, value):
    path = write(tmp_path / "a.exr", {"RGB": RGB}, **{SATURATION: value})
    with pytest.raises(DataError, match="a.exr: has the attribute sensorSaturation = .* no radiance above 0; remove"):
        exr_saturation(path)
