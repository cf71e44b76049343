"""Panoramas of all directions: what their views show, and where they were taken."""

import shutil
from pathlib import Path

import numpy as np
import panoramas
import pytest
from command_line import assert_one_line, run
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.panoramas import SIDES, Cut, cut_panoramas, side_rotation, side_size
from mi_dogsplat.poses.photographs import Photograph
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.errors import DataError
from PIL import Image
from posed_room import found_cameras

from benchmarks.poses.filmed_scene import textured_room
from benchmarks.poses.pose_error import pose_error

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


def side_camera(c2w: np.ndarray, side: str, size: int) -> Camera:
    """Of a view of the panorama that has this matrix [4, 4]."""
    turned = c2w.copy()
    turned[:3, :3] = c2w[:3, :3] @ side_rotation(side).T
    return Camera(np.linalg.inv(turned), size / 2, size / 2, size / 2, size / 2, size, size)


@pytest.mark.parametrize("side", SIDES)
def test_a_view_shows_what_lies_in_its_direction(side):
    """Of a function of the direction alone: the same by the panorama and by the rays of a pinhole."""
    rotation, size = side_rotation(side), side_size(400)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_array_equal(rotation.T @ [0, 0, 1], LOOKS[side])
    camera = side_camera(np.eye(4), side, size)
    x = np.arange(size) + 0.5
    rays = camera.unproject(np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2), np.ones(size * size))
    view = Cut(400).views(colours(directions(400)))[side]
    np.testing.assert_allclose(view, colours(rays).reshape(size, size, 3), atol=2e-3)


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
    for k, c2w in enumerate(panoramas.places()):
        Image.fromarray(panoramas.panorama(scene, c2w)).save(folder / f"IMG {k}.png")
    mask = np.zeros((panoramas.WIDTH // 2, panoramas.WIDTH), np.uint8)
    mask[:, panoramas.WIDTH // 2 :] = 255
    Image.fromarray(mask).save(folder / "masks" / "IMG 0.png")
    return folder


@pytest.fixture(scope="module")
def posed(photographed) -> Path:
    out = photographed.parent / "posed"
    find_poses(photographed, out, PosesConfig(lens="EQUIRECTANGULAR"))
    return out


def test_panoramas_are_found_where_they_were_taken(posed):
    size, exact = side_size(panoramas.WIDTH), {}
    for k, c2w in enumerate(panoramas.places()):
        for side in SIDES:
            exact[f"{side}_IMG_{k}"] = side_camera(c2w, side, size)
    found = found_cameras(posed)
    error = pose_error(exact, found)
    assert found.keys() == exact.keys() and error.n == 6 * panoramas.N and error.focal == 1
    assert error.largest_position < 0.02 and error.angle < 0.3
    views = {view.name: view.camera for view in load_dataset(posed).views}
    for k in range(panoramas.N):  # upright, and all views from one place
        np.testing.assert_allclose(views[f"up_IMG_{k}"].c2w[:3, 2], [0, -1, 0], atol=0.01)
        np.testing.assert_allclose(views[f"up_IMG_{k}"].position, views[f"left_IMG_{k}"].position, atol=1e-5)


def test_masks_of_panoramas_are_cut_along(posed):
    masks = {side: np.asarray(Image.open(posed / "masks" / side / "IMG_0.png.png")) for side in SIDES}
    assert masks["right"].min() == 255 and masks["left"].max() == 0
    half = side_size(panoramas.WIDTH) // 2
    for side, used in (("front", np.s_[:, half + 1 :]), ("down", np.s_[:, half + 1 :]), ("back", np.s_[:, : half - 1])):
        assert masks[side][used].min() == 255 and abs(masks[side].mean() / 255 - 0.5) < 0.02
    observations = load_dataset(posed).observations
    seen = [mask[tuple(observations[f"{side}_IMG_0"].pixels.astype(int).T[::-1])] for side, mask in masks.items()
            if f"{side}_IMG_0" in observations]  # fmt: skip
    assert np.concatenate(seen).size > 30 and np.concatenate(seen).min() == 255


def test_what_is_no_panorama_is_told_by_its_size(tmp_path):
    def image(name: str, width: int, height: int) -> Photograph:
        return Photograph(name, width, height, "", None)

    with pytest.raises(DataError, match="b.jpg: is 400x300, no panorama of all directions, .* leave out --lens EQUIRE"):
        cut_panoramas([image("a.jpg", 400, 200), image("b.jpg", 400, 300)], tmp_path, tmp_path, lambda done, n: None)
    with pytest.raises(DataError, match="b.jpg: is 600x300, and a.jpg is 400x200; export all panoramas in one size"):
        cut_panoramas([image("a.jpg", 400, 200), image("b.jpg", 600, 300)], tmp_path, tmp_path, lambda done, n: None)
    assert not list(tmp_path.iterdir())


XMP = '<rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" GPano:ProjectionType{}/>'


@pytest.mark.parametrize("said", ['="equirectangular"', ">equirectangular</GPano:ProjectionType"])
def test_photographs_that_say_that_they_are_panoramas_are_no_pinholes(tmp_path, said):
    for name in ("a.jpg", "b.jpg"):
        Image.new("RGB", (64, 32)).save(tmp_path / name, xmp=XMP.format(said).encode())
    with pytest.raises(DataError, match="a.jpg: is a panorama of all directions, .* give .*--lens EQUIRECTANGULAR"):
        find_poses(tmp_path, tmp_path / "out", PosesConfig())
    assert not (tmp_path / "out").exists()


def test_a_search_among_panoramas_goes_on_where_it_was(photographed, posed, tmp_path):
    out = shutil.copytree(posed, tmp_path / "out")
    shutil.rmtree(out / "sparse")
    summary = find_poses(photographed, out, PosesConfig(lens="EQUIRECTANGULAR"))
    assert summary.n_registered == 6 * panoramas.N and len(summary.cameras) == 1


def test_views_of_panoramas_have_no_lens_to_undistort(tmp_path, capsys):
    done = run(capsys, "poses", tmp_path, "-o", tmp_path / "out", "--lens", "EQUIRECTANGULAR", "--undistort")
    assert_one_line(done, "--undistort: is for lenses, and the views of --lens EQUIRECTANGULAR have none; leave it out")
