"""Folders of scans: which are such, and one line for each that is damaged or exported otherwise."""

import json
import shutil
from pathlib import Path

import phone_scans as scans
import pytest
from mi_dogsplat.datasets.scans.apps import is_scan, read_scan
from mi_dogsplat.poses.input import require_input
from mi_dogsplat.support.errors import DataError


def write(app: str, folder: Path) -> Path:
    if app == "polycam":
        scans.write_polycam(folder, n=3)
    elif app == "record3d":
        scans.write_record3d(folder, n=4)
    else:
        scans.write_stray_files(folder, 3)
        (folder / "rgb.mp4").write_bytes(b"")
    return folder


@pytest.mark.parametrize("app", ["polycam", "record3d", "stray"])
def test_what_an_app_has_exported_is_a_scan_and_other_folders_are_none(tmp_path, app):
    folder = write(app, tmp_path / "scan")
    assert is_scan(folder) and len(read_scan(folder).frames) == 3
    assert not is_scan(tmp_path) and not is_scan(folder / "depth") and not is_scan(tmp_path / "absent")


def test_the_folder_below_is_found(tmp_path):
    scans.write_polycam(tmp_path / "a", n=3)
    assert is_scan(tmp_path / "a" / "keyframes")
    scans.write_record3d(tmp_path / "b" / "EXR_RGBD", n=4)
    assert is_scan(tmp_path / "b") and len(read_scan(tmp_path / "b").frames) == 3


def test_keyframes_are_in_the_order_of_their_times(tmp_path):
    """Of which the earlier ones may have fewer digits."""
    scans.write_polycam(tmp_path, n=3)
    for path in list(tmp_path.rglob("1700000000000.*")):
        path.rename(path.with_stem("99999"))
    assert [frame.number for frame in read_scan(tmp_path).frames] == [99999, 1700000250000, 1700000500000]


def test_cameras_as_they_were_tracked_are_read_where_none_is_corrected(tmp_path):
    scans.write_polycam(tmp_path, n=3)
    assert read_scan(tmp_path).corrected
    for path in (tmp_path / "keyframes" / "corrected_cameras").iterdir():
        path.unlink()
    scan = read_scan(tmp_path)
    assert not scan.corrected and {frame.image.parent.name for frame in scan.frames if frame.image} == {"images"}


def test_cameras_as_they_were_tracked_are_read_where_no_image_is_corrected(tmp_path):
    scans.write_polycam(tmp_path, n=3)
    shutil.rmtree(tmp_path / "keyframes" / "corrected_images")
    assert not read_scan(tmp_path).corrected and len(read_scan(tmp_path).frames) == 3


def changed(path: Path, **values: object) -> None:
    """A JSON file with other values; None takes one out."""
    told = {**json.loads(path.read_text()), **values}
    path.write_text(json.dumps({key: value for key, value in told.items() if value is not None}))


CAMERA = "keyframes/corrected_cameras/1700000250000.json"
DAMAGE = [
    ("polycam", CAMERA, {"fx": None}, "lacks 'fx'"),
    ("polycam", CAMERA, {"fx": "wide"}, "is no camera"),
    ("polycam", CAMERA, {"fx": -3}, "focal lengths must be positive"),
    ("polycam", CAMERA, {"t_00": 3}, "is not a rotation"),
    ("polycam", CAMERA, {"t_03": 1e999}, "not finite"),
    ("polycam", CAMERA, {"width": 1e999}, "is no camera"),
    ("polycam", CAMERA, {"width": [1]}, "is no camera"),
    ("record3d", "metadata.json", {"poses": None}, "only recordings by LiDAR have poses"),
    ("record3d", "metadata.json", {"poses": [[0, 0, 0, 1, 0, 0]]}, "expected (frames, 7)"),
    ("record3d", "metadata.json", {"poses": [[0, 0, 0, 0, 0, 0, 0]] * 3}, "no pose: quaternion [0.0, 0.0, 0.0, 0.0]"),
    ("record3d", "metadata.json", {"poses": [[1e200, 0, 0, 0, 0, 0, 0]] * 3}, "no pose"),
    ("record3d", "metadata.json", {"K": [1, 2]}, "no cameras that can be used"),
    ("record3d", "metadata.json", {"w": "wide"}, "no cameras that can be used"),
    ("record3d", "metadata.json", {"perFrameIntrinsicCoeffs": [[1, 2]] * 4}, "no cameras that can be used"),
    ("record3d", "metadata.json", {"poses": [[0, 0, 0, 1, 0, 0, 0]]}, "a single photograph"),
]


