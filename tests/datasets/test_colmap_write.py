"""Models that are written as text: COLMAP itself and our reader find in them what was given."""

import numpy as np
import pycolmap
from mi_dogsplat.datasets.colmap import read_model_points, read_sources
from mi_dogsplat.datasets.colmap_write import write_colmap
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.quaternions import rotation_from_quaternion
from PIL import Image

RNG = np.random.default_rng(5)


def test_colmap_and_we_read_what_was_written(tmp_path):
    poses = [affine(rotation_from_quaternion(RNG.normal(size=(1, 4)))[0], RNG.normal(size=3)) for _ in range(4)]
    optics = [(30.25, 31.5, 15.125, 11.75, 32, 24), (40.0, 40.0, 16.0, 12.0, 32, 24)]
    views = [(f"frame {k}.png".replace(" ", "_"), Camera(pose, *optics[k % 2])) for k, pose in enumerate(poses)]
    points, colors = RNG.normal(size=(7, 3)), RNG.integers(0, 256, (7, 3)) / 255
    write_colmap(tmp_path, views, points, colors)

    model = pycolmap.Reconstruction(str(tmp_path))
    assert (model.num_cameras(), model.num_images(), model.num_points3D()) == (2, 4, 7)
    for (name, camera), image in zip(views, sorted(model.images.values(), key=lambda image: image.name), strict=True):
        assert image.name == name
        np.testing.assert_allclose(image.cam_from_world().matrix(), camera.w2c[:3], atol=1e-12)
        found = model.cameras[image.camera_id]
        assert (found.model_name, found.width, found.height) == ("PINHOLE", 32, 24)
        np.testing.assert_array_equal(found.params, [camera.fx, camera.fy, camera.cx, camera.cy])
    for number, point in model.points3D.items():
        np.testing.assert_array_equal(point.xyz, points[number - 1])
        np.testing.assert_array_equal(point.color, np.rint(255 * colors[number - 1]))

    (tmp_path / "images").mkdir()
    for name, _ in views:
        Image.new("RGB", (32, 24)).save(tmp_path / "images" / name)
    sources, _ = read_sources(tmp_path, tmp_path / "images")
    for (_, camera), source in zip(views, sources, strict=True):
        np.testing.assert_allclose(source.camera.w2c, camera.w2c, atol=1e-12)
    read = read_model_points(tmp_path)
    np.testing.assert_allclose(read.positions, points, rtol=1e-6)
    np.testing.assert_allclose(read.colors, colors, atol=1e-6)
