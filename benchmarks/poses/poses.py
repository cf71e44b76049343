"""Poses by ``dogsplat poses`` against those that are known: of captures whose poses are thrown away, of a film, and of
panoramas of all directions, as photographs and as a video.

For each: how many images have a pose, how far off these are, and the time of each stage. For captures and the film also
test PSNR of trainings that differ in nothing but the poses and points.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import numpy as np
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.datasets.colmap import find_model, load_colmap, read_sources
from mi_dogsplat.datasets.frame_cameras import intrinsics_of
from mi_dogsplat.datasets.point_ply import write_point_ply
from mi_dogsplat.datasets.refined import write_refined
from mi_dogsplat.datasets.scene_file import load_scene
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.poses.summary import Summary
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.cameras import OPENCV_FROM_OPENGL, Camera
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from PIL import Image

from .closed_room import closed_room
from .filmed_scene import film, write_video
from .pose_error import PoseError, alignment, pose_error
from .traced_panoramas import exact_cameras, panorama, places
from .world_error import world_error

SCENE = Path(__file__).parents[2] / "scenes" / "demo_truth.xml"
WIDTH, HEIGHT, FRAMES, SHUTTER, SPP = 640, 480, 96, 3, 9
PANORAMA, PLACES = 1024, 24  # pixels across, panoramas


def main(argv: list[str]) -> None:
    """A row for each capture, and for the film."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks poses", description=__doc__)
    parser.add_argument("--data", type=Path, nargs="*", default=[], help="COLMAP folders whose poses are thrown away")
    parser.add_argument("--film", action="store_true", help="also a video made of scenes/demo_truth.xml")
    parser.add_argument("--panoramas", action="store_true", help="also panoramas of a furnished room")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for what is found and trained")
    parser.add_argument("--steps", type=int, default=2000, help="of the trainings; 0: none")
    parser.add_argument("--downscale", type=int, default=4)
    args = parser.parse_args(argv)
    set_variant("llvm_ad_rgb")
    for data in args.data:
        top = args.out / data.resolve().name
        exact = _cameras(data)
        shutil.copytree(data / "images", top / "images", dirs_exist_ok=True)
        print(_row(data.resolve().name, top / "images", exact, data, top, args), flush=True)
    if args.film:
        top = args.out / "film"
        exact = film_scene(top / "walk.mp4")
        print(_row("film", top / "walk.mp4", exact, None, top, args), flush=True)
    if args.panoramas:
        for name, source, exact in panoramas(args.out):
            posed = args.out / f"{name} posed"
            summary = find_poses(source, posed, PosesConfig(lens="EQUIRECTANGULAR"))
            print("\n".join(summary.lines()))
            row = _found(name, summary, pose_error(exact, _cameras(posed)))
            if args.steps:
                folders = {"given": _exact_panoramas(args.out / f"{name} exact", exact, posed), "found": posed}
                row += _trained(folders, args.out / f"{name} run", args.steps, 1)
            print(row, flush=True)


def _row(name: str, source: Path, exact: dict[str, Camera], data: Path | None, top: Path, args) -> str:
    summary = find_poses(source, top / "posed", PosesConfig())
    found = _cameras(top / "posed")
    error = pose_error(exact, found)
    if data is None:  # whose up is known
        world = world_error(exact, top / "posed")
        lengths = f"{world.one_mark:.2%} ({world.refused:.0%} of them refused), in two {world.two_marks:.2%}"
        print(f"{name}: up off by {world.up:.2f} deg; lengths by points marked in one image {lengths}")
    data = data or _exact_data(top, exact, found)
    print("\n".join(summary.lines()))
    row = _found(name, summary, error)
    if args.steps:
        row += _trained({"given": data, "found": top / "posed"}, top / "run", args.steps, args.downscale)
    return row


def _trained(folders: dict[str, Path], run: Path, steps: int, downscale: int) -> str:
    """Test PSNR of a training from each folder of data."""
    psnr = {}
    for which, data in folders.items():
        config = TrainConfig(data=str(data), steps=steps, downscale=downscale)
        psnr[which] = train(config, run.with_name(f"{run.name}_{which}"))["test"]["psnr"]
    return "; PSNR " + ", ".join(f"{which} {db:.2f} dB" for which, db in psnr.items())


