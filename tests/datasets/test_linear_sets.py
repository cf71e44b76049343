"""Data sets of OpenEXR images: linear, exposed by themselves, and captured with ``--hdr``."""

import json
import shutil
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from hdr_data import write_hdr_data
from mi_dogsplat.cli import main
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.auto_exposure import reference_white
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.exr import read_exr
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.film.model_frames import exposed
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.render.picture import light_of, photograph, picture_of
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.runs.evaluation import evaluate_model
from mi_dogsplat.scene.drawing import drawn_as
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.pictures import write_png, write_radiance
from mi_dogsplat.support.srgb import displayed, srgb_to_linear
from tiny_data import cameras

LAMP = 5.0
SCENE = f"""<scene version="3.0.0"><integrator type="path"><boolean name="hide_emitters" value="false"/></integrator>
<emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>
<shape type="sphere"><float name="radius" value="0.7"/>
<emitter type="area"><rgb name="radiance" value="{LAMP}"/></emitter></shape></scene>"""


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return write_hdr_data(tmp_path_factory.mktemp("hdr") / "data", alpha=True)


@pytest.fixture(scope="module")
def lamp(tmp_path_factory) -> Path:
    """A captured lamp, and a model trained on it, by the commands."""
    folder = tmp_path_factory.mktemp("lamp")
    (folder / "scene.xml").write_text(SCENE)
    capture = ["capture", str(folder / "scene.xml"), "-o", str(folder / "data"), "--hdr", "--views", "6", "--test", "1"]
    assert main([*capture, "--size", "32", "32", "--spp", "16", "--points", "400"]) == 0
    settings = ["--steps", "120", "--preset", "3dgs", "--max-primitives", "500", "--sh-degree", "0"]
    assert main(["train", str(folder / "data"), "-o", str(folder / "run"), *settings]) == 0
    return folder


def test_a_lamp_does_not_ring_over_what_is_around_it_when_a_lens_is_taken_out(tmp_path):
    image = np.full((48, 64, 3), 0.125, np.float32)  # a half float has it exactly
    image[23:26, 31:34] = 5000
    frames = [{"file_path": f"{i}.exr", "transform_matrix": np.eye(4).tolist()} for i in range(2)]
    for frame in frames:
        write_radiance(tmp_path / frame["file_path"], image)
    (tmp_path / "transforms.json").write_text(json.dumps({"fl_x": 60, "k1": -0.05, "frames": frames}))
    view = load_dataset(tmp_path).train[0]
    assert view.straight and view.image.max() == 5000
    rows, columns = np.indices(view.image.shape[:2])
    away = np.maximum(abs(columns + 0.5 - view.camera.cx), abs(rows + 0.5 - view.camera.cy)) > 4
    assert (view.image[away] == 0.125).all()


def write_views(folder: Path, image: np.ndarray, full: float | None, **lens: float) -> Path:
    """A data set of two views that show the same image."""
    frames = [{"file_path": f"{i}.exr", "transform_matrix": np.eye(4).tolist()} for i in range(2)]
    folder.mkdir(exist_ok=True)
    for frame in frames:
        write_radiance(folder / frame["file_path"], image, full)
    (folder / "transforms.json").write_text(json.dumps({"fl_x": 60, "frames": frames} | lens))
    return folder


