"""A run that has refined the poses of its views: the cameras that come in are those that its model was trained with."""

import json
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest
from package_command import by_package

from blender_addon.cameras.objects import camera_numbers, look_through

SHIFT = (0.05, -0.03, 0.02)  # of the refined views
BY_PACKAGE = """
import json, sys
from pathlib import Path
import numpy as np
from PIL import Image
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.refined import write_refined

data, refined, *shift = sys.argv[1:]
data, frames = Path(data), []
(data / "images" / "left").mkdir(parents=True)
for i in range(4):
    Image.new("RGB", (40, 30), (50 * i, 80, 90)).save(data / "images" / "left" / f"r_{i}.png")
    pose = np.eye(4)
    pose[0, 3] = 0.2 * i
    frames.append({"file_path": f"images/left/r_{i}.png", "transform_matrix": pose.tolist()})
optics = {"fl_x": 50, "fl_y": 60, "cx": 18, "cy": 16, "w": 40, "h": 30}
(data / "transforms.json").write_text(json.dumps({**optics, "frames": frames}))
given = load_dataset(data)
moved = {view.name: view.camera.w2c.copy() for view in given.train}
for w2c in moved.values():
    w2c[:3, 3] += [float(step) for step in shift]
write_refined(Path(refined), given, data, moved)
read = [{view.name: view.camera.w2c.tolist() for view in load_dataset(path).views} for path in (refined, data)]
print(json.dumps(read))
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """(folder with data and a run, poses that the run has refined, poses of its data), as the package writes and reads
    them."""
    folder = tmp_path_factory.mktemp("written")
    return folder, *by_package(BY_PACKAGE, str(folder / "data"), str(folder / "runs/run/refined"), *map(str, SHIFT))


@pytest.fixture
def run(tmp_path, written):
    """(run folder, poses that it has refined, poses of its data) by names of views: the run is named relative to a
    folder that nobody knows any more."""
    folder, *poses = written
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    folder = tmp_path / "runs" / "run"
    (folder / "checkpoint").mkdir()
    (folder / "config.json").write_text(json.dumps({"data": "data", "refine_poses": True, "downscale": 2}))
    (folder / "checkpoint" / "inputs.json").write_text(json.dumps({"data": str(tmp_path / "data")}))
    return folder, *poses


def imported(scene, path):
    """Cameras by their names."""
    assert bpy.ops.import_scene.dogsplat_cameras(filepath=str(path)) == {"FINISHED"}
    (collection,) = (c for c in bpy.data.collections if c.name.startswith("Cameras"))
    return {obj.name: obj for obj in collection.objects}


def photograph(camera):
    """The file behind a camera; None where there is none."""
    images = [Path(bpy.path.abspath(shown.image.filepath)) for shown in camera.data.background_images]
    return images[0] if images else None


@pytest.mark.parametrize("given", [".", "config.json", "refined", "refined/transforms.json"])
def test_they_are_the_refined_ones(scene, run, given):
    """Under the names of the views, which lie elsewhere than the file that names them."""
    folder, refined, before = run
    cameras = imported(scene, folder / given)
    assert cameras.keys() == refined.keys() and "left_r_1" in cameras
    shifts = {name: np.subtract(refined[name], before[name])[:3, 3] for name in refined}
    assert sum(np.allclose(shift, SHIFT) for shift in shifts.values()) == 3  # of the fourth nobody knows better
    for name, camera in cameras.items():
        look_through(scene, camera)
        assert np.allclose(camera_numbers(scene, camera).w2c, refined[name], atol=1e-5)
        assert photograph(camera).name == f"{name.removeprefix('left_')}.png" and photograph(camera).is_file()
    expected = (20, 15) if given in (".", "config.json") else (40, 30)
    assert (scene.render.resolution_x, scene.render.resolution_y) == expected


@pytest.mark.parametrize("moved", ["run", "both"])
def test_a_run_that_was_moved_keeps_them_and_its_photographs(scene, run, tmp_path, moved):
    """Its own names of the photographs are as seen from where it was."""
    folder, refined, _ = run
    (tmp_path / "new" / "place").mkdir(parents=True)
    shutil.move(folder, tmp_path / "new" / "place" / "run")
    if moved == "both":
        shutil.move(tmp_path / "data", tmp_path / "new" / "place" / "data")
    cameras = imported(scene, tmp_path / "new" / "place" / "run")
    place = tmp_path / "new" / "place" if moved == "both" else tmp_path
    for name, camera in cameras.items():
        look_through(scene, camera)
        assert np.allclose(camera_numbers(scene, camera).w2c, refined[name], atol=1e-5)
        assert photograph(camera).resolve() == (place / "data" / "images" / "left" / f"{name[5:]}.png").resolve()


def test_without_the_data_they_come_without_photographs(scene, run, tmp_path):
    folder, refined, _ = run
    shutil.rmtree(tmp_path / "data")
    cameras = imported(scene, folder)
    assert cameras.keys() == refined.keys() and not any(photograph(camera) for camera in cameras.values())
