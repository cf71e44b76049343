"""What a video says of its colours, and what comes out as sRGB. The curves are written down here once more."""

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from av.video.reformatter import Colorspace
from mi_dogsplat.poses.video import read_frames, rgb_of
from mi_dogsplat.poses.video_colors import require_colors
from mi_dogsplat.support.errors import DataError
from numpy.typing import NDArray

PATCHES = np.array(
    [[200, 40, 40], [40, 180, 60], [50, 60, 210], [220, 200, 40], [255, 255, 255], [90, 90, 90]], np.uint8
)
PRIMARIES = {  # xy of red, green and blue; all have the white of D65
    "srgb": [(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)],
    "bt2020": [(0.708, 0.292), (0.170, 0.797), (0.131, 0.046)],
    "p3": [(0.680, 0.320), (0.265, 0.690), (0.150, 0.060)],
}
NUMBERS = {"srgb": 1, "bt2020": 9, "p3": 12}  # of ITU-T H.273
LUMA_BT2020 = 0.2627, 0.0593  # shares of red and blue


def xyz_from(name: str) -> NDArray[np.float64]:
    """[3, 3], of linear colours."""
    columns = np.array([(x / y, 1, (1 - x - y) / y) for x, y in PRIMARIES[name]]).T
    white = np.array([0.3127 / 0.3290, 1, (1 - 0.3127 - 0.3290) / 0.3290])
    return columns * np.linalg.solve(columns, white)


def pq(nits: NDArray[np.float64]) -> NDArray[np.float64]:
    y = (nits / 10000) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * y) / (1 + 18.6875 * y)) ** 78.84375


def hlg(nits: NDArray[np.float64], primaries: str) -> NDArray[np.float64]:
    luminance = nits @ xyz_from(primaries)[1]
    scene = nits / 1000 * (luminance[:, None] / 1000) ** (1 / 1.2 - 1)
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(scene <= 1 / 12, np.sqrt(3 * scene), a * np.log(np.maximum(12 * scene - b, 1e-9)) + c)


def linear(levels: NDArray[Any]) -> NDArray[np.float64]:
    v = levels / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def with_primaries(name: str) -> NDArray[np.float64]:
    """The patches as linear colours with these primaries."""
    return np.linalg.solve(xyz_from(name), xyz_from("srgb") @ linear(PATCHES).T).T