@pytest.mark.parametrize("on_disk", [False, True])
def test_a_pixel_is_saturated_where_a_channel_of_what_it_is_made_of_reaches_the_value_of_a_full_sensor(
    tmp_path, on_disk
):
    image = np.full((48, 64, 3), 0.125, np.float32)
    image[20, 30] = 0.125, 2, 0.125
    image[40, 10] = 1.875
    write_views(tmp_path / "a", image, 2.0)
    expected = np.zeros((48, 64), bool)
    expected[20, 30] = True
    view = load_dataset(tmp_path / "a", on_disk=on_disk).train[0]
    np.testing.assert_array_equal(view.recording.saturated, expected)
    np.testing.assert_array_equal(view.image, image)  # its values stay
    for factor in (2, 4):
        small = load_dataset(tmp_path / "a", factor, on_disk=on_disk).train[0].recording
        blocks = expected.reshape(48 // factor, factor, 64 // factor, factor).any(axis=(1, 3))
        np.testing.assert_array_equal(small.saturated, blocks)
    write_views(tmp_path / "b", image, None)
    write_views(tmp_path / "c", image, 2.1)
    for folder in ("b", "c"):
        assert load_dataset(tmp_path / folder, on_disk=on_disk).train[0].recording.saturated is None


def test_saturated_pixels_move_with_those_of_the_photograph_when_a_lens_is_taken_out(tmp_path):
    image = np.full((48, 64, 3), 0.125, np.float32)
    image[4:9, 4:9] = 2
    view = load_dataset(write_views(tmp_path / "a", image, 2.0, k1=-0.1)).train[0]
    full = view.recording.saturated
    assert view.straight and full is not None
    shown = view.image.max(axis=2) > 0.2
    assert full[shown].all() and full.sum() < 3 * shown.sum() and shown.sum() > 9


def test_images_are_linear_premultiplied_and_exposed(data):
    dataset = load_dataset(data)
    view = dataset.train[0]
    np.testing.assert_array_equal(view.image, read_exr(data / "images" / f"{view.name}.exr"))
    assert dataset.has_alpha and dataset.white == view.white == reference_white(dataset.train)
    assert dataset.white is not None
    expected = displayed(view.image[..., :3] + (1 - view.image[..., 3:]) * dataset.white, dataset.white)
    np.testing.assert_allclose(photograph(view, 1.0), expected, atol=1e-6)
    on_disk = load_dataset(data, on_disk=True)
    assert on_disk.white == dataset.white
    np.testing.assert_array_equal(on_disk.train[0].image, view.image)
    np.testing.assert_allclose(
        load_dataset(data, downscale=2).train[0].image[0, 0], view.image[:2, :2].mean((0, 1)), rtol=1e-5
    )


def test_images_may_be_named_without_their_ending_and_those_of_colmap_may_be_linear(data, tmp_path):
    shutil.copytree(data, tmp_path / "data")
    content = json.loads((data / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["file_path"] = frame["file_path"].removesuffix(".exr")
    (tmp_path / "data" / "transforms.json").write_text(json.dumps(content))
    assert load_dataset(tmp_path / "data").white == load_dataset(data).white

    model = tmp_path / "colmap" / "sparse" / "0"
    model.mkdir(parents=True)
    shutil.copytree(data / "images", tmp_path / "colmap" / "images")
    camera = cameras(8)[0]
    size = f"{camera.width} {camera.height} {camera.fx} {camera.fy} {camera.cx} {camera.cy}"
    (model / "cameras.txt").write_text(f"1 PINHOLE {size}\n")
    rows = [f"{i + 1} 1 0 0 0 0 0 {i} 1 {i}.exr\n\n" for i in range(8)]
    (model / "images.txt").write_text("".join(rows))
    (model / "points3D.txt").write_text("")
    assert load_dataset(tmp_path / "colmap").white is not None


def test_linear_and_display_referred_images_are_no_data_set_together(data, tmp_path):
    shutil.copytree(data, tmp_path / "data")
    content = json.loads((data / "transforms.json").read_text())
    content["frames"][0]["file_path"] = "images/0.png"
    write_png(tmp_path / "data" / "images" / "0.png", np.zeros((36, 48, 3)))
    (tmp_path / "data" / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=r"0\.png: is display-referred, and other images are linear"):
        load_dataset(tmp_path / "data")


def test_lamps_black_and_what_is_transparent_do_not_change_the_exposure():
    rng = np.random.default_rng(0)
    camera = cameras(1)[0]
    image = rng.uniform(0.1, 0.3, (camera.height, camera.width, 3)).astype(np.float32)
    white = reference_white([View("a", camera, image, white=1.0)])
    assert 2 * 0.25 < white < 2 * 0.3
    lamps = image.copy()
    lamps[:1] = 1e4
    black = np.concatenate([image, np.zeros_like(image)], axis=1)
    assert reference_white([View("a", camera, lamps, white=1.0)]) < 1.3 * white
    assert reference_white([View("a", camera, black, white=1.0)]) == white
    faint = np.concatenate([image, np.full_like(image[..., :1], 0.2)], -1)
    solid = np.concatenate([image, np.ones_like(image[..., :1])], -1)
    both = np.concatenate([faint * 0.2, solid], axis=1)
    assert reference_white([View("a", camera, both, white=1.0)]) == white
    assert reference_white([View("a", camera, np.zeros_like(image), white=1.0)]) == 1.0
    assert reference_white([View("a", camera, 64 * image, white=1.0)]) == 64 * white


def test_a_capture_holds_radiance_in_halves_and_goes_on_where_it_stopped(lamp):
    files = sorted((lamp / "data" / "images").iterdir())
    assert len(files) == 7 and {file.suffix for file in files} == {".exr"}
    picture = read_exr(files[0])
    assert picture.shape == (32, 32, 3) and picture[16, 16] == pytest.approx(LAMP, rel=1e-3)
    assert picture[0, 0] == pytest.approx(0.2, rel=1e-3)
    assert json.loads((lamp / "data" / "capture.json").read_text())["hdr"] is True
    before = files[1].read_bytes()
    files[1].write_bytes(before[:200])  # a file that was cut off is rendered again
    capture = ["capture", str(lamp / "scene.xml"), "-o", str(lamp / "data"), "--hdr", "--views", "6", "--test", "1"]
    assert main([*capture, "--size", "32", "32", "--spp", "16", "--points", "400"]) == 0
    assert files[1].read_bytes() == before


def test_what_was_captured_as_5_is_rendered_as_5_without_a_flag(lamp, tmp_path):
    model = lamp / "run" / "point_cloud.ply"
    drawing = read_model(model).drawing
    assert drawing.linear and drawing.white is not None
    exr = tmp_path / "a.exr"
    assert main(["render", str(model), "--data", str(lamp / "data"), "-o", str(exr)]) == 0
    found = read_exr(exr)
    assert found.shape == (32, 32, 4)
    assert found[13:19, 13:19, :3].mean() == pytest.approx(LAMP, rel=0.1)
    views = load_dataset(lamp / "data")
    camera = views.test[0].camera
    sensor = camera_to_mitsuba(camera, 0.01, 100.0)
    sensor["film"]["pixel_format"] = "rgb"
    shape = {"type": "dog", "filename": str(model)}
    scene = mi.load_dict({"type": "scene", "a": {"type": "dogsplat"}, "s": shape, "sensor": sensor})
    image = np.array(mi.render(scene, spp=1))
    np.testing.assert_allclose(image[13:19, 13:19], found[13:19, 13:19, :3], rtol=0.05)
    png = tmp_path / "a.png"
    assert main(["render", str(model), "--data", str(lamp / "data"), "-o", str(png), "--white", "20"]) == 0
    np.testing.assert_allclose(read_image(png), displayed(found[..., :3], 20.0), atol=0.01)


def test_films_hold_radiance_and_motion_blur_is_the_mean_of_it(lamp):
    read = read_model(lamp / "run" / "point_cloud.ply")
    drawn = drawn_as(read.drawing)
    picture = picture_of(read.splats, 0.0, drawn)
    two = [view.camera for view in load_dataset(lamp / "data").train[:2]]
    light = np.mean([light_of(picture(camera)) for camera in two], axis=0)
    assert light.max() > 0.8 * LAMP
    np.testing.assert_allclose(exposed(picture, two, 0.0, False), displayed(light, drawn.white), atol=1e-5)
    rgba = exposed(picture, two, 0.0, True)
    np.testing.assert_allclose(srgb_to_linear(rgba[..., :3]), light, rtol=1e-4, atol=1e-5)


def test_the_report_says_which_radiance_is_white(lamp):
    page = (lamp / "run" / "report.html").read_text(encoding="utf-8")
    assert "The images are linear radiance" in page and "HDR-FLIP" in page


def test_eval_measures_in_the_exposure_of_the_images_unless_it_is_told_another(lamp, capsys):
    model, data = str(lamp / "run" / "point_cloud.ply"), str(lamp / "data")
    assert main(["eval", model, data]) == 0
    assert "PSNR-μ" in capsys.readouterr().out
    own = json.loads((lamp / "run" / "metrics.json").read_text())["test"]
    (found,) = evaluate_model(model, data).values()
    assert found["psnr"] == pytest.approx(own["psnr"], abs=0.01)
    assert found["psnr_mu"] == pytest.approx(own["psnr_mu"], abs=0.01)
    (other,) = evaluate_model(model, data, options=PictureOptions(white=100.0)).values()
    assert other["psnr_mu"] == found["psnr_mu"]  # of radiance, whatever a screen shows
    assert other["psnr"] > found["psnr"] + 5  # so dark that errors do not show


def test_another_white_shows_the_same_radiance_otherwise(data):
    dataset = load_dataset(data)
    white = dataset.white or 0.0
    dim = dataset.exposed(4 * white)
    assert dim.white == 4 * white and len(dim.test) == len(dataset.test)
    np.testing.assert_array_equal(dim.train[0].image, dataset.train[0].image)
    assert photograph(dim.train[0], 0.0).mean() < photograph(dataset.train[0], 0.0).mean()


def test_radiance_is_written_premultiplied(tmp_path):
    rgba = np.random.default_rng(0).uniform(0, 9, (4, 5, 4)).astype(np.float32)
    rgba[..., 3] /= 9
    write_radiance(tmp_path / "a.exr", rgba)
    np.testing.assert_allclose(read_exr(tmp_path / "a.exr"), rgba, rtol=1e-3)