def _found(name: str, summary: Summary, error: PoseError) -> str:
    return (
        f"{name}: {summary.n_registered} of {summary.n_images}; position {error.position:.2%} (largest "
        f"{error.largest_position:.2%}), angle {error.angle:.3f} deg, focal {error.focal:.4f}"
    )


def _cameras(data: Path) -> dict[str, Camera]:
    model = find_model(data)
    assert model
    return {source.name: source.camera for source in read_sources(model, data / "images")[0]}


def film_scene(path: Path) -> dict[str, Camera]:
    """Write the video unless it is there; the exact cameras by the names that its frames get.

    A hand-held walk around the table: the camera sways, the exposure adapts by a third, and a frame's shutter is open
    half of its time.
    """
    n, focal, cameras = 2 * SHUTTER * FRAMES, 0.85 * WIDTH, []
    for t in np.linspace(0, 1, n):
        angle = -1.85 + 1.9 * t
        sway = 0.05 * np.sin(2 * np.pi * np.array([5 * t, 7 * t + 0.2, 9 * t + 0.5]))
        position = np.array([5.2 * np.cos(angle), 5.2 * np.sin(angle), 2.4 + 0.8 * np.sin(3 * t)]) + sway
        w2c = look_at(position, np.array([0, 0, 0.35]) + sway[::-1], "z")
        cameras.append(Camera(w2c, focal, focal, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT))
    start = time.monotonic()
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        scene, _ = load_scene(SCENE, False)
        frames = film(scene, cameras, SHUTTER, SPP, lambda t: 1 - 0.33 * np.sin(np.pi * t) ** 2)
        write_video(path.with_suffix(".part.mp4"), (pixels for _, pixels in frames))
        path.with_suffix(".part.mp4").rename(path)
        print(f"filmed in {time.monotonic() - start:.0f} s")
    return {f"frame_{k:06d}": cameras[2 * SHUTTER * k + SHUTTER // 2] for k in range(FRAMES)}


def panoramas(top: Path) -> Iterator[tuple[str, Path, dict[str, Camera]]]:
    """(name, folder or video, exact cameras of its views) of panoramas of a room."""
    scene, folder, video = closed_room(), top / "panoramas", top / "walk360.mp4"
    folder.mkdir(parents=True, exist_ok=True)
    c2ws = places(PLACES)
    for k, c2w in enumerate(c2ws):
        Image.fromarray(panorama(scene, c2w, PANORAMA, SPP)).save(folder / f"IMG_{k}.png")
    yield "panoramas", folder, exact_cameras(c2ws, PANORAMA)
    walked = places(PLACES, 2)
    write_video(video, (panorama(scene, c2w, PANORAMA, SPP) for c2w in walked))
    exact = exact_cameras(walked, PANORAMA)
    yield "panorama video", video, {re.sub(r"IMG_(\d+)", _frame, name): camera for name, camera in exact.items()}


def _frame(numbered: re.Match) -> str:
    return f"frame_{int(numbered[1]):06d}"


def _exact_panoramas(out: Path, exact: dict[str, Camera], posed: Path) -> Path:
    """The same views in the same split with their exact poses, and the points that were found, moved there."""
    out.mkdir(exist_ok=True)
    dataset, move = load_colmap(posed, 1), alignment(exact, _cameras(posed))
    moved = replace(dataset, points=move.points(dataset.points).astype(np.float32))
    write_refined(out, moved, posed, {name: camera.w2c for name, camera in exact.items()})
    return out


def _exact_data(top: Path, exact: dict[str, Camera], found: dict[str, Camera]) -> Path:
    """The frames that were taken, with their exact cameras, and with the points that were found, moved there."""
    out, dataset = top / "exact", load_colmap(top / "posed", 1)
    shutil.copytree(top / "posed" / "images", out / "images", dirs_exist_ok=True)
    write_point_ply(out / "points.ply", alignment(exact, found).points(dataset.points), dataset.point_colors)
    frames = []
    for name in sorted(found):
        pose = (exact[name].c2w @ OPENCV_FROM_OPENGL).tolist()
        frames.append({"file_path": f"images/{name}.jpg", "transform_matrix": pose})
    with Image.open(out / "images" / f"{sorted(found)[0]}.jpg") as image:
        assert image.size == (WIDTH, HEIGHT)
    camera = intrinsics_of(next(iter(exact.values())))
    (out / "transforms.json").write_text(json.dumps(camera | {"ply_file_path": "points.ply", "frames": frames}))
    return out
