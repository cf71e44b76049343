"""``dogsplat film``: what the files hold, that nothing is half-written, and what is said of bad input."""

import errno
import itertools
import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import Drawing, Model, write_model, write_ply
from mi_dogsplat.film.film_config import FilmConfig
from mi_dogsplat.film.make import make_film
from mi_dogsplat.film.subject import read_subject
from mi_dogsplat.film.video import write_video
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.runs.stopping import Stopped
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import linear_to_srgb, srgb_to_linear
from rendered_files import read_png

SHORT = FilmConfig(seconds=0.5, fps=8, size=(64, 48))


@pytest.fixture
def keys(tmp_path) -> Path:
    """Four cameras of the tiny data as key frames."""
    listed = []
    for camera in tiny_data.cameras()[:4]:
        write_camera(tmp_path / "camera.json", camera)
        listed.append(json.loads((tmp_path / "camera.json").read_text()))
    (tmp_path / "keys.json").write_text(json.dumps(listed))
    (tmp_path / "camera.json").unlink()
    return tmp_path / "keys.json"


def decoded(path: Path) -> tuple[list[np.ndarray], dict]:
    """Frames [H, W, 3] in 0..1, and what the stream says of itself."""
    import av
    from av.video.reformatter import Colorspace

    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        context = stream.codec_context
        says = {
            "codec": context.name, "format": context.pix_fmt, "rate": stream.average_rate, "frames": stream.frames,
            "tags": [int(context.color_range), int(context.color_primaries), int(context.color_trc),
                     int(context.colorspace)],
        }  # fmt: skip
        # the matrix by name: older versions of PyAV decode with that of BT.601 whatever the file says
        converted = (frame.reformat(format="rgb24", src_colorspace=Colorspace.ITU709) for frame in file.decode(stream))
        return [frame.to_ndarray() / 255.0 for frame in converted], says


# --- pictures ---


def test_numbered_pictures_are_the_renders_of_the_key_frames(model, keys, tmp_path):
    config = FilmConfig(path=str(keys), seconds=4, fps=1)
    film = make_film(model, tmp_path / "frames", config=config)
    assert (film.n_frames, film.size) == (4, (48, 36))
    assert sorted(p.name for p in (tmp_path / "frames").iterdir()) == [*(f"000{i}.png" for i in range(4)), "film.json"]
    for i, camera in enumerate(tiny_data.cameras()[:4]):
        expected = tiny_data.picture(tiny_data.truth(), camera).color
        assert abs(read_png(tmp_path / "frames" / f"000{i}.png") / 255 - expected).max() <= 0.51 / 255 + 1e-4


@pytest.mark.parametrize(("seconds", "fps", "count"), [(0.5, 8, 4), (0.1, 30, 3), (0.01, 30, 1), (1.0, 7, 7)])
def test_a_film_has_so_many_frames_as_its_time_says(model, tmp_path, seconds, fps, count):
    film = make_film(model, tmp_path / "f.mp4", config=FilmConfig(seconds=seconds, fps=fps, size=(16, 16)))
    frames, says = decoded(tmp_path / "f.mp4")
    assert film.n_frames == len(frames) == says["frames"] == count and says["rate"] == fps


def test_an_exr_holds_premultiplied_linear_colour_with_alpha(model, keys, tmp_path):
    config = FilmConfig(path=str(keys), seconds=4, fps=1)
    make_film(model, tmp_path / "f" / "f_%03d.exr", config=config, options=PictureOptions(background="white"))
    file = OpenEXR.File(str(tmp_path / "f" / "f_002.exr")).channels()["RGBA"].pixels
    expected = tiny_data.picture(tiny_data.truth(), tiny_data.cameras()[2])
    np.testing.assert_allclose(file[..., :3], srgb_to_linear(expected.color), atol=1e-4)
    np.testing.assert_allclose(file[..., 3], expected.alpha, atol=1e-4)


def test_numbered_pictures_have_the_size_of_the_cameras_and_a_video_the_even_one_below(model, tmp_path):
    camera = replace(tiny_data.cameras()[0], width=33, height=25)
    write_camera(tmp_path / "camera.json", camera)
    keys = [json.loads((tmp_path / "camera.json").read_text())] * 2
    (tmp_path / "keys.json").write_text(json.dumps(keys))
    along = FilmConfig(path=str(tmp_path / "keys.json"), seconds=0.1)
    assert make_film(model, tmp_path / "frames", config=along).size == (33, 25)
    expected = tiny_data.picture(tiny_data.truth(), camera).color
    assert abs(read_png(tmp_path / "frames" / "0000.png") / 255 - expected).max() < 0.01
    assert make_film(model, tmp_path / "film.mp4", config=along).size == (32, 24)


