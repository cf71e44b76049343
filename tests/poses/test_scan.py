"""Scans of phones become data sets: where their photographs, depth maps and points are in the world."""

import json
from pathlib import Path

import numpy as np
import phone_scans as scans
import pytest
from mi_dogsplat.cli import main
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.colmap import find_model, read_sources
from mi_dogsplat.datasets.depth_files import read_depth
from mi_dogsplat.datasets.depths import Depths
from mi_dogsplat.datasets.world import World, read_world
from mi_dogsplat.inspection.info import describe
from mi_dogsplat.poses.borders import RIPPLES
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.input import needs_poses
from mi_dogsplat.poses.run import is_done
from mi_dogsplat.poses.scan import take_scan
from mi_dogsplat.scene.cameras import Camera, inverse_rigid
from mi_dogsplat.support.errors import DataError
from PIL import Image
from turned_video import turned_clockwise

from benchmarks.poses.filmed_scene import write_video

N_FILMED = 40


def write_stray(folder: Path, per_frame: bool = False) -> list[scans.Pose]:
    """The video asks for a turn, which must not be done, and has a frame more than there are poses."""
    made = scans.write_stray_files(folder, N_FILMED, per_frame)
    frames = [scans.seen(pose, scans.SIZE)[1] for pose in scans.poses(N_FILMED)]
    write_video(folder / "straight.mp4", [*frames, frames[0]])
    turned_clockwise(folder / "straight.mp4", folder / "rgb.mp4")
    (folder / "straight.mp4").unlink()
    return made


WRITERS = {
    "polycam": scans.write_polycam,
    "polycam as tracked": lambda folder: scans.write_polycam(folder, corrected=False),
    "record3d": scans.write_record3d,
    "record3d per frame": lambda folder: scans.write_record3d(folder, per_frame=True),
    "stray": write_stray,
    "stray per frame": lambda folder: write_stray(folder, per_frame=True),
}
GRAVITY = ("polycam", "polycam as tracked", "stray", "stray per frame")


@pytest.fixture(scope="module", params=WRITERS)
def taken(request, tmp_path_factory):
    """The kind, the poses that were written, the scan, and what it has become."""
    folder = tmp_path_factory.mktemp("scan")
    made = WRITERS[request.param](folder / "scan")
    summary = take_scan(folder / "scan", folder / "posed", PosesConfig())
    return request.param, made, folder / "posed", summary


def cameras(folder: Path) -> list[tuple[str, Camera]]:
    model = find_model(folder)
    assert model
    return [(source.image_path.name, source.camera) for source in read_sources(model, folder / "images")[0]]


def number_of(kind: str, name: str) -> int:
    """Of the pose of an image."""
    number = int(name.removeprefix("frame_").removesuffix(".jpg"))
    return (number - 1_700_000_000_000) // 250_000 if "polycam" in kind else number


def world_of(kind: str, made: list[scans.Pose], folder: Path) -> np.ndarray:
    """What the world of the scan has been moved by [4, 4], from the first camera."""
    name, camera = cameras(folder)[0]
    pose = made[number_of(kind, name)]
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = pose.turn * [1, -1, -1], pose.place
    return camera.c2w @ inverse_rigid(c2w)


def test_the_cameras_are_those_of_the_scan_in_a_world_that_was_moved_as_a_whole(taken):
    kind, made, folder, _ = taken
    moved = world_of(kind, made, folder)
    found = cameras(folder)
    assert len(found) > 10
    for name, camera in found:
        pose = made[number_of(kind, name)]
        np.testing.assert_allclose(camera.position, moved[:3, :3] @ pose.place + moved[:3, 3], atol=1e-6)
        np.testing.assert_allclose(camera.c2w[:3, :3] * [1, -1, -1], moved[:3, :3] @ pose.turn, atol=1e-6)
        scale = camera.width / scans.SIZE[0]
        expected = np.array([*scans.FOCAL, *scans.CENTER]) * scale
        np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], expected, rtol=1e-6)
    assert read_world(folder) == World("-y", 1.0)
    if kind in GRAVITY:
        np.testing.assert_allclose(moved[:3, :3] @ [0, 1, 0], [0, -1, 0], atol=1e-6)


