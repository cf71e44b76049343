"""Lens distortion: pycolmap is the oracle of the formulas; photographs are straightened when they are loaded."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from dataset_folders import transforms_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.colmap_files import read_cameras
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.datasets.lens import Lens, undistortion
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.scene.cameras import Camera
from PIL import Image
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = 320, 240
LENSES = {
    "SIMPLE_RADIAL": (250.0, 161, 118, -0.12),
    "RADIAL": (250.0, 161, 118, 0.08, -0.03),
    "OPENCV": (250.0, 255, 150, 125, -0.2, 0.07, 0.002, -0.004),
    "FULL_OPENCV": (250.0, 255, 150, 125, -0.2, 0.07, 0.002, -0.004, 0.01, 0.05, -0.03, 0.02),
    "OPENCV_FISHEYE": (150.0, 152, 161, 118, 0.03, -0.02, 0.004, -0.001),
    "SIMPLE_RADIAL_FISHEYE": (140.0, 161, 118, 0.02),
    "RADIAL_FISHEYE": (140.0, 161, 118, 0.02, -0.01),
    "SIMPLE_FISHEYE": (150.0, 161, 118),
    "FISHEYE": (140.0, 143, 161, 118),
}
each_lens = pytest.mark.parametrize("name", LENSES)


def colmap_camera(name: str) -> pycolmap.Camera:
    return pycolmap.Camera(model=name, width=WIDTH, height=HEIGHT, params=LENSES[name])


def read(folder: Path, name: str) -> tuple[Camera, Lens]:
    """What our reader makes of COLMAP's file of such a camera."""
    values = " ".join(map(str, LENSES[name]))
    (folder / "cameras.txt").write_text(f"1 {name} {WIDTH} {HEIGHT} {values}\n")
    c = read_cameras(folder / "cameras.txt")[1]
    return Camera(np.eye(4), c.fx, c.fy, c.cx, c.cy, c.width, c.height), c.lens


@each_lens
def test_distortion_is_that_of_colmap(tmp_path, name):
    camera, lens = read(tmp_path, name)
    rays = np.random.default_rng(0).uniform(-0.6, 0.6, (500, 2))
    got = lens.distort(rays) * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    expected = np.array(colmap_camera(name).img_from_cam(np.column_stack([rays, np.ones(500)])))
    np.testing.assert_allclose(got, expected, atol=1e-9)
    assert np.abs(got - (rays * (camera.fx, camera.fy) + (camera.cx, camera.cy))).max() > 3


@each_lens
def test_points_go_through_the_lens_and_back(tmp_path, name):
    camera, lens = read(tmp_path, name)
    y, x = np.mgrid[0:HEIGHT:9, 0:WIDTH:9]
    pixels = np.stack([x, y], -1).reshape(-1, 2) + 0.5
    straight = undistortion(camera, lens)
    rays = lens.undistort((pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy))
    there = np.isfinite(rays).all(1)
    assert there.mean() > 0.9
    back = lens.distort(rays) * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    assert np.abs(back - pixels)[there].max() < 1e-3
    colmap = np.array(colmap_camera(name).cam_from_img(pixels[there]))
    seen = np.linalg.norm(rays[there], axis=1) < 1.5
    expected = colmap * (straight.camera.fx, straight.camera.fy) + (straight.camera.cx, straight.camera.cy)
    assert np.abs(straight.points(pixels[there]) - expected)[seen].max() < 0.05


@each_lens
def test_the_pinhole_is_the_largest_rectangle_inside_of_the_photograph(tmp_path, name):
    straight = undistortion(*read(tmp_path, name))
    c = straight.camera
    assert c.width > 0.7 * WIDTH and c.height > 0.7 * HEIGHT
    pixels = straight.source_pixels()
    assert pixels.min() > -0.05 and (pixels.reshape(-1, 2).max(0) < (WIDTH + 0.05, HEIGHT + 0.05)).all()
    corners = straight.lens.distort((np.array([[0, c.cy], [c.width, c.cy], [c.cx, 0], [c.cx, c.height]])
                                     - (c.cx, c.cy)) / (c.fx, c.fy))
    reach = corners * (straight.source.fx, straight.source.fy) + (straight.source.cx, straight.source.cy)
    slack = reach[0, 0] + reach[2, 1], WIDTH - reach[1, 0] + HEIGHT - reach[3, 1]
    assert max(slack) < 0.2 * WIDTH


def scene_color(rays: np.ndarray) -> np.ndarray:
    """A smooth texture at infinity, [..., 3] of pinhole coordinates [..., 2]."""
    u, v = 12 * rays[..., 0], 12 * rays[..., 1]
    return np.stack([0.5 + 0.4 * np.sin(u + 0.3 * v), 0.5 + 0.4 * np.cos(v), 0.5 + 0.4 * np.sin(u - v)], -1)