def test_a_folder_may_have_a_point_in_its_name(model, tmp_path):
    (tmp_path / "take 1.2").mkdir()
    make_film(model, tmp_path / "take 1.2", config=replace(SHORT, seconds=0.1))
    assert sorted(p.name for p in (tmp_path / "take 1.2").iterdir()) == ["0000.png", "film.json"]


@pytest.mark.parametrize("name", ["take 1.2", "film.mp4", "0%d.png"])
def test_what_ends_in_a_slash_is_a_folder_that_need_not_be_there(model, tmp_path, name, capsys):
    argv = ["film", model, "-o", f"{tmp_path / name}/", "--seconds", "0.1", "--fps", "8", "--size", "16", "16"]
    for _ in range(2):  # to be gone on with, too
        assert run(capsys, *argv)[0] == 0
    assert sorted(p.name for p in (tmp_path / name).iterdir()) == ["0000.png", "film.json"]


def test_the_background_takes_nothing_of_an_exr(model, keys, tmp_path):
    """Over white, half of a colour brighter than 1 would be clamped before the background is taken away."""
    truth = tiny_data.truth()
    bright = replace(truth, sh_coeffs=truth.sh_coeffs + 3, logit_opacities=np.zeros_like(truth.logit_opacities))
    write_ply(tmp_path / "bright.ply", bright)
    expected = tiny_data.picture(bright, tiny_data.cameras()[0])
    assert (expected.color.max(-1) > expected.alpha + 0.1).any()
    for background in ("black", "white"):
        out, options = tmp_path / background / "%d.exr", PictureOptions(background=background)
        make_film(tmp_path / "bright.ply", out, config=FilmConfig(path=str(keys), seconds=1, fps=1), options=options)
        file = OpenEXR.File(str(tmp_path / background / "0.exr")).channels()["RGBA"].pixels
        np.testing.assert_allclose(file[..., :3], srgb_to_linear(expected.color), atol=1e-4)


@pytest.mark.parametrize("by", ["flag", "file"])
def test_a_near_clip_that_is_given_is_kept_without_data(model, keys, tmp_path, by):
    """One that nobody gave is smaller where a model is, and so is that of a file on an orbit."""
    camera = tiny_data.cameras()[0]
    depths = camera.project(tiny_data.truth().means)[1]
    near_clip = float(np.median(depths))
    config = FilmConfig(path=str(keys), seconds=1, fps=1)
    given, said = PictureOptions(near_clip=near_clip if by == "flag" else None), tmp_path / "said.ply"
    write_model(said, Model(tiny_data.truth(), Drawing(near_clip=near_clip)))
    make_film(model if by == "flag" else said, tmp_path / "f", config=config, options=given)
    left = tiny_data.truth().select(depths > near_clip)
    expected = tiny_data.picture(left, camera).color
    assert abs(expected - tiny_data.picture(tiny_data.truth(), camera).color).max() > 0.1
    assert abs(read_png(tmp_path / "f" / "0000.png") / 255 - expected).max() <= 0.51 / 255 + 1e-4
    assert json.loads((tmp_path / "f" / "film.json").read_text())["near_clip"] == near_clip
    assert read_subject(said, None, PictureOptions()).drawn.near_clip < near_clip


def test_motion_blur_is_the_mean_of_linear_light(model, tmp_path):
    """Of the pictures at its moments, which a film with as many more frames in a second has."""
    blurred = FilmConfig(seconds=1, fps=3, size=(48, 36), shutter=1.0, samples=2)
    make_film(model, tmp_path / "blur", config=blurred)
    make_film(model, tmp_path / "fine", config=FilmConfig(seconds=1, fps=12, size=(48, 36)))
    for number in range(3):  # moments at -1/4 and 1/4 of a frame: frames 4 n - 1 and 4 n + 1 of the fine film
        parts = [read_png(tmp_path / "fine" / f"{(4 * number + k) % 12:04d}.png") / 255 for k in (-1, 1)]
        expected = linear_to_srgb(np.mean([srgb_to_linear(part) for part in parts], axis=0))
        difference = abs(read_png(tmp_path / "blur" / f"{number:04d}.png") / 255 - expected)
        assert difference.max() < 0.03 and difference.mean() < 0.004  # rounding to 8 bits, which is coarse in the dark
        assert abs(np.mean(parts, axis=0) - expected).max() > 0.05  # the mean of display values is another


# --- videos ---