def in_room(kind: str, made: list[scans.Pose], folder: Path, points: np.ndarray) -> np.ndarray:
    """Points of the data set in the axes of the room."""
    inverse = inverse_rigid(world_of(kind, made, folder))
    points = points @ inverse[:3, :3].T + inverse[:3, 3]
    if "record3d" in kind:  # whose world is that of the first camera
        first = scans.poses(17)[0]
        points = points @ first.turn.T + first.place
    return points


def test_points_lie_on_the_walls_in_their_colours(taken):
    kind, made, folder, summary = taken
    dataset = load_dataset(folder)
    assert len(dataset.points) == summary.n_points > 5000
    points = in_room(kind, made, folder, dataset.points)
    off = np.stack([np.abs(points - scans.LOW), np.abs(points - scans.HIGH)], axis=1)  # [P, 2, 3]
    nearest = off.reshape(-1, 6).argmin(axis=1)
    assert off.min(axis=(1, 2)).max() < 2e-3  # half a millimetre of depth, and a column between two pixels
    wall = scans.COLORS[2 * (nearest % 3) + nearest // 3]
    levels = 255 * dataset.point_colors
    differences = np.minimum(np.abs(levels - wall), np.abs(levels - scans.DARKER * wall)).max(axis=1)
    assert np.median(differences) < 12  # of JPEG, and of H.264
    assert len(np.unique(nearest)) >= 5


def test_depth_maps_fit_the_photographs_and_what_is_not_trusted_is_unknown(taken):
    kind, made, folder, summary = taken
    dataset = load_dataset(folder)
    depths = Depths(folder / "depth", dataset)
    for view in dataset.train[1:6]:
        depth = depths.of(view)
        assert depth is not None
        pose = made[number_of(kind, view.name)]
        if "record3d" in kind:
            pose = scans.poses(17)[number_of(kind, view.name)]
        true = scans.seen(pose, (depth.shape[1], depth.shape[0]))[0]
        known = depth > 0
        assert np.median(np.abs(depth - true)[known] / true[known]) < 0.01
        low = known[: known.shape[0] // 4]
        assert not low.any() if "polycam" in kind else low.any()
    assert summary.known == pytest.approx(0.75 if "polycam" in kind else 1, abs=0.03)


def test_a_frame_of_which_nothing_is_known_has_no_depth_map(taken):
    kind, _, folder, summary = taken
    written = {path.stem for path in (folder / "depth").glob("*.png")}
    images = {path.stem for path in (folder / "images").glob("*.jpg")}
    assert len(written) == summary.n_depths and len(images) == summary.n_images
    assert images - written == ({"frame_000000"} if "stray" in kind else set())


def test_black_borders_are_masked_and_nothing_else(taken):
    kind, _, folder, summary = taken
    masks = sorted((folder / "masks").glob("*"))
    assert len(masks) == summary.n_masks == (summary.n_images if kind == "polycam" else 0)
    for path in masks[:2]:
        mask = np.asarray(Image.open(path))
        assert not mask[:, : scans.BORDER + 1].any() and (mask[:, scans.BORDER + RIPPLES :] == 255).all()


def test_images_are_those_of_the_scan(taken):
    kind, _, folder, _ = taken
    scan = folder.parent / "scan"
    for image in sorted((folder / "images").iterdir())[:3]:
        if kind == "polycam":
            source = scan / "keyframes" / "corrected_images" / image.name.removeprefix("frame_")
        elif "record3d" in kind:
            source = scan / "rgb" / f"{int(image.stem[6:])}.jpg"
        else:
            continue
        assert image.read_bytes() == source.read_bytes()


def test_the_summary_says_what_to_do_next(taken):
    kind, _, _, summary = taken
    said = "\n".join(summary.lines())
    assert "train with --depths" in said
    assert ("--refine-poses" in said) == (kind != "polycam")
    assert ("--masks" in said) == (kind == "polycam")
    assert ("by gravity" in said) == (kind in GRAVITY)


def test_as_many_frames_as_are_asked_for(tmp_path):
    scans.write_polycam(tmp_path / "scan")
    assert take_scan(tmp_path / "scan", tmp_path / "posed", PosesConfig(frames=6)).n_images == 6


def test_what_was_stopped_goes_on_and_is_no_data_set_before(tmp_path):
    scans.write_polycam(tmp_path / "scan")
    out = tmp_path / "posed"

    def stop(stage: str, done: int, n: int) -> None:
        if stage == "depth maps" and done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        take_scan(tmp_path / "scan", out, PosesConfig(), stop)
    assert not is_done(out)
    with pytest.raises(DataError, match="frames was None and is 5 now"):
        take_scan(tmp_path / "scan", out, PosesConfig(frames=5))
    summary = take_scan(tmp_path / "scan", out, PosesConfig())
    again = tmp_path / "again"
    assert take_scan(tmp_path / "scan", again, PosesConfig()) == summary
    for name in ("cameras", "images", "points3D"):
        assert (out / f"sparse/0/{name}.txt").read_bytes() == (again / f"sparse/0/{name}.txt").read_bytes()
    told: list[str] = []
    assert take_scan(tmp_path / "scan", out, PosesConfig(), lambda stage, *_: told.append(stage)) == summary
    assert not told


def test_a_scan_without_depth_maps_has_poses_and_no_points(tmp_path):
    scans.write_polycam(tmp_path / "scan")
    for path in (tmp_path / "scan" / "keyframes" / "depth").iterdir():
        path.unlink()
    summary = take_scan(tmp_path / "scan", tmp_path / "posed", PosesConfig())
    assert (summary.n_points, summary.n_depths) == (0, 0) and "no depth maps" in "\n".join(summary.lines())
    assert len(load_dataset(tmp_path / "posed").points) == 0
    assert not (tmp_path / "posed" / "depth").exists()


def test_what_is_beyond_the_reach_of_the_sensor_is_unknown(tmp_path):
    scans.write_polycam(tmp_path / "scan")
    depth = tmp_path / "scan" / "keyframes" / "depth" / "1700000000000.png"
    far = np.full(scans.DEPTH_SIZE[::-1], 2.0)
    far[20:, 10] = 5.4
    scans.millimetres(far).save(depth)
    take_scan(tmp_path / "scan", tmp_path / "posed", PosesConfig())
    found = read_depth(tmp_path / "posed" / "depth" / "frame_1700000000000.png")
    assert not found[20:, 10].any() and (found[20:, 11] == 2).all()


SEARCHED = [{"lens": "OPENCV"}, {"masks": "painted"}, {"linear": True}, {"undistort": True}, {"scale": ("a", "b", "1")}]


@pytest.mark.parametrize("setting", SEARCHED)
def test_settings_of_structure_from_motion_are_refused(tmp_path, setting):
    scans.write_polycam(tmp_path / "scan", n=2)
    with pytest.raises(DataError, match=f"--{next(iter(setting))}: is for photographs without poses"):
        take_scan(tmp_path / "scan", tmp_path / "posed", PosesConfig(**setting))
    assert not (tmp_path / "posed").exists()


def test_the_command_takes_a_scan_and_train_takes_masks_and_depths_of_it(tmp_path, capsys):
    scans.write_polycam(tmp_path / "scan")
    assert needs_poses(tmp_path / "scan")
    with pytest.raises(DataError, match="is the scan of a phone; dogsplat poses makes a data set of it"):
        describe(tmp_path / "scan")
    assert main(["poses", str(tmp_path / "scan"), "-o", str(tmp_path / "posed")]) == 0
    assert "16 images of a scan by Polycam" in capsys.readouterr().out
    run = tmp_path / "run"
    small = ["--preset", "3dgs", "--steps", "3", "--max-primitives", "100"]
    assert main(["train", str(tmp_path / "scan"), "-o", str(run), *small]) == 0
    assert "is a scan: reading it first" in capsys.readouterr().out
    config = json.loads((run / "config.json").read_text())
    assert (config["data"], config["masks"], config["depths"]) == tuple(
        str(run / name) for name in ("posed", "posed/masks", "posed/depth")
    )
