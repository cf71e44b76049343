"""Makes a data set out of a Mitsuba scene: exact cameras, their renders, and surface points to start from.

The folder holds ``capture.json`` (the settings, written first), ``images/*.png``, or ``*.exr`` with linear radiance,
``depth/`` if asked for, ``points.ply``, and last ``transforms.json``, which nerfstudio reads too. An interrupted
capture is no data set yet; the same command again goes on where it stopped, and gives the same files.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.cameras import OPENCV_FROM_OPENGL
from ..support.arguments import checks_arguments
from ..support.classes import require_class
from ..support.errors import DataError, Wrong
from ..support.files import remove_parts, replacing
from ..support.locks import locked
from ..support.pictures import write_exr, write_png, write_radiance
from ..support.resumable import begun
from ..support.scene_errors import scene_error
from ..support.srgb import displayed, luminance
from ..support.variants import require_arrays
from ..support.wording import counted
from .auto_exposure import white_of_lights
from .camera_paths import Shot, circling_shots
from .capture_config import PATHS, CaptureConfig
from .dataset import TEST_EVERY
from .frame_cameras import intrinsics_of
from .given_cameras import auto_up, listed_shots, sensor_shots
from .images import read_image
from .point_ply import write_point_ply
from .scene_digests import scene_digests, sha256
from .scene_file import framing_sphere, load_scene, shows_splats, warn_of_unseen_splats
from .shared_points import told_by_several
from .traced_view import as_srgb, depth_of, first_seen, render_shot

SETTINGS = "capture.json"
FREE = ("scene", "points")  # settings that may change from one start to the next, as no picture depends on them
BEFORE = {"hdr": False}  # what captures of earlier versions are, which do not note it
RESOLUTION = 1e-12  # of a coordinate: what is smaller there has no extent
POINTS_FACTOR = 4  # points kept of each view, times its share: views that see little are made up for


@dataclass(frozen=True, eq=False)
class Plan:
    """A capture before anything is rendered: of which file, its shots, the numbers of those for testing, and a line on
    how the scene is framed."""

    file: Path
    config: CaptureConfig
    scene: Any
    shots: list[Shot]
    tests: set[int]
    hidden_emitters: bool
    splats: bool  # whether the pictures show some
    framing: str


@checks_arguments
def capture(
    scene_path: str | Path,
    out: str | Path,
    config: CaptureConfig,
    progress: Callable[[int, int, str], None] = lambda done, n, framing: None,
) -> Path:
    """Render a scene into the data set ``out``, or what is missing there, and return the folder.

    The scene's own integrator renders all pictures. ``progress`` gets the number of finished views, that of all, and
    how the scene is framed; it is called before the first one too. A Mitsuba variant with a JIT compiler must be set.
    Raises ``DataError`` for a scene that cannot be loaded, shows nothing or renders to NaN, for cameras that are no
    pinholes, and for a folder with another capture or other contents.
    """
    import mitsuba as mi

    require_class("capture: how it is taken", config, CaptureConfig, "give a CaptureConfig")
    require_arrays()
    scene_path, out = Path(scene_path), Path(out)
    plan = _plan(scene_path, config)
    settings = _settings(scene_path, config)
    with begun(out / SETTINGS, settings, "capture", FREE, BEFORE), locked(out, "another capture is writing to it"):
        remove_parts(out)
        _fill(mi, plan, out, progress)
    return out


def _fill(mi: Any, plan: Plan, out: Path, progress: Callable[[int, int, str], None]) -> None:
    n, config = len(plan.shots), plan.config
    progress(0, n, plan.framing)
    for i, shot in enumerate(plan.shots):
        if not _is_done(out, shot, config):
            _capture_view(mi, plan, i, out)
        progress(i + 1, n, plan.framing)
    if config.points:
        _write_points(mi, plan, out)
    with replacing(out / "transforms.json") as part:
        part.write_text(json.dumps(_transforms(plan), indent=1) + "\n", encoding="utf-8")
    if not config.points:
        (out / "points.ply").unlink(missing_ok=True)


def _plan(scene_path: Path, config: CaptureConfig) -> Plan:
    scene, hidden = load_scene(scene_path, config.alpha)
    warn_of_unseen_splats(scene_path)
    if config.circling:
        shots, framing = _circling(scene_path, scene, config)
    elif config.path == "sensors":
        shots, framing = sensor_shots(scene_path, scene, config.downscale), counted(len(scene.sensors()), "sensor")
    else:
        box = scene.bbox()
        extent = float(np.linalg.norm(np.array(box.max, np.float64) - np.array(box.min, np.float64)))
        shots = listed_shots(Path(config.path), extent if 0 < extent < math.inf else 1.0, config.downscale)
        framing = f"cameras of {config.path}"
    tests, splats = _tests(config, len(shots)), shows_splats(scene_path)
    return Plan(scene_path, config, scene, shots, tests, hidden, splats, framing)


def _circling(scene_path: Path, scene: Any, config: CaptureConfig) -> tuple[list[Shot], str]:
    """The shots of an orbit or hemisphere, and a line on how they frame the scene. Raises ``DataError``."""
    up = auto_up(scene) if config.up == "auto" else config.up
    if config.center and config.radius:
        center, radius, n_left_out = np.array(config.center), config.radius, 0
    else:
        center, radius, n_left_out = framing_sphere(scene_path, scene)
    center = np.array(config.center or center, dtype=np.float64)  # [3]
    radius = config.radius or radius
    if not radius > RESOLUTION * abs(center).max():
        place = " ".join(f"{x:g}" for x in center)
        problem = f"the centre {place} is too far from the origin for cameras around a radius of {radius:g}"
        raise DataError(scene_path, problem, "use a larger --radius, or a --center that is nearer to the origin")
    n_test = config.views // 6 if config.test is None else config.test
    framing = f"centre {' '.join(f'{x:.3g}' for x in center)}, radius {radius:.3g}, up {up}"
    framing += f", without {n_left_out} much larger shapes around it" if n_left_out else ""
    return circling_shots(config, config.views + n_test, center, radius, up), framing


def _tests(config: CaptureConfig, n: int) -> set[int]:
    """Which of ``n`` views are for testing. Raises ``DataError`` where none would be left for training."""
    if config.test is None and not config.circling:
        return set(range(0, n, TEST_EVERY)) if n > 1 else set()
    n_test = n - config.views if config.circling else config.test or 0
    if n_test >= n:
        raise DataError("--test", f"no training view is left of {counted(n, 'view')}", "use a smaller number")
    return {int((k + 0.5) * n / n_test) for k in range(n_test)}


def _settings(scene_path: Path, config: CaptureConfig) -> dict[str, Any]:
    """What decides on the pictures: the flags, and the contents of the scene's file, of those that it includes or
    names, and of the list of cameras."""
    digests = scene_digests(scene_path)
    if config.path not in PATHS:
        digests["cameras_sha256"] = sha256(Path(config.path))
    return json.loads(json.dumps({"scene": str(scene_path), **digests, **dataclasses.asdict(config)}))


def _image_name(shot: Shot, config: CaptureConfig) -> str:
    return f"images/{shot.name}.{'exr' if config.hdr else 'png'}"


def _is_done(out: Path, shot: Shot, config: CaptureConfig) -> bool:
    """Whether the picture of a view is there, whole and of its size, and so is its depth."""
    if config.depth != "none" and not (out / _depth_name(shot, config)).is_file():
        return False
    image = out / _image_name(shot, config)
    if not image.is_file():  # OpenEXR would print a line about it
        return False
    try:
        return read_image(image).shape[:2] == (shot.camera.height, shot.camera.width)
    except DataError:
        return False


def _capture_view(mi: Any, plan: Plan, i: int, out: Path) -> None:
    """Write depth and picture of view ``i``."""
    shot, config = plan.shots[i], plan.config
    try:
        image = render_shot(mi, plan.scene, shot, config.spp, config.seed * len(plan.shots) + i, config.alpha)
    except Wrong as error:
        raise DataError(plan.file, f"view {shot.name} {error.problem}", error.remedy) from error
    except RuntimeError as error:
        raise scene_error(plan.file, error, f"Mitsuba cannot render view {shot.name}") from error
    if config.depth != "none":
        depth = depth_of(shot, *first_seen(mi, plan.scene, shot, plan.hidden_emitters, plan.splats))  # [H, W]
        path = out / _depth_name(shot, config)
        if config.depth == "exr":
            write_exr(path, {"depth": depth})
        else:
            with replacing(path) as part, part.open("wb") as file:
                np.save(file, depth)
    if config.hdr:
        write_radiance(out / _image_name(shot, config), image)
    else:
        write_png(out / _image_name(shot, config), as_srgb(image))


def _depth_name(shot: Shot, config: CaptureConfig) -> str:
    return f"depth/{shot.name}.{config.depth}"


def _write_points(mi: Any, plan: Plan, out: Path) -> None:
    """Write ``points.ply``: what random pixels of the training views see, in the colours of their pictures.

    Of linear pictures they are what a screen shows of them.
    """
    config, train = plan.config, [i for i in range(len(plan.shots)) if i not in plan.tests]
    most = POINTS_FACTOR * math.ceil(config.points / len(train))
    points, colors = [], []
    for i in train:
        shot = plan.shots[i]
        positions, found = first_seen(mi, plan.scene, shot, plan.hidden_emitters, plan.splats)  # [H, W, 3], [H, W]
        pixels = np.argwhere(found)  # [P, 2] row, column
        pixels = np.random.default_rng([config.seed, i]).permutation(pixels)[:most]
        image = read_image(out / _image_name(shot, config))  # [H, W, 3 or 4] premultiplied
        shown = image[pixels[:, 0], pixels[:, 1]]  # [P, 3 or 4]
        points.append(positions[pixels[:, 0], pixels[:, 1]])
        colors.append(shown[:, :3] / np.maximum(shown[:, 3:], 1e-3) if config.alpha else shown)
    all_points, all_colors = np.concatenate(points), np.concatenate(colors)
    if not len(all_points):
        raise DataError(plan.file, "no camera sees anything opaque", "check where the cameras stand, or use --points 0")
    told = told_by_several(all_points, [plan.shots[i].camera for i in train])
    all_points, all_colors = all_points[told], all_colors[told]
    kept = np.random.default_rng(config.seed).permutation(len(all_points))[: config.points]
    if config.hdr:
        all_colors = displayed(all_colors, white_of_lights(luminance(all_colors)))
    write_point_ply(out / "points.ply", all_points[kept], all_colors[kept])


def _transforms(plan: Plan) -> dict[str, Any]:
    """Content of ``transforms.json``: OpenGL camera-to-world poses, the split by file names as nerfstudio has it."""
    config, intrinsics = plan.config, [intrinsics_of(shot.camera) for shot in plan.shots]
    shared = intrinsics[0] if all(entry == intrinsics[0] for entry in intrinsics) else {}
    frames = []
    for shot, own in zip(plan.shots, intrinsics, strict=True):
        pose = (shot.camera.c2w @ OPENCV_FROM_OPENGL).tolist()
        depth = {} if config.depth == "none" else {"depth_file_path": _depth_name(shot, config)}
        files = {"file_path": _image_name(shot, config), **depth}
        frames.append({**files, **({} if shared else own), "transform_matrix": pose})
    train = [frame["file_path"] for i, frame in enumerate(frames) if i not in plan.tests]
    test = [frame["file_path"] for i, frame in enumerate(frames) if i in plan.tests]
    points = {"ply_file_path": "points.ply"} if config.points else {}
    split = {"train_filenames": train, "val_filenames": test, "test_filenames": test} if test else {}
    return {"camera_model": "PINHOLE", **shared, **points, **split, "frames": frames}