def test_the_video_shows_the_frames_within_the_error_of_its_codec(model, tmp_path):
    make_film(model, tmp_path / "frames", config=SHORT)
    make_film(model, tmp_path / "film.mp4", config=SHORT)
    frames, says = decoded(tmp_path / "film.mp4")
    assert says["codec"] == "h264" and says["format"] == "yuv420p"
    assert says["tags"] == [1, 1, 1, 1]  # limited range; BT.709 primaries, transfer and matrix
    for number, frame in enumerate(frames):
        truth = read_png(tmp_path / "frames" / f"{number:04d}.png") / 255
        assert abs(frame - truth).mean() < 0.02
        others = [abs(frame - read_png(tmp_path / "frames" / f"{k:04d}.png") / 255).mean() for k in range(4)]
        assert int(np.argmin(others)) == number


def test_a_video_may_have_a_time_in_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = "2026-01-01T10:20:30.mp4"
    write_video(Path(name), [np.zeros((16, 16, 3))] * 2, (16, 16), fps=10, crf=18)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert len(decoded(tmp_path / name)[0]) == 2


def test_the_file_is_opened_before_the_first_frame_is_rendered(tmp_path):
    """Where it cannot be, nobody waits for frames that are lost."""

    def frames():
        assert len(list(tmp_path.glob(".a.mp4.*.part"))) == 1
        yield np.zeros((16, 16, 3))

    write_video(tmp_path / "a.mp4", frames(), (16, 16), fps=10, crf=18)
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


@pytest.mark.parametrize("color", [(0, 0, 0), (1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.2, 0.5, 0.8)])
def test_colours_come_back_from_a_video(tmp_path, color):
    """A wrong matrix (that of BT.601) would be off by a twentieth in green, a wrong range by as much in black."""
    image = np.broadcast_to(np.array(color, np.float32), (32, 48, 3))
    write_video(tmp_path / "c.mp4", [image] * 2, (48, 32), 24, 10)
    frames, _ = decoded(tmp_path / "c.mp4")
    assert abs(frames[1].mean(axis=(0, 1)) - color).max() < 0.015


def test_a_lower_crf_is_nearer_to_the_truth_and_larger(model, tmp_path):
    sizes = []
    for crf in (5, 45):
        make_film(model, tmp_path / f"{crf}.mp4", config=FilmConfig(seconds=0.5, fps=8, size=(64, 48), crf=crf))
        sizes.append((tmp_path / f"{crf}.mp4").stat().st_size)
    assert sizes[0] > 2 * sizes[1]


# --- stopping ---


def test_a_disk_that_is_full_in_the_middle_of_a_video_is_one_line(model, tmp_path, capsys, monkeypatch):
    from av import error

    def full(*_):
        raise error.OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # as its encoder does

    monkeypatch.setattr("mi_dogsplat.film.model_frames.exposed", full)
    command = ["film", model, "-o", tmp_path / "film.mp4", "--seconds", "0.1", "--size", "64", "64"]
    assert_one_line(run(capsys, *command), f"{tmp_path / 'film.mp4'}: cannot be written (No space left on device)")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("n", [0, 1])
def test_a_disk_that_is_full_at_a_picture_is_one_line_and_nothing_stays_of_a_film_without_pictures(
    model, tmp_path, capsys, monkeypatch, n
):
    from mi_dogsplat.film.model_frames import ModelFrames

    def full(frames, file, number, *given, own=ModelFrames.write_exr):
        if number == n:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))
        own(frames, file, number, *given)

    monkeypatch.setattr(ModelFrames, "write_exr", full)
    command = ["film", model, "-o", tmp_path / "new" / "f_%03d.exr", "--seconds", "0.1", "--size", "8", "8"]
    status, _, error = run(capsys, *command)
    assert status == 2 and error.splitlines()[-1].startswith(f"dogsplat: {tmp_path / 'new' / 'f_%03d.exr'}: cannot be")
    left = sorted(path.name for path in tmp_path.glob("new/f*"))
    assert left == (["f_000.exr", "film.json"] if n else []) and (tmp_path / "new").exists() == bool(n)


@pytest.mark.parametrize("name", ["film.mp4", "frames"])
def test_what_the_callers_function_raises_is_not_blamed_on_the_disk(model, tmp_path, name):
    def progress(done: int, n: int, what: str) -> None:
        raise ConnectionResetError("nobody listens")

    with pytest.raises(ConnectionResetError, match="^nobody listens$"):
        make_film(model, tmp_path / name, config=SHORT, progress=progress)
    assert not (tmp_path / "film.mp4").exists()


