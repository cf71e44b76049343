"""What is in the picture files."""

import subprocess
import sys
from pathlib import Path

import flip_evaluator
import numpy as np
import OpenEXR
import pytest
from mi_dogsplat.support import pictures
from mi_dogsplat.support.srgb import linear_to_srgb, srgb_to_linear
from PIL import Image


def read_exr(path) -> dict[str, np.ndarray]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels.copy() for name, channel in file.channels().items()}


def picture_for(write):
    white = np.ones((2, 3, 3))
    return white if write is pictures.write_png else {"color": white}


def test_srgb_conversions_are_inverse_and_meet_known_values():
    values = np.linspace(-0.1, 1.5, 400, dtype=np.float32)
    np.testing.assert_allclose(linear_to_srgb(srgb_to_linear(values)), values, atol=2e-6)
    np.testing.assert_allclose(srgb_to_linear([0, 0.5, 1]), [0, 0.21404114, 1], atol=1e-6)


def test_heat_map_shows_an_error_as_flip_itself_shows_it():
    rng = np.random.default_rng(1)
    truth = np.tile(np.linspace(0, 1, 40, dtype=np.float32)[:, None, None], (1, 50, 3))
    image = rng.random((40, 50, 3)).astype(np.float32)
    error, _, _ = flip_evaluator.evaluate(truth, image, "LDR", applyMagma=False)
    expected, _, _ = flip_evaluator.evaluate(truth, image, "LDR", applyMagma=True)
    np.testing.assert_allclose(pictures.heat_map(error[..., 0]), expected, atol=4 / 255)


def test_heat_map_ends_in_the_outermost_colours():
    ends = pictures.heat_map(np.array([[-1.0, 0.0, 1.0, 2.0]]))[0]
    np.testing.assert_allclose(ends[:2], [[0, 0, 4 / 255]] * 2)
    np.testing.assert_allclose(ends[2:], [[252 / 255, 253 / 255, 191 / 255]] * 2)


def test_png_is_clamped_and_rounded_to_nearest(tmp_path):
    image = np.array([[[-1.0, 0.0, 0.49 / 255], [0.51 / 255, 1.0, 7.0]]])
    pictures.write_png(tmp_path / "a.png", image)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), [[[0, 0, 0], [1, 255, 255]]])


@pytest.mark.parametrize(("shape", "mode"), [((4, 5), "L"), ((4, 5, 3), "RGB"), ((4, 5, 4), "RGBA")])
def test_png_takes_grey_colour_and_alpha_and_makes_the_folder(tmp_path, shape, mode):
    pictures.write_png(tmp_path / "deeper" / "a.png", np.full(shape, 0.5))
    with Image.open(tmp_path / "deeper" / "a.png") as image:
        assert (image.mode, image.size) == (mode, (5, 4))


def test_png_refuses_nan_and_odd_shapes(tmp_path):
    image = np.zeros((2, 2, 3))
    image[0, :, 1] = np.nan
    with pytest.raises(ValueError, match="has values that are NaN: 2 of 12"):
        pictures.write_png(tmp_path / "a.png", image)
    with pytest.raises(ValueError, match=r"\[2, 2, 5\]"):
        pictures.write_png(tmp_path / "a.png", np.zeros((2, 2, 5)))


def test_exr_holds_every_layer_under_its_channel_names(tmp_path):
    rng = np.random.default_rng(0)
    color, depth = rng.random((6, 7, 4), np.float32), rng.uniform(1, 1e5, (6, 7)).astype(np.float32)
    error, normal = rng.random((6, 7), np.float32), rng.normal(size=(6, 7, 3)).astype(np.float32)
    path = tmp_path / "a.exr"
    pictures.write_exr(path, {"color": color, "depth": depth, "error": error, "normal": normal})
    channels = read_exr(path)
    assert set(channels) == {"R", "G", "B", "A", "depth.Z", "error.Y", "normal.R", "normal.G", "normal.B"}
    rgb = np.stack([channels[c] for c in "RGB"], axis=-1)
    np.testing.assert_array_equal(rgb, srgb_to_linear(color[..., :3]))  # float32 and lossless: exact
    np.testing.assert_array_equal(channels["A"], color[..., 3])
    np.testing.assert_array_equal(channels["depth.Z"], depth)
    np.testing.assert_array_equal(channels["error.Y"], error)
    np.testing.assert_array_equal(channels["normal.B"], normal[..., 2])


