"""From pictures and a video of a room to poses, against the exact ones; interrupted, changed, and before a training."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_one_line, run
from dataset_folders import N_VIEWS, colmap_folder, write_images
from icc_profiles import DISPLAY_P3, SRGB_CURVE, profile
from mi_dogsplat.datasets import check_cameras, load_dataset
from mi_dogsplat.datasets.colmap import read_sources
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.datasets.world import World, read_world
from mi_dogsplat.poses import run as module
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.output import undistort, write_model
from mi_dogsplat.poses.run import find_poses, is_done
from mi_dogsplat.poses.summary import Summary, camera_line
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.errors import DataError
from PIL import Image
from posed_room import SIZE, N, filmed, folder_of, found_cameras, photographed
from scipy.ndimage import map_coordinates
from shared_folder import contents

from benchmarks.poses.filmed_scene import arc, picture, textured_room
from benchmarks.poses.pose_error import alignment, pose_error

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")


def mixed_folder(folder: Path, room: Path) -> Path:
    """The pictures of the room as a phone may leave them: two turned on their sides with a tag, two shrunk in
    a folder of their own; a mask for one, and a file that is none of all this."""
    for path in sorted((room / "pictures").iterdir()):
        image, number = Image.open(path), int(path.stem[-1])
        exif = Image.Exif()
        if number in (2, 3):  # stored lying, to be turned clockwise
            image = image.transpose(Image.Transpose.ROTATE_90)
            exif[0x0112] = 6
        if number in (5, 6):
            image = image.resize((SIZE[0] * 3 // 4, SIZE[1] * 3 // 4), Image.Resampling.BOX)
        inner = "small" if number in (5, 6) else ""
        (folder / inner).mkdir(parents=True, exist_ok=True)
        image.save(folder / inner / f"{path.stem}.jpg", quality=95, subsampling=0, exif=exif)
    (folder / "masks").mkdir()
    mask = np.full((SIZE[1], SIZE[0]), 255, np.uint8)
    mask[:, : SIZE[0] // 3] = 0
    Image.fromarray(mask).save(folder / "masks" / "view 0.png")
    (folder / "notes.txt").write_text("Tuesday, cloudy")
    return folder


@pytest.fixture(scope="module")
def source(room, tmp_path_factory) -> Path:
    return mixed_folder(tmp_path_factory.mktemp("source") / "pictures", room)


@pytest.fixture(scope="module")
def posed(source, tmp_path_factory) -> tuple[Path, Summary, list]:
    """(folder, summary, what was told of the progress)"""
    out, told = tmp_path_factory.mktemp("posed") / "out", []
    return out, find_poses(source, out, PosesConfig(), lambda *row: told.append(row)), told


def exact() -> dict[str, Camera]:
    cameras = {name.replace(" ", "_"): camera for name, camera in photographed().items()}
    return {f"small_{name}" if name[-1] in "56" else name: camera for name, camera in cameras.items()}


# --- poses ---


@pytest.mark.slow
def test_mixed_sizes_and_orientations_all_get_their_pose(posed):
    out, summary, _ = posed
    cameras = found_cameras(out)
    error = pose_error(exact(), cameras)
    assert error.n == N and error.largest_position < 0.01 and error.angle < 0.2
    assert {camera.width for camera in cameras.values()} == {SIZE[0], SIZE[0] * 3 // 4}
    up = alignment(exact(), cameras).rotation @ [0, -1, 0]
    assert np.degrees(np.arccos(min(up[2], 1.0))) < 3
    assert abs(cameras["view_0"].fx / photographed()["view 0"].fx - 1) < 0.02
    assert summary.n_registered == summary.n_images == N and not summary.without_pose and not summary.advice
    assert len(summary.cameras) == 2


def test_our_reader_and_pycolmap_take_the_folder(posed):
    out, summary, _ = posed
    dataset = load_dataset(out)
    check = check_cameras(dataset)
    assert len(dataset.views) == N and check.n_points == summary.n_points > 500
    assert check.reprojection_px is not None and check.color_difference is not None
    assert check.in_front == 1 and check.reprojection_px < 1 and check.color_difference < 0.1
    assert pycolmap.Reconstruction(str(out / "sparse" / "0")).num_reg_images() == N


def test_nothing_is_matched_under_a_mask_which_comes_along_for_the_training(posed):
    out, summary, _ = posed
    dataset = load_dataset(out)
    assert summary.n_masks == 1
    seen = dataset.observations["view_0"].pixels[:, 0]
    assert len(seen) > 100 and seen.min() > SIZE[0] // 3 - 2
    view = next(view for view in dataset.views if view.name == "view_0")
    mask = Masks(out / "masks", dataset.views).of(view)
    assert mask is not None and abs(mask.mean() - 2 / 3) < 0.02


def test_each_stage_tells_how_far_it_is(posed):
    _, summary, told = posed
    stages = [stage for stage, _, _ in told]
    assert list(dict.fromkeys(stages)) == ["images", "features", "matching", "mapping"] == list(summary.seconds)
    last = {stage: (done, n) for stage, done, n in told}
    assert last == {"images": (N, N), "features": (N, N), "matching": (28, 28), "mapping": (N, N)}


def test_the_summary_says_it_in_words(posed):
    text = "\n".join(posed[1].lines())
    assert f"{N} of {N} images have a pose" in text and "reprojection error" in text and "SIMPLE_RADIAL 320x240" in text


def test_the_fields_of_view_of_a_picture_held_upright_are_those_of_its_sides():
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_RADIAL", 400, 300, 800)
    assert "300x800, focal length 400 px (41° wide, 90° high)" in camera_line(camera)


# --- interrupted ---


class Killed(Exception):
    pass


@pytest.mark.parametrize("stage", ["images", "features", "matching", "mapping"])
def test_what_was_stopped_is_no_data_set_and_goes_on_where_it_was(source, posed, tmp_path, stage):
    def stop(now: str, done: int, n: int) -> None:
        if now == stage and done:
            raise Killed

    out, told = tmp_path / "out", []
    if stage in ("matching", "mapping"):  # the features are those of another start
        shutil.copytree(posed[0], out)
        shutil.rmtree(out / "sparse")
        (out / "summary.json").unlink()
    with pytest.raises(Killed):
        find_poses(source, out, PosesConfig(), stop)
    assert not is_done(out) and not list(out.rglob("*.part"))
    with pytest.raises(DataError):
        load_dataset(out)
    if stage in ("matching", "mapping"):
        summary = find_poses(source, out, PosesConfig(), lambda *row: told.append(row))
        assert summary.n_registered == N and told[-1] == ("mapping", N, N)
        first = {name: next(done for now, done, _ in told if now == name) for name in ("features", "matching")}
        assert first == {"features": N, "matching": 28}


def test_a_second_start_does_nothing_again(source, posed):
    out, summary, _ = posed
    before, told = contents(out), []
    assert find_poses(source, out, PosesConfig(), lambda *row: told.append(row)) == summary
    assert not told and contents(out) == before


def test_other_settings_and_other_images_are_not_mixed_with_the_earlier(source, posed, tmp_path):
    out = posed[0]
    with pytest.raises(DataError, match="lens was SIMPLE_RADIAL and is OPENCV now"):
        find_poses(source, out, PosesConfig(lens="OPENCV"))
    fewer = shutil.copytree(source, tmp_path / "fewer")
    (fewer / "view 0.jpg").unlink()
    with pytest.raises(DataError, match="the file of the source has changed"):
        find_poses(fewer, out, PosesConfig())
    painted = shutil.copytree(source, tmp_path / "painted")
    (painted / "masks").mkdir(exist_ok=True)
    shutil.copy(next(painted.glob("*.*g")), painted / "masks" / "view 0.png")
    with pytest.raises(DataError, match="the file of the masks has changed"):
        find_poses(painted, out, PosesConfig())
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.tex").write_text("")
    with pytest.raises(DataError, match="other contents"):
        find_poses(source, tmp_path / "thesis", PosesConfig())


def test_an_image_that_cannot_be_read_is_left_out_or_replaced_without_beginning_anew(room, tmp_path):
    source, out = tmp_path / "pictures", tmp_path / "out"
    shutil.copytree(room / "pictures", source)
    first, second, *_ = sorted(source.iterdir())
    first.write_bytes(second.read_bytes())
    whole = sorted(source.iterdir())[-1]
    whole.write_bytes(b"no picture")

    def stop(now: str, done: int, n: int) -> None:
        if now == "features":
            raise Killed

    with pytest.raises(DataError, match=f"{whole.name}: cannot be read as an image"):
        find_poses(source, out, PosesConfig(), stop)
    whole.unlink()
    second.unlink()
    third = Image.open(first).transpose(Image.Transpose.ROTATE_180)
    third.save(first)  # under a name of which there is a copy already
    with pytest.raises(Killed):
        find_poses(source, out, PosesConfig(), stop)
    copies = {path.name: path.read_bytes() for path in (out / "images").iterdir()}
    assert copies == {path.name.replace(" ", "_"): path.read_bytes() for path in source.iterdir()}
    (out / "images" / "mark").touch()
    with pytest.raises(Killed):
        find_poses(source, out, PosesConfig(), stop)
    assert (out / "images" / "mark").exists()  # of the same photographs nothing is copied again


def test_the_folder_of_the_photographs_takes_no_poses(room, tmp_path, capsys):
    source = shutil.copytree(room / "pictures", tmp_path / "pictures")
    before = contents(source)
    assert_one_line(run(capsys, "poses", source, "-o", source), "is the folder of the photographs itself", "another")
    assert contents(source) == before
    (video := tmp_path / "a.mp4").touch()
    assert_one_line(run(capsys, "poses", video, "-o", video), "is the video itself", "another folder")


def test_a_length_that_could_not_be_measured_is_corrected_without_beginning_anew(tmp_path):
    grey = folder_of(tmp_path / "in", [np.full((90, 120, 3), 99, np.uint8)] * 2)
    for metres in ("1", "2"):
        with pytest.raises(DataError, match="no poses found"):
            find_poses(grey, tmp_path / "out", PosesConfig(scale=("0", "1", metres)))
        assert json.loads((tmp_path / "out" / "poses.json").read_text())["scale"] == ["0", "1", metres]
    (tmp_path / "out" / "sparse" / "0").mkdir(parents=True)
    with pytest.raises(DataError, match=r"scale was .*'2'\] and is .*'3'\] now"):
        find_poses(grey, tmp_path / "out", PosesConfig(scale=("0", "1", "3")))


# --- a lens ---


def test_without_its_lens_every_point_is_where_the_pinhole_sees_it(posed, tmp_path):
    bent, out = tmp_path / "bent", tmp_path / "out"
    shutil.copytree(posed[0] / "images", bent / "images")
    shutil.copytree(posed[0] / "masks", bent / "masks")
    model = pycolmap.Reconstruction(str(posed[0] / "sparse" / "0"))
    for camera in model.cameras.values():  # as if the lens had been this one, and the points exact
        camera.params = [*camera.params[:3], -0.15]
    for image in model.images.values():
        for point in image.points2D:
            if point.has_point3D():
                point.xy = image.project_point(model.point3D(point.point3D_id).xyz)
    write_model(model, bent / "sparse" / "0")
    write_model(undistort(pycolmap, bent, out, lambda done, n: None), out / "sparse" / "0")
    assert {source.lens.straight for source in read_sources(out / "sparse" / "0", out / "images")[0]} == {True}
    straight, by_us = load_dataset(out), load_dataset(bent)
    check = check_cameras(straight)
    assert check.reprojection_px is not None and check.reprojection_px < 0.01
    for a, b in zip(straight.views, by_us.views, strict=True):
        assert a.image.shape == b.image.shape and np.abs(a.image - b.image).mean() < 0.01
    masked = next(view for view in straight.views if view.name == "view_0")
    mask = Masks(out / "masks", straight.views).of(masked)
    assert mask is not None and mask.shape == masked.image.shape[:2] and 0.5 < mask.mean() < 0.8


def test_without_its_lens_a_transparent_picture_is_as_bright_as_before(tmp_path):
    bent, out = tmp_path / "bent", tmp_path / "out"
    colmap_folder(bent, camera="SIMPLE_RADIAL", params=(20, 10.5, 7.5, 0.01))
    write_images(bent / "images", [f"img_{i:02d}.png" for i in range(N_VIEWS)], color=(200, 100, 50, 128))
    undistort(pycolmap, bent, out, lambda done, n: None)
    assert np.abs(np.asarray(Image.open(out / "images" / "img_03.png")) - (200.0, 100, 50, 128)).max() <= 1


def test_without_its_lens_points_have_the_colours_of_the_new_images(tmp_path):
    bent, out = tmp_path / "bent", tmp_path / "out"
    colmap_folder(bent, camera="SIMPLE_RADIAL", params=(20, 10.5, 7.5, 0.01))
    for file in (bent / "images").iterdir():
        Image.new("RGB", (21, 15), (200, 100, 50)).save(file, icc_profile=profile(DISPLAY_P3, SRGB_CURVE))
    model = undistort(pycolmap, bent, out, lambda done, n: None)
    shown = np.asarray(Image.open(out / "images" / "img_03.png"))[7, 10].astype(int)
    colors = np.array([point.color for point in model.points3D.values()])
    assert len(colors) == 9 and abs(colors - shown).max() <= 1 and abs(shown - (200, 100, 50)).max() > 5


def test_undistorted_from_the_command_line(room, tmp_path, capsys):
    three = tmp_path / "three"
    three.mkdir()
    for path in sorted((room / "pictures").iterdir())[2:5]:
        shutil.copy(path, three)
    apart = "--scale", "view_2.png", "view_4", "1.5"
    status, out, err = run(capsys, "poses", three, "-o", tmp_path / "out", "--undistort", *apart)
    cameras = found_cameras(tmp_path / "out")
    assert np.linalg.norm(cameras["view_2"].position - cameras["view_4"].position) == pytest.approx(1.5)
    assert status == 0 and "3 of 3 images have a pose" in out and out.endswith(f"{tmp_path / 'out'}\n"), err
    assert "up is -y, as the cameras were held, because no image says where down is; the unit is a metre" in out
    assert read_world(tmp_path / "out") == read_world(tmp_path / "out" / "distorted") == World("-y", 1.0)
    assert "undistortion" in out and (tmp_path / "out" / "distorted" / "sparse" / "0").is_dir()
    assert pycolmap.Reconstruction(str(tmp_path / "out" / "sparse" / "0")).cameras[1].model_name == "PINHOLE"


# --- a video ---


@pytest.mark.slow
def test_a_video_gives_sharp_frames_with_their_poses(room, tmp_path):
    out = tmp_path / "out"
    summary = find_poses(room / "walk.mp4", out, PosesConfig(frames=8))
    assert summary.n_registered == summary.n_images == 8
    error = pose_error(filmed(), found_cameras(out))
    assert error.n == 8 and error.largest_position < 0.03 and error.angle < 0.3


def test_a_gpu_that_pycolmap_was_built_without_is_one_line(source, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(pycolmap, "has_cuda", False)
    result = run(capsys, "poses", source, "-o", tmp_path / "out", "--gpu")
    assert_one_line(result, "--gpu: pycolmap", "built without CUDA", "leave --gpu out")
    assert not (tmp_path / "out").exists()


# --- straight to a model ---


def test_train_finds_poses_of_plain_images_first(source, posed, tmp_path, capsys, monkeypatch):
    given = []

    def find(source: Path, out: Path, config: PosesConfig, progress) -> Summary:
        given.append(config)
        shutil.copytree(posed[0], out, dirs_exist_ok=True)
        return posed[1]

    monkeypatch.setattr(module, "find_poses", find)
    tiny = ("--steps", 14, "--max-primitives", 80, "--sh-degree", 0, "--downscale", 4, "--preset", "3dgs")
    status, out, err = run(capsys, "train", source, "-o", tmp_path / "run", *tiny, "--seed", 3)
    assert status == 0 and f"{source} has no cameras: finding poses first, in {tmp_path / 'run' / 'posed'}" in out, err
    assert given == [PosesConfig(seed=3)] and f"{N} of {N} images have a pose" in out
    config = json.loads((tmp_path / "run" / "config.json").read_text())
    assert config["data"] == str(tmp_path / "run" / "posed") and config["masks"] == str(tmp_path / "run/posed/masks")
    assert (tmp_path / "run" / "metrics.json").exists()
    status, _, err = run(capsys, "train", source, "-o", tmp_path / "run", *tiny, "--seed", 3, "--resume")
    assert status == 0, err


def test_train_says_that_a_search_which_was_stopped_goes_on(source, tmp_path, capsys, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "find_poses", stopped)
    status, _, err = run(capsys, "train", source, "-o", tmp_path / "run", "--steps", 14)
    assert status == 130 and err == "dogsplat: stopped; the same command again goes on from here\n"


def test_train_refuses_a_run_in_place_of_photographs(tmp_path, capsys):
    for name in ("config.json", "history.jsonl", "test/1.png", "test/2.png"):
        (tmp_path / "run" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "run" / name).write_bytes(b"")
    assert_one_line(run(capsys, "train", tmp_path / "run", "-o", tmp_path / "out"), "is a run")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_fisheye_is_found_though_the_files_say_nothing_of_its_focal_length(tmp_path):
    """Equidistant: what is seen at an angle from the axis is so many times the focal length from the centre."""
    focal, wide, of_wide = 180.0, 600, 170.0  # pixels; of a pinhole of 121 degrees, from which the pictures are taken
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2, np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2)
    radius = np.hypot(x, y)
    at = wide / 2 - 0.5 + of_wide * np.tan(radius / focal) / radius * np.array([y, x])  # [2, H, W]
    scene, pictures = textured_room(), []
    for camera in arc(N, *SIZE):
        pinhole = Camera(camera.w2c, of_wide, of_wide, wide / 2, wide / 2, wide, wide)
        planes = np.moveaxis(picture(scene, [pinhole], 4), -1, 0)
        pictures.append(np.stack([map_coordinates(plane, at, order=1) for plane in planes], -1))
    summary = find_poses(folder_of(tmp_path / "in", pictures), tmp_path / "out", PosesConfig(lens="OPENCV_FISHEYE"))
    assert summary.n_registered == N and not summary.advice
    found = next(iter(found_cameras(tmp_path / "out").values()))
    assert found.fx == pytest.approx(focal, rel=0.05)
