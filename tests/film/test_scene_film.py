"""``dogsplat film`` of a Mitsuba scene: where its camera goes, what the files hold, and what is said of bad input."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat.film.film_config import FilmConfig
from mi_dogsplat.film.make import make_scene_film
from mi_dogsplat.render.render_files import render_scene
from mi_dogsplat.render.scene_to_draw import SceneOptions, SceneToDraw
from mi_dogsplat.runs.stopping import Stopped
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import linear_to_srgb
from rendered_files import read_exr, read_png

FILM = """<film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="18"/>{film}
<rfilter type="box"/></film>"""
SENSOR = """<sensor type="{kind}">{fov}<transform name="to_world">{pose}</transform>{lens}
{film}</sensor>"""
FOV = '<float name="fov" value="40"/>'
POSE = '<lookat origin="1, -4, 1.5" target="0.3, 0, 0" up="0, 0, 1"/>'
SPLATS = '<shape type="dog"><string name="filename" value="{model}"/></shape>'
CUBE = """<shape type="cube"><transform name="to_world"><scale value=".4"/><translate x="$across"/></transform></shape>
<emitter type="constant"/>"""
LAMP = """<shape type="sphere"><float name="radius" value=".2"/><point name="center" x="1" y="-1" z="2"/>
<emitter type="area"><rgb name="radiance" value="20, 18, 15"/></emitter></shape>"""
FEW = FilmConfig(seconds=0.25, fps=8)


def sensor(kind: str = "perspective", pose: str = POSE, lens: str = "", film: str = "", fov: str = FOV) -> str:
    return SENSOR.format(kind=kind, pose=pose, lens=lens, film=FILM.format(film=film), fov=fov)


@pytest.fixture
def scene(model, tmp_path):
    """Writes a scene of the tiny model, or of ``shapes``."""

    def write(*sensors: str, integrator: str = '<integrator type="dogsplat"/>', shapes: str = SPLATS) -> Path:
        path = tmp_path / "scene.xml"
        parts = integrator + shapes.format(model=model) + "".join(sensors or [sensor()])
        path.write_text(f'<scene version="3.0.0"><default name="across" value="0"/>{parts}</scene>')
        return path

    return write


def keys(folder: Path, cameras) -> str:
    """The file of a path through these cameras, a second from one to the next."""
    listed = []
    for camera in cameras:
        write_camera(folder / "camera.json", camera)
        listed.append(json.loads((folder / "camera.json").read_text()))
    (folder / "camera.json").unlink()
    (folder / "keys.json").write_text(json.dumps({"keys": [key | {"time": i} for i, key in enumerate(listed)]}))
    return str(folder / "keys.json")


def rendered(path: Path, options: SceneOptions) -> np.ndarray:
    """What ``dogsplat render`` shows, [H, W, 3 or 4], linear."""
    out = path.with_name("rendered.exr")
    render_scene(path, out, options.spp, sensor=options.sensor, defined=options.defined)
    return next(iter(read_exr(out).values()))


def colors(file: Path) -> np.ndarray:
    return next(iter(read_exr(file).values()))


# --- where the camera goes ---


def test_frames_are_what_the_cameras_of_the_keys_see(scene, tmp_path):
    """With their principal points, and in the size that they have; the model alone is drawn as ``render`` draws it."""
    cameras = [replace(camera, cx=20.0, cy=21.0) for camera in tiny_data.cameras()[:3]]
    config = FilmConfig(path=keys(tmp_path, cameras), fps=1)
    film = make_scene_film(scene(), tmp_path / "film", config=config)
    assert (film.n_frames, film.size, film.path) == (3, (48, 36), "through 3 key frames of keys.json")
    for i, camera in enumerate(cameras):
        expected = tiny_data.picture(tiny_data.truth(), camera).color
        assert abs(read_png(tmp_path / "film" / f"000{i}.png") / 255 - expected).max() <= 0.51 / 255 + 1e-4


@pytest.mark.parametrize(
    ("kind", "lens"),
    [
        ("perspective", ""),
        ("perspective", '<float name="principal_point_offset_x" value="0"/><string name="fov_axis" value="y"/>'),
        ("thinlens", '<float name="aperture_radius" value=".3"/><float name="focus_distance" value="3"/>'),
    ],
)
def test_an_orbit_begins_with_the_picture_of_the_sensor_and_keeps_its_lens_and_distance(scene, tmp_path, kind, lens):
    path = scene(sensor(kind, lens=lens, film='<string name="pixel_format" value="rgba"/>'))
    film = make_scene_film(path, tmp_path / "f" / "%d.exr", config=FEW, options=SceneOptions(spp=4))
    assert (film.n_frames, film.size) == (2, (24, 18)) and film.path.startswith("an orbit, 20 degrees above")
    first, second = (colors(tmp_path / "f" / f"{k}.exr") for k in (0, 1))
    assert first.shape == (18, 24, 4)
    np.testing.assert_allclose(first, rendered(path, SceneOptions(spp=4)), atol=2e-3)  # half floats
    assert abs(second - first).max() > 0.1


def test_an_orbit_is_about_the_middle_of_the_scene_that_the_sensor_looks_at(scene, tmp_path):
    """A cube that is off the origin is in the middle from each side, at the same distance."""
    path = scene(sensor(pose='<lookat origin="2, -4, 0" target="2, 0, 0" up="0, 0, 1"/>'),
                 integrator='<integrator type="depth"/>', shapes=CUBE)  # fmt: skip
    config = replace(FEW, seconds=0.5)
    make_scene_film(path, tmp_path / "f" / "%d.exr", config=config, options=SceneOptions(defined={"across": "2"}))
    sides = [colors(tmp_path / "f" / f"{k}.exr")[..., 0] for k in range(4)]
    np.testing.assert_allclose([side[8:10, 11:13] for side in sides], 4 - 0.4, atol=0.02)
    covered = [np.argwhere(side > 0) for side in sides]  # one random place in each pixel
    assert min(map(len, covered)) > 20
    np.testing.assert_allclose([places.mean(0) for places in covered], np.broadcast_to([8.5, 11.5], (4, 2)), atol=0.6)


def test_sensors_are_followed_in_the_order_of_the_file(scene, tmp_path):
    poses = [f'<lookat origin="{x}, -4, 1" target="{x / 2}, 0, 0" up="0, 0, 1"/>' for x in (-1, 0, 1.5)]
    path = scene(*(sensor(pose=pose) for pose in poses))
    config = FilmConfig(path="cameras", smoothing=0, seconds=2, fps=1)
    film = make_scene_film(path, tmp_path / "f" / "%d.exr", config=config)
    assert film.path == "along 3 cameras" and film.n_frames == 2
    for frame, number in ((0, 0), (1, 2)):
        expected = rendered(path, SceneOptions(sensor=number))
        np.testing.assert_allclose(colors(tmp_path / "f" / f"{frame}.exr"), expected, atol=2e-3)


def test_the_cameras_of_data_are_followed_where_they_are_given(scene, data, tmp_path):
    config = FilmConfig(path="cameras", smoothing=0, seconds=1, fps=2)
    film = make_scene_film(scene(), tmp_path / "f", data, config)
    assert (film.path, film.size) == ("along 8 cameras", (48, 36))
    expected = tiny_data.picture(tiny_data.truth(), tiny_data.cameras()[0]).color
    assert abs(read_png(tmp_path / "f" / "0000.png") / 255 - expected).max() <= 0.51 / 255 + 1e-4
    assert make_scene_film(scene(), tmp_path / "g", data, FEW).path.startswith("an orbit")


def test_a_mirrored_sensor_goes_without_its_mirror(scene, tmp_path):
    path = scene(sensor(pose=f'<scale x="-1"/>{POSE}'))
    make_scene_film(path, tmp_path / "f" / "%d.exr", config=FEW)
    np.testing.assert_allclose(colors(tmp_path / "f" / "0.exr"), rendered(path, SceneOptions())[:, ::-1], atol=2e-3)


# --- what the files hold ---


def test_openexr_has_the_channels_of_the_film(scene, tmp_path):
    path = scene(integrator='<integrator type="dogsplat"><string name="aovs" value="depth"/></integrator>')
    make_scene_film(path, tmp_path / "f" / "%d.exr", config=replace(FEW, seconds=0.1))
    assert {"RGB", "depth.Z"} <= set(read_exr(tmp_path / "f" / "0.exr"))


def test_the_moments_of_light_are_means_as_light_is(scene, tmp_path):
    """An integrator ``moment`` has X, Y and Z of light, which are named as those of a normal."""
    path = scene(integrator='<integrator type="moment"><integrator type="path" name="p"/></integrator>', shapes=CUBE)
    config = replace(FEW, seconds=0.1, shutter=1.0, samples=2)
    make_scene_film(path, tmp_path / "f" / "%d.exr", config=config)
    seen = read_exr(tmp_path / "f" / "0.exr")
    np.testing.assert_allclose(seen["p.Y"], seen["RGB"] @ np.array([0.2126, 0.7152, 0.0722]), atol=1e-3)


def test_an_integrator_aov_keeps_the_colours_that_it_has_from_another(scene, tmp_path):
    """Which what ``mi.render`` returns lacks."""
    inner = '<string name="aovs" value="dd:depth"/><integrator type="path" name="inside"/>'
    path = scene(integrator=f'<integrator type="aov">{inner}</integrator>', shapes=CUBE)
    make_scene_film(path, tmp_path / "f" / "%d.exr", config=replace(FEW, seconds=0.1, shutter=0.5, samples=2))
    seen = read_exr(tmp_path / "f" / "0.exr")
    np.testing.assert_allclose(seen["inside"][..., :3], seen["RGB"], atol=1e-6)
    assert seen["dd.T"].max() > 3


def test_motion_blur_is_the_mean_of_linear_light_and_coverage(scene, tmp_path):
    """Of the pictures at its moments, which a film with as many more frames in a second has. Depths and numbers of
    primitives have no mean: they are those of one moment."""
    aovs = '<string name="aovs" value="alpha, depth, index"/>'
    path = scene(integrator=f'<integrator type="dogsplat">{aovs}</integrator>')
    blurred = FilmConfig(seconds=1, fps=3, shutter=1.0, samples=2)
    make_scene_film(path, tmp_path / "blur" / "%d.exr", config=blurred)
    make_scene_film(path, tmp_path / "fine" / "%d.exr", config=FilmConfig(seconds=1, fps=12))
    make_scene_film(path, tmp_path / "shown", config=blurred)
    for number in range(3):  # moments at -1/4 and 1/4 of a frame: frames 4 n - 1 and 4 n + 1 of the fine film
        parts = [colors(tmp_path / "fine" / f"{(4 * number + k) % 12}.exr") for k in (-1, 1)]
        mean = np.mean(parts, axis=0)
        np.testing.assert_allclose(colors(tmp_path / "blur" / f"{number}.exr"), mean, atol=2e-3)
        blur, first, last = (
            read_exr(tmp_path / folder / f"{k}.exr")
            for folder, k in (("blur", number), ("fine", (4 * number - 1) % 12), ("fine", 4 * number + 1))
        )
        np.testing.assert_allclose(blur["alpha"], (first["alpha"] + last["alpha"]) / 2, atol=2e-3)
        for name in ("depth.Z", "index.I"):
            np.testing.assert_array_equal(blur[name], last[name])
        picture = read_png(tmp_path / "shown" / f"{number:04d}.png") / 255
        assert abs(picture - linear_to_srgb(mean)).max() <= 0.51 / 255 + 4e-3


@pytest.mark.slow
@pytest.mark.parametrize("denoise", [False, True])
def test_only_frames_that_are_denoised_have_the_same_random_numbers(scene, tmp_path, denoise):
    """A camera that stands still shows it."""
    path = scene(integrator='<integrator type="dogpath"/>', shapes=SPLATS + LAMP)
    camera = replace(tiny_data.cameras()[0], width=24, height=18, fx=26.0, fy=26.0, cx=12.0, cy=9.0)
    config = FilmConfig(path=keys(tmp_path, [camera, camera]), fps=1)
    make_scene_film(path, tmp_path / "f" / "%d.exr", config=config, options=SceneOptions(spp=2, denoise=denoise))
    first, second = (read_exr(tmp_path / "f" / f"{k}.exr") for k in (0, 1))
    assert set(first) == {"RGB"}
    assert np.array_equal(first["RGB"], second["RGB"]) is denoise


def test_a_video_has_as_many_frames_and_an_even_size(scene, tmp_path, capsys):
    path = scene(sensor().replace('"width" value="24"', '"width" value="25"'))
    status, out, _ = run(capsys, "film", path, "-o", tmp_path / "f.mp4", "--seconds", 0.25, "--fps", 8, "--spp", 1)
    assert status == 0 and "2 frames of 24 x 18, 0.25 s; an orbit" in out
    assert (tmp_path / "f.mp4").stat().st_size > 0


# --- stopping ---


def stop_after_a_pass(monkeypatch) -> list[int]:
    """Ctrl-C when a frame has one sample; gives how many samples it got until it was left."""
    seen, whole = [], SceneToDraw.rendered

    def interrupted(self, on_pass=None, seed=0):
        def told(done: int, n: int) -> None:
            if not seen:
                os.kill(os.getpid(), signal.SIGINT)
            seen.append(done)
            assert on_pass is not None
            on_pass(done, n)

        return whole(self, told, seed)

    monkeypatch.setattr(SceneToDraw, "rendered", interrupted)
    return seen


@pytest.mark.parametrize(("name", "says"), [("f.mp4", "there is no "), ("f", "the same command again goes on")])
def test_a_film_can_be_stopped_within_a_frame(scene, tmp_path, monkeypatch, name, says):
    samples = stop_after_a_pass(monkeypatch)
    before = {entry.name for entry in tmp_path.iterdir()} | {"scene.xml"}
    with pytest.raises(Stopped, match=f"stopped after 0 of 2 frames; {says}"):
        make_scene_film(scene(), tmp_path / name, config=FEW, options=SceneOptions(spp=8))
    assert samples == [1]
    left = {str(entry.relative_to(tmp_path)) for entry in tmp_path.rglob("*")}
    assert left <= before  # pictures go on after those that are whole, and there are none


def test_pictures_go_on_only_for_the_same_scene_and_options(scene, tmp_path, capsys):
    path, out = scene(integrator='<integrator type="depth"/>', shapes=CUBE), tmp_path / "f"
    command = ["film", path, "-o", out, "--seconds", 0.25, "--fps", 8]
    assert run(capsys, *command)[0] == 0
    (out / "0001.png").unlink()
    kept = (out / "0000.png").stat().st_mtime_ns
    assert run(capsys, *command)[0] == 0
    assert (out / "0001.png").is_file() and (out / "0000.png").stat().st_mtime_ns == kept
    assert_one_line(run(capsys, *command, "--spp", 2), f"{out}: spp was 0 and is 2 now")
    assert_one_line(run(capsys, *command, "-D", "across=1"), f"{out}: defined was {{}} and is {{'across': '1'}} now")
    path.write_text(path.read_text().replace(".4", ".3"))
    assert_one_line(run(capsys, *command), f"{out}: the file of the scene has changed since it was begun")


def test_what_the_callers_function_raises_is_not_blamed_on_the_scene(scene, tmp_path):
    def progress(done: int, n: int, what: str) -> None:
        raise ValueError("the caller's own")

    with pytest.raises(ValueError, match="^the caller's own$"):
        make_scene_film(scene(), tmp_path / "f", config=FEW, progress=progress)


# --- bad input ---


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["-s", "1"], ["--sensor: ", "scene.xml has 1 sensor; give 0 to 0"]),
        (["--path", "cameras"], ["--path: ", "scene.xml has one sensor", "add --data DATA, or use --path orbit"]),
        (["--denoise"], ["--denoise: is for the integrator dogpath"]),
        (["--white", "2"], ["--white: is only for models; a scene says itself how it is drawn; leave it out"]),
        (["--background", "white"], ["--background: is only for models"]),
        (["-D", "fog=1"], ['scene.xml has no parameter "$fog"']),
        (["--spp", "-1"], ["--spp: -1 samples per pixel are not possible; give 1 to 16777216, or 0 for the scene's"]),
        (["--spp", "99999999999"], ["--spp: 99999999999 samples per pixel are not possible; give 1 to 16777216"]),
        (["--spp", "300000"], ["--spp: 300000 samples per pixel are not possible; give 1 to 262144"]),  # of splats
        (["--smoothing", "1"], ["--smoothing: is not for --path orbit"]),
    ],
)
def test_flags_of_no_use_are_one_line(scene, tmp_path, capsys, flags, words):
    path = scene()
    assert_one_line(run(capsys, "film", path, "-o", tmp_path / "f", *flags), *words)
    assert not (tmp_path / "f").exists()


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        ([sensor("orthographic", fov="")], ["is not a camera that a film can follow (OrthographicCamera)"]),
        ([], ["it has no sensor"]),
    ],
)
def test_a_scene_without_a_camera_is_one_line(scene, tmp_path, capsys, sensors, words):
    path = scene()
    path.write_text(path.read_text().replace(sensor(), "".join(sensors)))
    assert_one_line(run(capsys, "film", path, "-o", tmp_path / "f"), str(path), *words)
    assert not (tmp_path / "f").exists()


def test_a_lens_cannot_be_shifted(scene, tmp_path):
    path = scene(sensor("thinlens", lens='<float name="aperture_radius" value=".1"/>'))
    shifted = [replace(camera, cx=20.0) for camera in tiny_data.cameras()[:2]]
    with pytest.raises(DataError, match="--path: its principal points are shifted, and no thinlens sensor has that"):
        make_scene_film(path, tmp_path / "f", config=FilmConfig(path=keys(tmp_path, shifted), fps=1))


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["--spp", "4"], "--spp: a model is drawn with one sample; leave it out, or render a scene .xml"),
        (["--denoise"], "--denoise: a model has no noise; leave it out"),
        (["-s", "1"], "--sensor: a model has no sensors; leave it out"),
        (["-D", "a=1"], "--define: is only for parameters of a scene; leave it out"),
    ],
)
def test_a_model_has_no_use_for_flags_of_scenes(model, tmp_path, capsys, flags, line):
    assert_one_line(run(capsys, "film", model, "-o", tmp_path / "f", *flags), line)


def test_a_scene_that_renders_to_nan_is_named(scene, tmp_path, capsys):
    unlit = CUBE.replace('"constant"/>', '"constant"><rgb name="radiance" value="nan"/></emitter>')
    path = scene(integrator='<integrator type="path"/>', shapes=unlit)
    result = run(capsys, "film", path, "-o", tmp_path / "f", "--seconds", 0.1)
    assert_one_line(result, f"{path}: its render holds NaN; correct the scene")
