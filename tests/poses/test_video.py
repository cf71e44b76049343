"""Videos: which frames are taken, how they are turned, and what is no video."""

import subprocess
import sys
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest
from mi_dogsplat.poses import frames as module
from mi_dogsplat.poses import video as video_module
from mi_dogsplat.poses.frame_choice import LEAST, FrameMark, Odometer, choose, sharpness, shift
from mi_dogsplat.poses.frames import take_frames
from mi_dogsplat.poses.video import grey_of, pixel_aspect, read_frames, rgb_of
from mi_dogsplat.support.errors import DataError
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.ndimage import shift as moved
from turned_video import turned_clockwise

from benchmarks.poses.filmed_scene import write_video

WIDTH, HEIGHT = 160, 96


def texture(seed: int = 0, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Grey [H, W] in 0..1."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(height, width)), 1.5)
    return np.clip(0.5 + 1.5 * noise, 0, 1)


def panned(offsets: Iterable[Any]) -> list[np.ndarray]:
    """Frames uint8 [H, W, 3] of a window that moves to the right by these pixels."""
    wide = texture(width=WIDTH + 400)
    frames = [moved(wide, (0, -x), order=1)[:, 100 : 100 + WIDTH] for x in offsets]
    return [np.repeat(np.rint(255 * frame).astype(np.uint8)[..., None], 3, -1) for frame in frames]


# --- motion and sharpness ---


@pytest.mark.parametrize("dy, dx", [(0, 0), (3, 0), (0, -5), (4, 7)])
def test_the_shift_of_two_pictures_is_found_at_any_exposure(dy, dx):
    big = texture(height=HEIGHT + 40, width=WIDTH + 40)
    a, b = big[20:-20, 20:-20], big[20 + dy : 20 + dy + HEIGHT, 20 + dx : 20 + dx + WIDTH]
    assert shift(a, 0.4 * b + 0.1) == pytest.approx(np.hypot(dy, dx))
    assert shift(0.1 * a + 0.5, 0.1 * b + 0.5) == pytest.approx(np.hypot(dy, dx))
    assert shift(a[:40, :48], b[:40, :48]) == pytest.approx(np.hypot(dy, dx))  # smaller than a block


def test_pictures_that_have_nothing_in_common_are_far_apart_and_empty_ones_do_not_move():
    assert shift(texture(0), texture(1)) == 32
    assert shift(texture(), np.full((HEIGHT, WIDTH), 0.5)) == 32
    assert shift(np.full((HEIGHT, WIDTH), 0.5), np.full((HEIGHT, WIDTH), 0.9)) == 0


def test_motion_below_a_pixel_per_frame_is_not_lost():
    odometer, wide = Odometer(), texture(width=WIDTH + 60)
    marks = [odometer.mark(k, moved(wide, (0, -0.3 * k), order=1)[:, 10 : 10 + WIDTH]) for k in range(100)]
    assert marks[-1].travelled * WIDTH == pytest.approx(0.3 * 99, abs=2)


def test_blur_lowers_sharpness_and_exposure_does_not():
    picture = texture()
    assert sharpness(gaussian_filter(picture, 1.5)) < 0.7 * sharpness(picture)
    assert sharpness(0.4 * picture) == pytest.approx(sharpness(picture), rel=0.01)
    assert sharpness(np.zeros((HEIGHT, WIDTH))) == 0


def test_of_each_bucket_of_motion_the_sharpest_is_taken():
    marks = [FrameMark(k, 0.01 * k, 2.0 if k % 10 == 7 else 1.0) for k in range(100)]
    assert choose(marks, 10) == list(range(7, 100, 10))
    there_and_back = [FrameMark(10 * k, at, k + 1) for k, at in enumerate((0, 0.5, 0.4, 1))]
    assert choose(there_and_back, 2) == [0, 30]


def test_a_camera_that_rests_gives_one_frame_and_one_that_moves_more_gives_more():
    def frames(travelled) -> int:
        return len(choose([FrameMark(k, x, 1.0) for k, x in enumerate(travelled)]))

    assert frames(np.zeros(500)) == 1
    half = np.concatenate([np.linspace(0, 4, 200), np.full(800, 4)])
    assert frames(half) == frames(np.linspace(0, 4, 200)) == 134
    assert frames(np.linspace(0, 3, 2000)) == 100 and frames(np.linspace(0, 0.2, 2000)) == LEAST
    assert frames(np.linspace(0, 100, 20_000)) == 300


# --- files ---


def taken(video: Path, out: Path, n: int | None = None) -> list[str]:
    return [p.name for p in take_frames(video, out / "frames.json", out / "images", n, lambda done, of: None)]


def test_resting_and_blurred_frames_are_left_out(tmp_path):
    frames = panned([*np.arange(0, 60, 2.0), *[60.0] * 30, *np.arange(60, 120, 2.0)])
    for k in range(0, len(frames), 2):
        frames[k] = np.rint(gaussian_filter(frames[k].astype(float), (0, 3, 0))).astype(np.uint8)
    write_video(tmp_path / "walk.mp4", frames)
    names = taken(tmp_path / "walk.mp4", tmp_path, 12)
    numbers = [int(name[6:12]) for name in names]
    assert 10 <= len(numbers) <= 12 and sum(31 <= n < 60 for n in numbers) <= 1
    assert all(n % 2 for n in numbers)
    with Image.open(tmp_path / "images" / names[0]) as image:
        assert np.abs(np.asarray(image, float) - frames[numbers[0]]).mean() < 5


def test_frames_that_are_missing_are_taken_from_the_same_places(tmp_path, monkeypatch):
    video, told, read = tmp_path / "walk.mp4", [], []
    write_video(video, panned(list(np.arange(0, 90, 3.0))))
    chosen = [0, 9, 14, 19]
    monkeypatch.setattr(module, "choose", lambda marks, n: chosen if (len(marks), n) == (30, 4) else [])
    monkeypatch.setattr(
        module, "read_frames", lambda path: (read.append(k) or (k, *frame) for k, *frame in read_frames(path))
    )

    def take() -> list[str]:
        taken = take_frames(video, tmp_path / "frames.json", tmp_path / "images", 4, lambda *row: told.append(row))
        return [p.name for p in taken]

    names = take()
    assert names == [f"frame_{k:06d}.jpg" for k in chosen]
    assert told == [*((k, 0) for k in range(1, 31)), *((k, 4) for k in range(1, 5))]
    assert read == [*range(30), *range(20)]  # no further than to the last one
    files = [tmp_path / "images" / name for name in names]
    before = files[2].read_bytes()
    files[2].unlink()
    files[0].write_bytes(files[1].read_bytes())  # what is there stays there
    monkeypatch.setattr(module, "choose", None)  # the choice is kept
    assert take() == names and told[34:] == [(3, 4)]
    assert files[2].read_bytes() == before and files[0].read_bytes() == files[1].read_bytes()
    monkeypatch.setattr(module, "read_frames", None)  # nothing is missing
    assert take() == names


def test_a_video_that_goes_on_in_another_size_has_a_camera_for_each(tmp_path):
    frames = panned(np.arange(0, 60, 3.0))
    write_video(tmp_path / "a.ts", frames[:10])
    write_video(tmp_path / "b.ts", [frame[:64, :128] for frame in frames[10:]])
    (tmp_path / "walk.mts").write_bytes((tmp_path / "a.ts").read_bytes() + (tmp_path / "b.ts").read_bytes())
    images = tmp_path / "images"
    made = take_frames(tmp_path / "walk.mts", tmp_path / "frames.json", images, 10, lambda done, of: None)
    for photograph in made:
        with Image.open(images / photograph.name) as image:
            assert image.size == (photograph.width, photograph.height)
    assert {(p.camera, p.width) for p in made} == {("video 160x96", 160), ("video 128x64", 128)}


def test_a_phone_held_upright_gives_upright_frames(tmp_path):
    frame = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    frame[: HEIGHT // 2, : WIDTH // 2] = 255  # top left in the file, top right when it is turned clockwise
    write_video(tmp_path / "a.mp4", [frame] * 3)
    turned_clockwise(tmp_path / "a.mp4", tmp_path / "b.mp4")
    _, upright, aspect = next(iter(read_frames(tmp_path / "b.mp4")))
    picture = rgb_of(upright, aspect)
    assert picture.shape == (WIDTH, HEIGHT, 3)
    assert picture[: WIDTH // 2, HEIGHT // 2 :].min() > 200 and picture[WIDTH // 2 :].max() < 50
    assert grey_of(upright, 40).shape == (24, 40)
    assert grey_of(upright, 20).shape == (16, 20) and grey_of(upright, 1000).shape == (HEIGHT, WIDTH)


def test_frames_whose_pixels_are_not_square_are_widened_before_they_are_turned(tmp_path):
    """As HDV has them: 1440x1080 that are shown as 1920x1080."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    circle = (x * 4 / 3 - WIDTH * 2 / 3) ** 2 + (y - HEIGHT / 2) ** 2 < 30**2
    frame = np.repeat((255 * circle).astype(np.uint8)[..., None], 3, -1)
    write_video(tmp_path / "a.mp4", [frame] * 3, Fraction(4, 3))
    turned_clockwise(tmp_path / "a.mp4", tmp_path / "b.mp4")
    wide = round(WIDTH * 4 / 3)
    for name, size in ("a.mp4", (HEIGHT, wide)), ("b.mp4", (wide, HEIGHT)):
        _, squeezed, aspect = next(iter(read_frames(tmp_path / name)))
        shown = rgb_of(squeezed, aspect)[..., 0] > 128
        assert shown.shape == size
        assert [shown.any(axis=k).sum() for k in (0, 1)] == pytest.approx([60, 60], abs=2)


@pytest.mark.parametrize("said", [None, Fraction(0), Fraction(1, 1000), Fraction(1000)])
def test_pixels_that_no_camera_has_are_taken_as_square(said):
    assert pixel_aspect(SimpleNamespace(sample_aspect_ratio=said)) == 1


def test_what_is_damaged_in_the_middle_is_left_out_and_what_is_damaged_much_is_refused(tmp_path):
    frames = panned(list(np.arange(0, 120, 1.0)))
    write_video(tmp_path / "whole.mkv", frames)
    data = bytearray((tmp_path / "whole.mkv").read_bytes())
    assert len(list(read_frames(tmp_path / "whole.mkv"))) == len(frames)
    (tmp_path / "cut.mkv").write_bytes(data[: len(data) * 2 // 3])
    assert 40 < len(list(read_frames(tmp_path / "cut.mkv"))) < len(frames)
    (tmp_path / "head.mkv").write_bytes(data[:600])
    with pytest.raises(DataError, match="head.mkv"):
        list(read_frames(tmp_path / "head.mkv"))


def test_a_tenth_of_what_can_be_decoded_may_be_damaged(tmp_path, monkeypatch):
    video = tmp_path / "walk.mkv"
    write_video(video, panned([0.0]))
    ((_, frame, _),) = read_frames(video)
    good, bad = [frame], None

    def indices(*packets: list[av.VideoFrame] | None) -> list[int]:
        monkeypatch.setattr(video_module, "_decoded_packets", lambda _: iter(packets))
        return [index for index, _, _ in read_frames(video)]

    assert indices(*[bad] * 10, *[good] * 50, [], [frame, frame], *[good] * 48) == list(range(100))
    with pytest.raises(DataError, match="walk.mkv: is damaged: 100 frames could be decoded, 11 packets could not; exp"):
        indices(*[good] * 100, *[bad] * 11)
    with pytest.raises(DataError, match="is damaged: 0 frames could be decoded, 0 packets could not"):
        indices([])
    with pytest.raises(DataError, match="0 frames could be decoded, 11 packets could not"):  # no further than here
        indices(*[bad] * 11, *[good] * 200)


def test_sound_alone_is_no_video(tmp_path):
    with av.open(str(tmp_path / "song.mkv"), "w") as container:
        stream = container.add_stream("pcm_s16le", 8000, layout="mono")
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
    with pytest.raises(DataError, match="song.mkv: holds no pictures, only sound; give a video"):
        next(read_frames(tmp_path / "song.mkv"))


def test_a_video_need_not_be_read_to_its_end(tmp_path):
    """In a process that can be ended where its threads wait for each other."""
    write_video(tmp_path / "walk.mp4", panned(range(40)))
    first = "import sys, pathlib, mi_dogsplat.poses.video as v; next(v.read_frames(pathlib.Path(sys.argv[1])))"
    subprocess.run([sys.executable, "-c", first, str(tmp_path / "walk.mp4")], check=True, timeout=120)


def test_a_time_before_the_first_slash_of_a_name_is_no_protocol(tmp_path, monkeypatch):
    write_video(tmp_path / "walk.mp4", panned([0.0, 1.0, 2.0]))
    (tmp_path / "walk.mp4").rename(tmp_path / "2026-01-01T10:20:30.mp4")
    monkeypatch.chdir(tmp_path)
    assert len(list(read_frames(Path("2026-01-01T10:20:30.mp4")))) == 3


def test_a_playlist_called_like_a_video_is_not_followed(tmp_path):
    write_video(tmp_path / "secret.mp4", panned([0.0, 1.0, 2.0]))
    (tmp_path / "walk.mp4").write_text("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nsecret.mp4\n#EXT-X-ENDLIST\n")
    with pytest.raises(DataError, match=r"walk.mp4: cannot be read as a video \(Invalid data .+\); export it again"):
        list(read_frames(tmp_path / "walk.mp4"))
    (tmp_path / "list.mp4").write_text("ffconcat version 1.0\nfile secret.mp4\n")
    with pytest.raises(DataError, match="cannot be read as a video"):
        list(read_frames(tmp_path / "list.mp4"))