def test_a_film_that_is_stopped_leaves_no_video(model, tmp_path):
    def stop(done: int, n: int, what: str) -> None:
        if done == 2:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Stopped, match="stopped after 2 of 4 frames; there is no .*film.mp4"):
        make_film(model, tmp_path / "film.mp4", config=SHORT, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_pictures_go_on_where_they_were_stopped(model, tmp_path):
    def stop(done: int, n: int, what: str) -> None:
        if done == 2:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Stopped, match="stopped after 2 of 4 frames; the same command again goes on") as stopped:
        make_film(model, tmp_path / "f", config=SHORT, progress=stop)
    assert stopped.value.signal_number == signal.SIGTERM
    times = {p: p.stat().st_mtime_ns for p in (tmp_path / "f").glob("*.png")}
    assert sorted(p.name for p in times) == ["0000.png", "0001.png"]
    make_film(model, tmp_path / "f", config=SHORT)
    make_film(model, tmp_path / "whole", config=SHORT)
    assert times == {p: p.stat().st_mtime_ns for p in times}  # not rendered again
    for number in range(4):
        pair = [(tmp_path / name / f"{number:04d}.png").read_bytes() for name in ("f", "whole")]
        assert pair[0] == pair[1]


def test_frames_of_two_films_are_not_mixed(model, tmp_path):
    make_film(model, tmp_path / "f", config=SHORT)
    with pytest.raises(DataError, match="fps was 8 and is 9 now; go on with the same settings, name another folder"):
        make_film(model, tmp_path / "f", config=FilmConfig(seconds=0.5, fps=9, size=(64, 48)))
    other = tmp_path / "other.ply"
    write_ply(other, tiny_data.truth(seed=1))
    with pytest.raises(DataError, match="the file of the model has changed"):
        make_film(other, tmp_path / "f", config=SHORT)


def test_frames_along_other_key_frames_in_the_same_file_are_another_film(model, keys, tmp_path):
    config = FilmConfig(path=str(keys), seconds=0.5, fps=8, size=(16, 12))
    make_film(model, tmp_path / "f", config=config)
    listed = json.loads(keys.read_text())
    keys.write_text(json.dumps(listed, indent=4))  # the same
    make_film(model, tmp_path / "f", config=config)
    keys.write_text(json.dumps([listed[1], listed[0], *listed[2:]]))
    with pytest.raises(DataError, match="the file of the cameras has changed"):
        make_film(model, tmp_path / "f", config=config)


def test_the_file_of_key_frames_may_be_named_from_another_folder(model, keys, tmp_path, monkeypatch):
    config = FilmConfig(path=str(keys), seconds=0.5, fps=8, size=(16, 12))
    make_film(model, tmp_path / "f", config=config)
    monkeypatch.chdir(keys.parent)
    make_film(model, tmp_path / "f", config=replace(config, path=f"./{keys.name}"))


def test_frames_along_the_cameras_of_other_data_are_another_film(model, data, tmp_path, monkeypatch):
    config = replace(SHORT, path="cameras", size=(16, 12))
    make_film(model, tmp_path / "f", data, config)
    some = tiny_data.cameras(16)[:8]
    monkeypatch.setattr(tiny_data, "cameras", lambda n: some)
    other = tiny_data.write_tiny_data(tmp_path / "other", n=8)
    with pytest.raises(DataError, match="the file of the cameras has changed"):
        make_film(model, tmp_path / "f", other, config)


def test_frames_of_a_version_that_did_not_note_their_cameras_are_refused_in_one_line(model, tmp_path):
    make_film(model, tmp_path / "f", config=SHORT)
    file = tmp_path / "f" / "film.json"
    noted = json.loads(file.read_text())
    del noted["cameras_sha256"]
    file.write_text(json.dumps(noted))
    with pytest.raises(DataError, match="an earlier version, which did not note cameras_sha256; .* name another"):
        make_film(model, tmp_path / "f", config=SHORT)
    file.write_text("[]")
    with pytest.raises(DataError, match="film.json: is not a JSON object; remove the folder, or name another"):
        make_film(model, tmp_path / "f", config=SHORT)


def test_two_films_never_share_a_folder(model, tmp_path):
    part = tmp_path / "f" / ".0001.png.0123.part"

    def start_another(done: int, n: int, what: str) -> None:
        part.touch()  # what the first one is just writing
        with pytest.raises(DataError, match="f: another process is writing frames to it; wait for it"):
            make_film(model, tmp_path / "f", config=SHORT)
        assert part.is_file()

    make_film(model, tmp_path / "f", config=SHORT, progress=start_another)
    make_film(model, tmp_path / "f", config=SHORT)
    assert sorted(p.name for p in (tmp_path / "f").iterdir()) == [*(f"000{i}.png" for i in range(4)), "film.json"]