def test_exr_takes_channels_by_their_full_names(tmp_path):
    index = np.array([[-1, 2049, 70001]], np.float32)  # no half holds 2049
    pictures.write_exr(tmp_path / "a.exr", {"index.I": index, "normal.X": index / 7})
    channels = read_exr(tmp_path / "a.exr")
    assert set(channels) == {"index.I", "normal.X"}
    np.testing.assert_array_equal(channels["index.I"], index)
    with pytest.raises(ValueError, match=r'"normal.X" is \[1, 3, 3\]'):
        pictures.write_exr(tmp_path / "a.exr", {"index.I": index, "normal.X": np.zeros((1, 3, 3))})


def test_exr_keeps_large_values_infinite_depth_and_nan(tmp_path):
    color, depth = np.full((2, 3, 3), 1e3, np.float32), np.full((2, 3), np.inf, np.float32)
    pictures.write_exr(tmp_path / "a.exr", {"color": color, "depth": depth, "error": np.full((2, 3), np.nan)})
    channels = read_exr(tmp_path / "a.exr")
    np.testing.assert_array_equal(channels["R"], srgb_to_linear(color)[..., 0])
    assert np.isinf(channels["depth.Z"]).all() and np.isnan(channels["error.Y"]).all()


@pytest.mark.parametrize("write", [pictures.write_exr, pictures.write_png])
def test_a_picture_is_written_where_there_is_a_single_core(tmp_path, write):
    """In a process of its own: Mitsuba's own writer of OpenEXR waits for ever, and its reader too."""
    picture = "np.ones((20, 30, 3))" if write is pictures.write_png else "{'color': np.ones((20, 30, 3))}"
    program = f"import mi_dogsplat, sys, drjit as dr, numpy as np; from {write.__module__} import {write.__name__}; "
    program += f"dr.set_thread_count(1); {write.__name__}(sys.argv[1], {picture})"
    command = [sys.executable, "-c", program, str(tmp_path / "x")]
    subprocess.run(command, check=True, timeout=300, cwd=Path(__file__).parents[2])
    assert (tmp_path / "x").stat().st_size > 0


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.uint32])
def test_channels_keep_their_type_and_values_however_they_lie_in_memory(tmp_path, kind):
    stacked = np.arange(2 * 3 * 2).reshape(2, 3, 2).astype(kind)
    pictures.write_channels(tmp_path / "a.exr", {"Y": stacked[..., 0], "id": stacked[..., 1]})
    channels = read_exr(tmp_path / "a.exr")
    for name, plane in (("Y", stacked[..., 0]), ("id", stacked[..., 1])):
        assert channels[name].dtype == kind
        np.testing.assert_array_equal(channels[name], plane)


@pytest.mark.parametrize("write", [pictures.write_exr, pictures.write_png])
def test_a_place_that_cannot_be_written_is_an_os_error_that_says_why(tmp_path, write):
    (tmp_path / "a").mkdir()
    with pytest.raises(OSError) as caught:
        write(tmp_path / "a", picture_for(write))
    assert caught.value.filename == str(tmp_path / "a") and caught.value.strerror == "Is a directory"


@pytest.mark.skipif(sys.platform != "linux", reason="needs a file system whose names are bytes, as Linux has it")
@pytest.mark.parametrize("write", [pictures.write_exr, pictures.write_png])
def test_a_path_may_be_other_than_utf_8(tmp_path, write):
    write(tmp_path / "caf\udce9" / "a\udce9", picture_for(write))  # é of Latin-1, as Python has it
    write(tmp_path / "a", picture_for(write))
    assert (tmp_path / "caf\udce9" / "a\udce9").read_bytes() == (tmp_path / "a").read_bytes()


def test_exr_names_the_layer_that_does_not_fit(tmp_path):
    with pytest.raises(ValueError, match=r'"depth" is \[2, 4\], the picture is \[2, 3\]'):
        pictures.write_exr(tmp_path / "a.exr", {"color": np.zeros((2, 3, 3)), "depth": np.zeros((2, 4))})
    with pytest.raises(ValueError, match=r'"color" is \[2, 3\]'):
        pictures.write_exr(tmp_path / "a.exr", {"color": np.zeros((2, 3))})
    with pytest.raises(ValueError, match="no layer"):
        pictures.write_exr(tmp_path / "a.exr", {})
