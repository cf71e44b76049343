"""Which way is up, where the origin is, and how long a unit."""

import numpy as np
import pytest
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.datasets.world import World
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.world import place, upright
from mi_dogsplat.scene.cameras import inverse_rigid
from mi_dogsplat.scene.orientation import up_of_cameras
from mi_dogsplat.support.errors import DataError

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")
TILT = pycolmap.Rotation3d(np.array([0.3, -0.5, 0.2, 0.8])).matrix()  # of the world that structure from motion gives


def tilted(positions: np.ndarray, target=(0.0, 0.0, 0.0), roll: float = 0.0) -> np.ndarray:
    """Cameras [N, 4, 4] that look at the target, up being z before the tilt; rolled at random by so many degrees."""
    poses, rng = [], np.random.default_rng(0)
    for position in positions:
        angle = np.radians(roll) * rng.normal()
        spin, tilt = np.eye(4), np.eye(4)
        spin[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        tilt[:3, :3] = TILT
        poses.append(tilt @ inverse_rigid(look_at(position, np.array(target), "z")) @ spin)
    return np.stack(poses)


def degrees_off(rotation: np.ndarray) -> float:
    """Of what is up from -y."""
    return float(np.degrees(np.arccos(np.clip((rotation @ TILT @ [0, 0, 1]) @ [0, -1, 0], -1, 1))))


def ring(n: int, height: float, turn: float = 2 * np.pi) -> np.ndarray:
    angles = np.linspace(0, turn, n, endpoint=False)
    return np.stack([3 * np.cos(angles), 3 * np.sin(angles), np.full(n, height)], -1)


@pytest.mark.parametrize("height", [0.2, 2.0, 5.0, -2.0])
def test_up_is_found_however_steeply_the_cameras_look(height):
    cameras = tilted(ring(30, height), roll=3)
    rotation = upright(cameras, up_of_cameras(cameras))
    assert degrees_off(rotation) < 1.5
    ahead = rotation @ cameras[0, :3, 2]  # all of them look nowhere, on the whole: so the first one decides
    assert ahead[2] > 0.3 and abs(ahead[0]) < 1e-6
    assert np.linalg.det(rotation) == pytest.approx(1) and np.allclose(rotation @ rotation.T, np.eye(3))


def test_a_capture_from_one_side_looks_ahead_with_its_images_upright():
    positions = np.array([[0.1 * k, -4, 0.05 * (-1) ** k] for k in range(9)])
    cameras = tilted(positions, (0.4, 0, 0), roll=1)
    rotation = upright(cameras, up_of_cameras(cameras))
    assert degrees_off(rotation) < 3
    ahead = rotation @ cameras[:, :3, 2].mean(axis=0)
    assert ahead[2] > 0.98 and abs(ahead[0]) < 1e-6


def test_a_single_direction_straight_down_is_still_a_rotation():
    cameras = np.repeat(np.diag([1.0, -1, -1, 1])[None], 3, axis=0)
    rotation = upright(cameras, up_of_cameras(cameras))
    assert np.allclose(rotation @ rotation.T, np.eye(3)) and np.linalg.det(rotation) == pytest.approx(1)


def model():
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=6, num_points3D=50)
    return pycolmap.synthesize_dataset(options)


def positions(reconstruction) -> dict[str, np.ndarray]:
    return {image.name: image.projection_center() for image in reconstruction.images.values()}


def test_a_model_is_moved_and_scaled_as_a_whole():
    reconstruction = model()
    before, a, b = positions(reconstruction), *sorted(positions(reconstruction))[:2]
    assert place(pycolmap, reconstruction, (a, b, "2.5"), {}).world == World("-y", 1.0)
    after = positions(reconstruction)
    factor = 2.5 / np.linalg.norm(before[a] - before[b])
    assert np.linalg.norm(after[a] - after[b]) == pytest.approx(2.5)
    for name in after:
        distance = float(np.linalg.norm(before[name] - before[a]))
        assert np.linalg.norm(after[name] - after[a]) == pytest.approx(factor * distance)
    points = [point.xyz for point in reconstruction.points3D.values()]
    np.testing.assert_allclose(np.median(points, axis=0), 0, atol=1e-9)
    for image in reconstruction.images.values():
        seen = [p for p in image.points2D if p.has_point3D()]
        shown = [image.project_point(reconstruction.point3D(p.point3D_id).xyz) for p in seen]
        np.testing.assert_allclose(np.array(shown), [p.xy for p in seen], atol=1e-3)


def mark(image, point) -> str:
    """Where an image sees a point."""
    x, y = image.project_point(point.xyz)
    return f"{image.name}:{x:.6f},{y:.6f}"


def test_a_length_is_between_points_that_are_marked_in_images():
    reconstruction = model()
    first, second = sorted(reconstruction.images.values(), key=lambda image: image.name)[:2]
    points = [reconstruction.point3D(p.point3D_id) for p in first.points2D if p.has_point3D()]
    rays = np.array([first.cam_from_world() * point.xyz for point in points])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    lonely = points[int(np.argmin(np.sort(rays @ rays.T)[:, -2]))]  # no other is seen beside it
    other = next(point for point in points if point is not lonely)
    ends = mark(first, lonely), f"{mark(first, other)}+{mark(second, other)}"
    place(pycolmap, reconstruction, (*ends, "2.5"), {})
    assert np.linalg.norm(lonely.xyz - other.xyz) == pytest.approx(2.5, rel=1e-4)


def test_a_pixel_for_which_the_lens_has_no_ray_is_no_place():
    reconstruction, name = model(), sorted(positions(model()))[0]
    for camera in reconstruction.cameras.values():
        camera.params = [400, 512, 384, -0.5]
    with pytest.raises(DataError, match=f'--scale: "{name}:0,0" is outside of the image'):
        place(pycolmap, reconstruction, (f"{name}:0,0", name, "1"), {})


def test_images_without_a_pose_do_not_count():
    reconstruction = model()
    frame = reconstruction.reg_frame_ids()[0]
    reconstruction.deregister_frame(frame)
    left = [image for image in reconstruction.images.values() if image.has_pose]
    place(pycolmap, reconstruction, None, {})
    assert len(left) == 5
    c2w = np.stack([np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]]) for image in left])
    np.testing.assert_allclose(up_of_cameras(c2w), [0, -1, 0], atol=1e-6)


def test_a_length_is_between_images_that_have_a_pose():
    with pytest.raises(DataError, match='--scale: no image "x.jpg" has a pose; name two of them, like '):
        place(pycolmap, model(), ("x.jpg", "y.jpg", "1"), {})


@pytest.mark.parametrize("length", ["0", "-1", "long", "nan", "inf"])
def test_a_length_is_a_number_above_zero(length):
    with pytest.raises(DataError, match="--scale: .* is not a length; use a number above 0"):
        PosesConfig(scale=("a", "b", length))