def photograph(name: str) -> np.ndarray:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    pixels = np.stack([x, y], -1).reshape(-1, 2)
    rays = np.array(colmap_camera(name).cam_from_img(pixels))
    return scene_color(np.nan_to_num(rays)).reshape(HEIGHT, WIDTH, 3)


@each_lens
def test_a_straightened_photograph_is_that_of_the_pinhole(tmp_path, name):
    straight = undistortion(*read(tmp_path, name))
    got, c = straight.image(photograph(name)), straight.camera
    y, x = np.mgrid[0:c.height, 0:c.width] + 0.5
    rays = np.stack([(x - c.cx) / c.fx, (y - c.cy) / c.fy], -1)
    source = straight.source_pixels()  # a spline of pixels knows nothing of what lies beyond the border
    inside = (source > 4).all(-1) & (source < (WIDTH - 4, HEIGHT - 4)).all(-1) & (np.linalg.norm(rays, axis=-1) < 1)
    expected = scene_color(rays)
    # a shift by 0.05 px would change the texture by 0.05 px * 12 / f * 0.4
    tolerance = 0.05 * 12 / c.fx * 0.4
    assert inside.mean() > 0.3 and np.abs(got - expected)[inside].max() < tolerance


@each_lens
@pytest.mark.parametrize("corner", [(190, 30), (20, 135), (185, 130)], ids=["right", "below", "both"])
def test_a_photograph_that_was_cut_out_beside_the_principal_point_is_straightened_too(tmp_path, name, corner):
    (whole, lens), (left, top), (width, height) = read(tmp_path, name), corner, (110, 80)
    part = replace(whole, cx=whole.cx - left, cy=whole.cy - top, width=width, height=height)
    straight = undistortion(part, lens)
    c, source = straight.camera, straight.source_pixels()
    assert c.width > 0.7 * width and c.height > 0.7 * height
    assert source.min() > -0.05 and (source.reshape(-1, 2).max(0) < (width + 0.05, height + 0.05)).all()
    y, x = np.mgrid[0 : c.height, 0 : c.width] + 0.5
    expected = scene_color(np.stack([(x - c.cx) / c.fx, (y - c.cy) / c.fy], -1))
    got = straight.image(photograph(name)[top : top + height, left : left + width])
    inside = (source > 4).all(-1) & (source < (width - 4, height - 4)).all(-1)
    assert inside.mean() > 0.3 and np.abs(got - expected)[inside].max() < 0.05 * 12 / c.fx * 0.4


def test_a_lens_that_folds_back_within_the_image_is_cut_before_it_does():
    camera = Camera(np.eye(4), 100, 100, 100, 100, 200, 200)
    folding = Lens((-0.4,))
    assert 0.85 < folding.largest_radius < np.sqrt(1 / 1.2) + 1e-3
    c = undistortion(camera, folding).camera
    corner = np.hypot(max(c.cx, c.width - c.cx) / c.fx, max(c.cy, c.height - c.cy) / c.fy)
    assert corner <= folding.largest_radius + 0.02
    with pytest.raises(ValueError, match="leaves no pinhole image"):
        undistortion(Camera(np.eye(4), 100, 100, 500, 100, 200, 200), Lens((-0.4,)))


def test_photographs_that_share_a_lens_look_for_its_rectangle_once(monkeypatch):
    lens, found = Lens((-0.15, 0.0321)), []
    undistort = Lens.undistort
    monkeypatch.setattr(Lens, "undistort", lambda self, points: (found.append(self), undistort(self, points))[1])
    poses = [np.eye(4), np.eye(4)[[1, 2, 0, 3]]]
    first, second = (undistortion(Camera(pose, 300, 300, 160, 120, 320, 240), lens) for pose in poses)
    assert len(found) == 4  # sides of one photograph
    assert np.array_equal(second.camera.w2c, poses[1]) and np.array_equal(first.camera.w2c, poses[0])
    other = undistortion(Camera(poses[0], 301, 300, 160, 120, 320, 240), lens)
    assert len(found) == 8 and other.camera.cx != first.camera.cx


# Data sets

