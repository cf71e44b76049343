"""Panoramas of all directions: what their views show, and where they were taken."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_one_line, run
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.panoramas import SIDES, Cut, cut_masks, cut_panoramas, side_rotation, side_size
from mi_dogsplat.poses.photographs import Photograph
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.support.errors import DataError
from PIL import Image
from posed_room import found_cameras

from benchmarks.poses.filmed_scene import textured_room
from benchmarks.poses.pose_error import pose_error
from benchmarks.poses.traced_panoramas import exact_cameras, panorama, places

WIDTH, N = 640, 5
LOOKS = {
    "front": (0, 0, 1), "right": (1, 0, 0), "back": (0, 0, -1), "left": (-1, 0, 0), "down": (0, 1, 0), "up": (0, -1, 0),
}  # fmt: skip


def colours(rays: np.ndarray) -> np.ndarray:
    """A smooth colour [..., 3] of each direction."""
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return 0.5 + 0.4 * np.sin(4 * unit + [0.0, 1.0, 2.0])


def directions(width: int) -> np.ndarray:
    """[H, W, 3] of the pixels of a panorama, by spherical coordinates about the vertical, which is y."""
    polar = (np.arange(width // 2) + 0.5) / (width // 2) * np.pi  # from the zenith
    azimuth = (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi  # from straight ahead to the right
    polar, azimuth = np.meshgrid(polar, azimuth, indexing="ij")
    return np.stack([np.sin(polar) * np.sin(azimuth), -np.cos(polar), np.sin(polar) * np.cos(azimuth)], axis=-1)


@pytest.mark.parametrize("side", SIDES)
def test_a_view_shows_what_lies_in_its_direction(side):
    """Of a function of the direction alone: the same by the panorama and by the rays of a pinhole."""
    rotation, size = side_rotation(side), side_size(400)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_array_equal(rotation.T @ [0, 0, 1], LOOKS[side])
    camera = exact_cameras([np.eye(4)], 400)[f"{side}_IMG_0"]
    x = np.arange(size) + 0.5
    rays = camera.unproject(np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2), np.ones(size * size))
    view = Cut(400).views(colours(directions(400)))[side]
    np.testing.assert_allclose(view, colours(rays).reshape(size, size, 3), atol=2e-3)


def test_no_view_is_darker_or_brighter_than_its_panorama():
    edges = np.repeat((np.arange(64) // 8 % 2)[None], 32, axis=0)[..., None].astype(float)
    for view in Cut(64).views(edges).values():
        assert view.min() >= 0 and view.max() <= 1


def test_a_pixel_in_the_middle_of_a_view_is_as_wide_as_one_on_the_equator():
    rows, columns = Cut(4000).pixels("front")
    middle = side_size(4000) // 2
    assert columns[middle, middle + 1] - columns[middle, middle] == pytest.approx(1, abs=1e-3)
    assert rows[middle + 1, middle] - rows[middle, middle] == pytest.approx(1, abs=1e-3)


@pytest.fixture(scope="module")
def photographed(tmp_path_factory) -> Path:
    """Panoramas of the room, and a mask for the first one, black to the left of its middle."""
    folder, scene = tmp_path_factory.mktemp("panoramas") / "panoramas", textured_room()
    (folder / "masks").mkdir(parents=True)
    for k, c2w in enumerate(places(N)):
        Image.fromarray(panorama(scene, c2w, WIDTH, 2)).save(folder / f"IMG {k}.png")
    mask = np.zeros((WIDTH // 2, WIDTH), np.uint8)
    mask[:, WIDTH // 2 :] = 255
    Image.fromarray(mask).save(folder / "masks" / "IMG 0.png")
    return folder


@pytest.fixture(scope="module")
def posed(photographed) -> Path:
    out = photographed.parent / "posed"
    find_poses(photographed, out, PosesConfig(lens="EQUIRECTANGULAR"))
    return out


def test_panoramas_are_found_where_they_were_taken(posed):
    exact = exact_cameras(places(N), WIDTH)
    found = found_cameras(posed)
    error = pose_error(exact, found)
    assert found.keys() == exact.keys() and error.n == 6 * N and error.focal == 1
    assert error.largest_position < 0.02 and error.angle < 0.3
    views = {view.name: view.camera for view in load_dataset(posed).views}
    for k in range(N):  # upright, and all views from one place
        np.testing.assert_allclose(views[f"up_IMG_{k}"].c2w[:3, 2], [0, -1, 0], atol=0.01)
        np.testing.assert_allclose(views[f"up_IMG_{k}"].position, views[f"left_IMG_{k}"].position, atol=1e-5)


def test_masks_of_panoramas_are_cut_along(posed):
    masks = {side: np.asarray(Image.open(posed / "masks" / side / "IMG_0.png.png")) for side in SIDES}
    assert masks["right"].min() == 255 and masks["left"].max() == 0
    half = side_size(WIDTH) // 2
    for side, used in (("front", np.s_[:, half + 1 :]), ("down", np.s_[:, half + 1 :]), ("back", np.s_[:, : half - 1])):
        assert masks[side][used].min() == 255 and abs(masks[side].mean() / 255 - 0.5) < 0.02
    observations = load_dataset(posed).observations
    seen = [mask[tuple(observations[f"{side}_IMG_0"].pixels.astype(int).T[::-1])] for side, mask in masks.items()
            if f"{side}_IMG_0" in observations]  # fmt: skip
    assert np.concatenate(seen).size > 30 and np.concatenate(seen).min() == 255


@pytest.mark.parametrize("size, said", [
    ((60, 40), "b.png: is 60x40, but a panorama of all directions is .* leave out --lens EQUIRECTANGULAR"),
    ((120, 40), "b.png: is 120x40, but a panorama of all directions is"),
    ((80, 40), "b.png: is 80x40, and a.png is 64x32; export all panoramas in one size"),
    ((32, 16), "b.png: is 32x16, and a.png is 64x32"),
])  # fmt: skip
def test_what_is_no_panorama_is_told_before_anything_is_written(tmp_path, size, said):
    for name, shape in {"a.png": (64, 32), "b.png": size}.items():
        Image.new("RGB", shape).save(tmp_path / name)
    with pytest.raises(DataError, match=said):
        find_poses(tmp_path, tmp_path / "out", PosesConfig(lens="EQUIRECTANGULAR"))
    assert not (tmp_path / "out").exists()


def test_views_are_cut_where_one_is_missing_and_know_where_down_is(tmp_path):
    photographs, told = [Photograph(f"{k}.png", 64, 32, "", None) for k in range(2)], []
    for k in range(2):
        for name in (f"{k}.png", f"{k}.png.png"):
            Image.new("RGB", (64, 32), "white").save(tmp_path / name)

    def cut() -> list[Photograph]:
        cut_masks(photographs, tmp_path, tmp_path / "masks")
        return cut_panoramas(photographs, tmp_path, tmp_path / "views", lambda *done: told.append(done))

    views = cut()
    assert told == [(1, 2), (2, 2)] and len(views) == 12
    for view in views:  # what looks down has it ahead, what looks up behind
        down = LOOKS[view.name.partition("/")[0]][1]
        assert view.down == pytest.approx((0, 1 - abs(down), down)) and view.focal == view.width / 2
    for folder, suffix in (("views", ""), ("masks", ".png")):
        (tmp_path / folder / "left" / f"0.png{suffix}").unlink()
        (tmp_path / folder / "left" / f"1.png{suffix}").write_text("a view that is there")
    assert cut() == views
    for folder, suffix in (("views", ""), ("masks", ".png")):
        assert (tmp_path / folder / "left" / f"0.png{suffix}").is_file()
        assert (tmp_path / folder / "left" / f"1.png{suffix}").read_text() == "a view that is there"


def test_frames_of_a_video_that_is_no_panorama_are_not_cut(tmp_path):
    frame = Photograph("frame_000000.jpg", 640, 360, "", None)
    with pytest.raises(DataError, match="frame_000000.jpg: is 640x360, but a panorama"):
        cut_panoramas([frame], tmp_path, tmp_path, lambda done, n: None)


def test_a_search_among_panoramas_goes_on_where_it_was(photographed, posed, tmp_path):
    out = shutil.copytree(posed, tmp_path / "out")
    shutil.rmtree(out / "sparse")
    summary = find_poses(photographed, out, PosesConfig(lens="EQUIRECTANGULAR"))
    assert summary.n_registered == 6 * N and len(summary.cameras) == 1


def test_views_of_panoramas_have_no_lens_to_undistort(tmp_path, capsys):
    done = run(capsys, "poses", tmp_path, "-o", tmp_path / "out", "--lens", "EQUIRECTANGULAR", "--undistort")
    assert_one_line(done, "--undistort: is for lenses, and the views of --lens EQUIRECTANGULAR have none; leave it out")
