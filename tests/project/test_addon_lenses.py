"""Cameras of bent photographs: the add-on takes the pinholes of all lenses that the package reads, and says so."""

import struct

import numpy as np
import pycolmap
import pytest
from dataset_folders import HEIGHT, WIDTH, colmap_folder, transforms_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.colmap_records import MODELS
from mi_dogsplat.support.errors import DataError

PARAMETERS = {name: (20.0, 21.0, 10.5, 7.5)[not apart :] + (0.01,) * (count - 3 - apart)
              for name, count, apart in MODELS.values()}  # fmt: skip
STRAIGHT = "SIMPLE_PINHOLE", "PINHOLE"


def cameras_by_name(addon, folder):
    cameras, _ = addon("cameras.read").read_cameras(folder, lambda path: (WIDTH, HEIGHT))
    return {camera.name: camera for camera in cameras}


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("name", PARAMETERS)
def test_a_lens_of_colmap_has_the_pinhole_that_the_package_trains_with(addon, tmp_path, name, binary):
    """But for its size and principal point: that of the package has the straightened part of the photograph alone."""
    values = PARAMETERS[name]
    colmap_folder(tmp_path, camera=name, params=values)
    if binary:
        number = int(getattr(pycolmap.CameraModelId, name))
        data = struct.pack(f"<QiiQQ{len(values)}d", 1, 7, number, WIDTH, HEIGHT, *values)
        (tmp_path / "sparse/0/cameras.bin").write_bytes(data)
    found = cameras_by_name(addon, tmp_path)
    for view in load_dataset(tmp_path).views:
        camera = found[view.name]
        assert (camera.fx, camera.fy) == (view.camera.fx, view.camera.fy)
        assert (camera.width, camera.height, camera.cx, camera.cy) == (WIDTH, HEIGHT, 10.5, 7.5)
        np.testing.assert_allclose(camera.w2c, view.camera.w2c, atol=1e-12)
        assert camera.bent == (name not in STRAIGHT)
        assert camera.bent == ((view.camera.cx, view.camera.cy) != (10.5, 7.5))


LENSES = {
    "none": ({}, False),
    "all zero": ({"camera_model": "OPENCV", "k1": 0, "p2": 0.0}, False),
    "radial": ({"k1": 0.05}, True),
    "listed": ({"distortion_params": [0.05, 0, 0, 0, 0, 0]}, True),
    "tangential": ({"camera_model": "OPENCV", "p2": 0.001}, True),
    "divided": ({"camera_model": "FULL_OPENCV", "k6": 0.01}, True),
    "fisheye": ({"camera_model": "OPENCV_FISHEYE"}, True),
    "said to be one": ({"is_fisheye": True}, True),
}


@pytest.mark.parametrize("name", LENSES)
def test_a_lens_of_transforms_has_its_pinhole(addon, tmp_path, name):
    lens, bent = LENSES[name]
    transforms_folder(tmp_path, fl_x=30, fl_y=31, **lens)
    found = cameras_by_name(addon, tmp_path)
    for view in load_dataset(tmp_path).views:
        assert (found[view.name].fx, found[view.name].fy, found[view.name].bent) == (30, 31, bent)
        np.testing.assert_allclose(found[view.name].w2c, view.camera.w2c, atol=1e-12)


@pytest.mark.parametrize("lens", [{"camera_model": "THIN_PRISM_FISHEYE"}, {"latlong": True}, {"ftheta_p0": 0.0}])
def test_a_lens_that_the_package_does_not_know_is_refused(addon, tmp_path, lens):
    folder = transforms_folder(tmp_path, **lens)
    with pytest.raises(DataError):
        load_dataset(folder)
    with pytest.raises(addon("files.errors").FileError, match="which is none of PINHOLE.*; undistort the images first"):
        cameras_by_name(addon, folder)


def test_a_lens_of_colmap_that_the_package_does_not_know_is_refused(addon, tmp_path):
    colmap_folder(tmp_path, camera="FOV", params=(20, 20, 10.5, 7.5, 0.1))
    with pytest.raises(addon("files.errors").FileError, match="the model FOV, which is none of SIMPLE_PINHOLE, .*"):
        cameras_by_name(addon, tmp_path)