def columns(colors: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """[H, W, 3] with a column of each colour."""
    return np.ascontiguousarray(np.broadcast_to(np.repeat(colors, width // len(colors), 0), (height, width, 3)))


def luma_and_chroma(signal: NDArray[np.float64], red: float, blue: float, bits: int = 8) -> NDArray[Any]:
    """Planes [3, 64, 96] of columns with these values [6, 3], in limited range; ``red`` and ``blue`` are shares of luma
    (ITU-T H.273)."""
    r, g, b = signal.T
    luma = red * r + (1 - red - blue) * g + blue * b
    chroma = (b - luma) / (2 - 2 * blue), (r - luma) / (2 - 2 * red)
    levels = np.stack([16 + 219 * luma, *(128 + 224 * c for c in chroma)], -1) * 2 ** (bits - 8)
    whole = np.rint(levels).astype(np.uint8 if bits == 8 else np.uint16)
    return np.ascontiguousarray(np.moveaxis(columns(whole, 64, 96), -1, 0))


def seen(frame: av.VideoFrame) -> NDArray[np.int64]:
    """The middles of the columns, as they come out."""
    picture, step = rgb_of(frame, 1.0), frame.width // len(PATCHES)
    return picture[frame.height // 2, step // 2 :: step].astype(int)


@pytest.mark.parametrize(("primaries", "said"), [("bt2020", 9), ("p3", 12), ("bt2020", 2)], ids=["bt2020", "p3", ""])
@pytest.mark.parametrize("curve", [16, 18], ids=["PQ", "HLG"])
def test_hdr_of_a_phone_comes_out_in_the_colours_of_a_photograph(curve, primaries, said):
    nits = 203 * with_primaries(primaries)
    coded = luma_and_chroma(pq(nits) if curve == 16 else hlg(nits, primaries), *LUMA_BT2020, bits=16)
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(np.moveaxis(coded, 0, -1)), format="yuv444p16le")
    frame.colorspace, frame.color_primaries, frame.color_trc = 9, said, curve
    np.testing.assert_allclose(seen(frame), PATCHES, atol=4)


@pytest.mark.parametrize("primaries", ["srgb", "bt2020", "p3"])
def test_colours_of_a_wide_gamut_become_those_of_srgb(primaries):
    light = np.clip(with_primaries(primaries), 0, 1)
    levels = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055) * 255
    frame = av.VideoFrame.from_ndarray(columns(np.rint(levels).astype(np.uint8), 64, 96), format="rgb24")
    frame = frame.reformat(format="yuv444p", dst_colorspace=int(Colorspace.ITU709))
    frame.colorspace, frame.color_primaries, frame.color_trc = 1, NUMBERS[primaries], 1
    np.testing.assert_allclose(seen(frame), PATCHES, atol=5)


@pytest.mark.parametrize(("matrix", "name"), [(8, "YCgCo"), (12, "the matrix 12 of ITU-T H.273")])
def test_a_matrix_that_ffmpeg_does_not_convert_is_one_line(tmp_path, matrix, name):
    video = tmp_path / "walk.mkv"
    with av.open(str(video), "w") as container:
        stream = container.add_stream("ffv1", 1, options={"strict": "-2"})
        stream.width, stream.height, stream.pix_fmt = 32, 24, "yuv444p"
        stream.codec_context.colorspace = matrix
        for frame in (av.VideoFrame(32, 24, "yuv444p"), None):
            container.mux(stream.encode(frame))
    with pytest.raises(DataError, match=f"walk.mkv: its colours are coded by {name}, which is not read; export it"):
        next(read_frames(video))


@pytest.mark.parametrize(
    ("size", "said", "matrix"),
    [
        ((1280, 720), 2, Colorspace.ITU709),  # nothing said: as players take it
        ((720, 1280), 2, Colorspace.ITU709),
        ((1280, 544), 2, Colorspace.ITU709),
        ((720, 578), 2, Colorspace.ITU709),
        ((720, 576), 2, Colorspace.ITU601),
        ((1280, 720), 5, Colorspace.ITU601),
        ((720, 576), 1, Colorspace.ITU709),
    ],
)
def test_luma_and_chroma_are_read_as_they_were_written(size, said, matrix):
    frame = av.VideoFrame.from_ndarray(columns(PATCHES, size[1], size[0] // 6 * 6), format="rgb24")
    frame = frame.reformat(width=size[0], format="yuv420p", dst_colorspace=int(matrix))
    frame.colorspace = said
    np.testing.assert_allclose(seen(frame), PATCHES, atol=4)


@pytest.mark.parametrize(
    ("number", "red", "blue"),  # shares of luma, ITU-T H.273
    [
        (1, 0.2126, 0.0722),
        (4, 0.30, 0.11),
        (5, 0.299, 0.114),
        (6, 0.299, 0.114),
        (7, 0.212, 0.087),
        (9, 0.2627, 0.0593),
    ],
)
def test_each_matrix_that_is_read_is_that_of_the_standard(number, red, blue):
    frame = av.VideoFrame.from_ndarray(luma_and_chroma(PATCHES / 255, red, blue), format="yuv444p")
    frame.colorspace = number
    require_colors(Path("walk.mkv"), frame, "")
    np.testing.assert_allclose(seen(frame), PATCHES, atol=2)


@pytest.mark.parametrize("matrix", [0, 2, 8])
def test_what_is_no_luma_and_chroma_comes_out_as_it_is(matrix):
    frame = av.VideoFrame.from_ndarray(columns(PATCHES, 64, 96), format="rgb24")
    frame.colorspace = matrix
    require_colors(Path("walk.mkv"), frame, "")
    np.testing.assert_array_equal(seen(frame), PATCHES)
    grey = av.VideoFrame.from_ndarray(np.arange(256, dtype=np.uint8).repeat(6).reshape(16, 96), format="gray")
    grey.color_range = 2
    np.testing.assert_array_equal(rgb_of(grey, 1.0), grey.to_ndarray()[..., None].repeat(3, -1))


@pytest.mark.parametrize("full", [False, True], ids=["limited", "full"])
@pytest.mark.parametrize("aspect", [1.0, 1.5])
def test_frames_are_as_bright_as_they_were_written(full, aspect):
    """On average, of soft colours: rounded down, they would be a level or two darker."""
    waves = np.cos(np.arange(96)[:, None] / 17 + np.arange(120) / 23)  # [H, W]
    written = np.rint(128 + 60 * np.stack([waves, -waves, waves[::-1]], -1))
    red, green, blue = np.moveaxis(written, -1, 0)
    luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    halved = [x.reshape(48, 2, 60, 2).mean((1, 3)) for x in ((blue - luma) / 1.8556, (red - luma) / 1.5748)]
    base, steps, of_chroma = (0, 1, 1) if full else (16, 219 / 255, 224 / 255)
    coded = np.concatenate([base + steps * luma.ravel(), *(128 + of_chroma * x.ravel() for x in halved)])
    frame = av.VideoFrame.from_ndarray(np.rint(coded).astype(np.uint8).reshape(144, 120), format="yuv420p")
    frame.colorspace, frame.color_range = 1, 2 if full else 1
    read = rgb_of(frame, aspect).astype(float)
    assert abs(read.mean((0, 1)) - written.mean((0, 1))).max() < 0.2