@pytest.mark.parametrize(("app", "file", "values", "problem"), DAMAGE)
def test_a_camera_that_is_none_is_one_line(tmp_path, app, file, values, problem):
    folder = write(app, tmp_path / "scan")
    changed(folder / file, **values)
    with pytest.raises(DataError) as error:
        read_scan(folder)
    assert problem in str(error.value) and "export" in str(error.value)


STRAY = [
    ("odometry.csv", "", 'has no column "x"'),
    ("odometry.csv", "timestamp, frame, x, y, z, qx, qy, qz\n0, 0, 1, 1, 1, 0, 0, 0\n", 'has no column "qw"'),
    ("odometry.csv", "x, y, z, qx, qy, qz, qw\n0, 0, 0, 0, 0, 0, 1\n0, 0\n", "line 3 cannot be read"),
    ("odometry.csv", "x, y, z, qx, qy, qz, qw\n0, 0, nan, 0, 0, 0, 1\n", "line 2 cannot be read (no pose"),
    ("odometry.csv", "x, y, z, qx, qy, qz, qw\n0, 0, 0, 0, 0, 0, 0\n", "line 2 cannot be read (no pose"),
    ("odometry.csv", "x, y, z, qx, qy, qz, qw\n0, 0, 0, 0, 0, 0, 1\n", "a single photograph"),
    ("odometry.csv", "x, y, z, qx, qy, qz, qw, frame\n0, 0, 0, 0, 0, 0, 1, a\n", "line 2 cannot be read"),
    ("camera_matrix.csv", "1, 0, 2\n0, 1\n", "is no matrix of a camera"),
    ("camera_matrix.csv", None, "is no matrix of a camera"),
]


@pytest.mark.parametrize(("file", "text", "problem"), STRAY)
def test_a_table_that_cannot_be_read_is_one_line(tmp_path, file, text, problem):
    folder = write("stray", tmp_path / "scan")
    (folder / file).unlink() if text is None else (folder / file).write_text(text)
    with pytest.raises(DataError) as error:
        read_scan(folder)
    assert problem in str(error.value)


def test_a_number_that_no_file_name_holds_has_no_depth_map(tmp_path):
    folder = write("stray", tmp_path / "scan")
    header = "x, y, z, qx, qy, qz, qw, frame"
    (folder / "odometry.csv").write_text("\n".join([header, *2 * [f"0, 0, 0, 0, 0, 0, 1, {'9' * 300}"]]))
    assert [frame.depth for frame in read_scan(folder).frames] == [None, None]


def test_photographs_that_are_missing_are_left_out_and_one_alone_is_refused(tmp_path):
    scans.write_polycam(tmp_path, n=3)
    images = sorted((tmp_path / "keyframes" / "corrected_images").iterdir())
    images[0].unlink()
    assert len(read_scan(tmp_path).frames) == 2
    images[1].unlink()
    with pytest.raises(DataError, match="a scan with a single photograph"):
        read_scan(tmp_path)


def test_formats_that_are_not_read_say_what_to_export(tmp_path):
    for name, problem in ("a.r3d", "export the recording as EXR"), ("b.zip", "unpack it"):
        (tmp_path / name).write_bytes(b"PK")
        with pytest.raises(DataError, match=problem):
            require_input(tmp_path / name)
    (tmp_path / "rgbd").mkdir()
    (tmp_path / "metadata").write_text("{}")
    with pytest.raises(DataError, match="unpacked .r3d"):
        is_scan(tmp_path)