# --- the command line ---


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["-o", "{}/film.avi"], ["film.avi: is not a video or pictures", "name a video .mp4"]),
        (["-o", "{}/f.png"], ["f.png: is not a video or pictures", "%04d.png"]),
        (["-o", "{}/%d_%d.png"], ["is not a video or pictures"]),
        (["-o", "{}/f.mp4", "--size", "31", "20"], ["31 x 20 has an odd side", "--size 32 20"]),
        (["-o", "{}/f.mp4", "--path", "spiral"], ['--path: "spiral" is unknown', "orbit, cameras"]),
        (["-o", "{}/f.mp4", "--path", "cameras"], ["--path: no data set", "--data DATA"]),
        (["-o", "{}/f.mp4", "--path", "{}/none.json"], ["none.json: cannot be read"]),
        (["-o", "{}/f.mp4", "--fps", "0"], ["--fps: 0 is out of range"]),
        (["-o", "{}/f.mp4", "--seconds", "nan"], ["--seconds: nan is out of range"]),
        (["-o", "{}/f.mp4", "--seconds", "80000", "--fps", "200"], ["--seconds: 80000 s are 16,000,000 frames"]),
        (["-o", "{}/f.mp4", "--size", "0", "20"], ["--size: 0 x 20 is out of range"]),
        (["-o", "{}/f.mp4", "--path", "orbit", "--smoothing", "1"], ["--smoothing: is not for --path orbit"]),
        (["-o", "{}/f.mp4", "--path", "k.json", "--zoom", "3"], ["--zoom: is not for --path k.json"]),
        (["-o", "{}/f.mp4", "--crf", "60"], ["--crf: 60 is out of range"]),
        (["-o", "{}/f", "--crf", "20"], ["--crf: is for videos, and", "f is for pictures"]),
        (["-o", "{}/f.mp4", "--smoothing", "1"], ["--smoothing: is not for --path orbit"]),
        (["-o", "{}/f.mp4", "--samples", "4"], ["--samples: is for motion blur, and there is none"]),
        (["-o", "{}/f.mp4", "--white", "3"], ["--white: is for linear radiance", "has sRGB colours", "add --linear"]),
        (["-o", "{}/f.mp4", "--shutter", "1.5"], ["--shutter: 1.5 is out of range"]),
        (["-o", "{}/f.mp4", "--data", "{}/none"], ["none: no such file or folder"]),
        (["-o", "{}/file/f.mp4"], ["cannot be written"]),
        (["-o", "{}/full"], ["full: is a folder with other contents"]),
        (["-o", "{}/folder.mp4"], ["folder.mp4: is a folder"]),
    ],
    ids=itertools.count(),
)
def test_bad_input_is_one_line(model, tmp_path, capsys, flags, words):
    (tmp_path / "file").write_text("")
    for name in ("full/x", "folder.mp4"):
        (tmp_path / name).mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    assert_one_line(run(capsys, "film", model, *(flag.replace("{}", str(tmp_path)) for flag in flags)), *words)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("flag", ["--zoom", "--elevation"])
def test_what_is_for_an_orbit_is_refused_where_the_cameras_ask_for_another_path(model, data, tmp_path, capsys, flag):
    content = json.loads((data / "transforms.json").read_text())
    content["frames"] = [frame | {"file_path": str(data / frame["file_path"])} for frame in content["frames"][:3]]
    (tmp_path / "transforms.json").write_text(json.dumps(content | {"ply_file_path": str(data / "points.ply")}))
    line = run(capsys, "film", model, "-o", tmp_path / "f.mp4", "--data", tmp_path, flag, "3")
    assert_one_line(line, f"{flag}: is not for --path cameras")


def test_a_run_without_a_model_is_named(tmp_path, capsys):
    assert_one_line(run(capsys, "film", tmp_path, "-o", tmp_path / "f.mp4"), "point_cloud.ply: no such file")
    assert_one_line(run(capsys, "film", tmp_path / "no.ply", "-o", tmp_path / "f.mp4"), "no.ply")


def test_a_lens_keeps_its_view_of_the_shorter_side_whatever_the_size(model, tmp_path):
    """A portrait and a landscape of the same path show the model equally large."""
    seen = {}
    for size in ((64, 32), (32, 64)):
        make_film(model, tmp_path / f"{size[0]}", config=FilmConfig(seconds=0.1, fps=10, size=size))
        seen[size] = read_png(tmp_path / f"{size[0]}" / "0000.png") / 255
    wide, tall = seen[64, 32][:, 16:48], seen[32, 64][16:48]
    assert wide.max() > 0.2
    np.testing.assert_allclose(wide, tall, atol=1.5 / 255)