def colmap_data(root: Path, name: str, size=(WIDTH, HEIGHT), images="images") -> np.ndarray:
    """Three views of points on a wall and what each observes, written by hand; the points [P, 3]."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (40, 2)), np.full(40, 2.0)])
    camera, lines = colmap_camera(name), []
    (root / "sparse/0").mkdir(parents=True, exist_ok=True)
    (root / images).mkdir(exist_ok=True)
    picture = Image.fromarray((255 * photograph(name)).astype(np.uint8)).resize(size, Image.Resampling.BOX)
    for i in (0, 4, 8):
        pose, t = Rotation.from_euler("y", 0.02 * i), np.array([0.02 * i, 0, 0])
        pixels = np.array(camera.img_from_cam(pose.apply(points) + t))
        x, y, z, w = pose.as_quat()
        lines.append(f"{i + 1} {w} {x} {y} {z} {t[0]} {t[1]} {t[2]} 1 {i}.png")
        lines.append(" ".join(f"{u} {v} {k}" for k, (u, v) in enumerate(pixels)))
        picture.save(root / images / f"{i}.png")
    (root / "sparse/0/images.txt").write_text("\n".join(lines) + "\n")
    (root / "sparse/0/points3D.txt").write_text(
        "\n".join(f"{k} {x} {y} {z} 128 128 128 0 1 0" for k, (x, y, z) in enumerate(points)) + "\n")
    values = " ".join(map(str, LENSES[name]))
    (root / "sparse/0/cameras.txt").write_text(f"1 {name} {WIDTH} {HEIGHT} {values}\n")
    return points


@pytest.mark.parametrize("downscale", [1, 2])
@each_lens
def test_a_distorted_capture_loads_as_pinholes_whose_points_project_to_what_was_observed(tmp_path, name, downscale):
    points = colmap_data(tmp_path, name)
    data = load_dataset(tmp_path, downscale=downscale)
    assert len(data.views) == 3
    for view in data.views:
        assert view.image.shape[:2] == (view.camera.height, view.camera.width)
        seen = data.observations[view.name]
        projected = view.camera.project(points[seen.points])[0]
        assert len(seen.points) == 40 and np.abs(projected - seen.pixels).max() < 0.05


def test_images_that_are_smaller_already_are_straightened_too(tmp_path):
    colmap_data(tmp_path, "OPENCV")
    averaged = load_dataset(tmp_path, downscale=2).train[0]
    colmap_data(tmp_path, "OPENCV", (WIDTH // 2, HEIGHT // 2), "images_2")
    smaller = load_dataset(tmp_path, downscale=2).train[0]
    assert abs(averaged.camera.fx - smaller.camera.fx) < 1e-9 and abs(averaged.camera.cx - smaller.camera.cx) < 1e-6
    height, width = (min(a, b) for a, b in zip(averaged.image.shape[:2], smaller.image.shape[:2], strict=True))
    assert np.abs(averaged.image[:height, :width] - smaller.image[:height, :width]).mean() < 4e-3


def test_transforms_with_distortion_are_straightened(tmp_path):
    folder = transforms_folder(tmp_path, k1=-0.4, k2=0.1, p1=0.001, p2=0.002)
    bent = load_dataset(folder).train[0]
    straight = load_dataset(transforms_folder(tmp_path)).train[0]
    lens = Lens((-0.4, 0.1, 0, 0), (0.001, 0.002))
    expected = undistortion(straight.camera, lens).camera
    assert (bent.camera.width, bent.camera.cx) == (expected.width, expected.cx)
    assert bent.camera.width > straight.camera.width
    listed = load_dataset(transforms_folder(tmp_path, distortion_params=[-0.4, 0.1, 0, 0, 0.001, 0.002])).train[0]
    assert (listed.camera.width, listed.camera.cx) == (bent.camera.width, bent.camera.cx)
    fisheye = load_dataset(transforms_folder(tmp_path, is_fisheye=True, k1=0.01)).train[0]
    expected = undistortion(straight.camera, Lens((0.01, 0, 0, 0), fisheye=True)).camera
    assert (fisheye.camera.cx, fisheye.camera.cy) == (expected.cx, expected.cy) != (bent.camera.cx, bent.camera.cy)


@pytest.mark.parametrize(
    ("name", "downscale", "shrunk", "on_disk"),
    [*((name, 1, 1, False) for name in LENSES), ("OPENCV", 2, 1, True), ("OPENCV", 1, 2, False)],
)
def test_a_mask_of_the_photograph_goes_through_its_lens(tmp_path, name, downscale, shrunk, on_disk):
    """The photograph's own green as a mask: where it is painted white, the straightened photograph is green."""
    colmap_data(tmp_path, name)
    painted = Image.fromarray((255 * (photograph(name)[..., 1] > 0.5)).astype(np.uint8))
    painted.resize((WIDTH // shrunk, HEIGHT // shrunk), Image.Resampling.BOX).save(tmp_path / "0.png")
    view = next(v for v in load_dataset(tmp_path, downscale, on_disk=on_disk).views if v.name == "0")
    mask, green = Masks(tmp_path, [view]).of(view), view.image[..., 1]
    sure = np.abs(green - 0.5) > 0.04  # 2 px of the photograph from the edge
    assert mask is not None and sure.mean() > 0.6
    assert np.array_equal(mask[sure] > 0, green[sure] > 0.5)
    untouched = Masks(tmp_path, [view]).of(View(view.name, view.camera, view.image))
    assert untouched is not None and (untouched[sure] > 0).tolist() != (green[sure] > 0.5).tolist()
