"""The camera of an OpenUSD stage, for ``dogsplat film --path shot.usd``: as Houdini, Maya, Blender and others save it.

A camera of OpenUSD looks along its -z, its y is up. Its lens is a focal length over the width and height of an aperture
in the same unit, from the middle of which the principal point may be off (``GfCamera``). Between samples the library
interpolates, as all programs that use it.
"""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from __future__ import annotations

import math
import re
import stat
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..formats.model import Model
from ..formats.packing import RUB
from ..formats.placed import placing
from ..formats.usd_files import NAMES
from ..formats.usd_read import place_of
from ..formats.usd_stage import looked_at, metres_of, missing, moments_of, opened, upright
from ..scene.cameras import affine
from ..scene.transform import decompose_similarity
from ..support.errors import DataError
from .camera_path import LEAST_FPS, MOST_FPS, CameraPath, Lens, focal_of_fov
from .usd_render_settings import picture_size, settings_camera, shorter_side

if TYPE_CHECKING:
    from pxr import Gf, Usd

GIVEN = re.compile(rf"(.+(?:{'|'.join(re.escape(name) for name in NAMES)}))(?::(/.*))?", re.IGNORECASE)
RDF = np.diag([*RUB[0], 1.0])  # the half turn between x right, y up, z back and x right, y down, z forward
SMALLEST = 1e-9  # of what a camera's matrix may make of a length
MOST_NAMES = 5  # of cameras in a line


def is_usd_path(text: str) -> bool:
    """Whether ``--path`` names a stage, or a camera in it: ``shot.usd``, ``shot.usd:/Set/Camera``."""
    return GIVEN.fullmatch(text) is not None


def usd_path(text: str, model: Model | None, fov: float | None) -> CameraPath:
    """The way of a camera of a stage, for as long as that takes.

    Args:
        text: the file; after a colon the path of its camera, where it has several.
        model: what is filmed. Where the stage shows it, and no other Gaussians, the camera is where it is beside it;
            else the stage is a place in which the model stands upright and in metres, as it says. None: a scene, which
            has the coordinates of the stage.
        fov: of the shorter side, in place of what the camera says, in degrees.

    Raises ``DataError``.
    """
    found = GIVEN.fullmatch(text)
    assert found
    path, name = Path(found[1]), found[2]
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "check the path and its permissions") from error
    if not regular:  # opening a pipe would wait for ever
        raise DataError(path, "is not a regular file", "give the path of an OpenUSD stage")
    with opened(path) as stage:
        return _path(path, stage, _camera(path, stage, name), model, fov)


def _path(path: Path, stage: Usd.Stage, prim: Usd.Prim, model: Model | None, fov: float | None) -> CameraPath:
    from pxr import UsdGeom

    to_model_at, name = _to_model(path, stage, model), prim.GetPath()
    start, end = _time(stage, prim)
    seconds = (end - start) / _rate(path, stage)

    def seen(time: float) -> Gf.Camera:
        camera = UsdGeom.Camera(stage.GetPrimAtPath(name))  # a prim alone does not keep its stage
        projection = camera.GetProjectionAttr().Get(time)
        if projection != UsdGeom.Tokens.perspective:
            raise DataError(path, f"the camera {name} is {projection}", "name one with a perspective")
        lens = camera.GetCamera(time)
        sides = (lens.horizontalAperture, lens.verticalAperture, lens.focalLength)
        offsets = (lens.horizontalApertureOffset, lens.verticalApertureOffset)
        if not (np.isfinite([*sides, *offsets]).all() and min(sides) > 0):
            raise DataError(path, f"the camera {name} has no lens", "give it a focal length and an aperture")
        return lens

    def at(share: float) -> Lens:
        time = start + share * (end - start)
        with looked_at(path):  # it is asked for frames when the stage was opened long ago
            lens, to_model = seen(time), to_model_at(time)
            side = shorter_side(stage, name, lens, size)
        offset = (-lens.horizontalApertureOffset / side, lens.verticalApertureOffset / side)
        c2w = to_model @ np.array(lens.transform).T @ RDF
        focal = lens.focalLength / side if fov is None else focal_of_fov(fov)
        return Lens(affine(_rotation(path, f"the camera {name}", c2w[:3, :3]), c2w[:3, 3]), focal, offset)

    size = picture_size(stage, name, seen(start))
    for share in (0.0, 1.0):
        at(share)  # what is wrong with it is said before a film begins
    return CameraPath(at, False, f"camera {name} of {path.name}", seconds or None, size, _fps(stage))


def _camera(path: Path, stage: Usd.Stage, name: str | None) -> Usd.Prim:
    """The camera of this name, or the one that there is."""
    from pxr import Usd, UsdGeom

    prims = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
    cameras = {str(prim.GetPath()): prim for prim in prims if prim.IsA(UsdGeom.Camera)}
    why = "".join(f" ({line})" for line in missing(stage))
    if not cameras:
        raise DataError(path, f"has no camera{why}", "export the camera of the scene with it")
    known = ", ".join([*cameras][:MOST_NAMES]) + (", ..." if len(cameras) > MOST_NAMES else "")
    if name is not None and name not in cameras:
        raise DataError(path, f"has no camera {name}{why}", f"name one of its own: {known}")
    if name is None and len(cameras) > 1:
        name = next((str(target) for target in settings_camera(stage) if str(target) in cameras), None)
    if name is None and len(cameras) > 1:
        raise DataError(path, f"has several cameras: {known}", f"name one: --path {path}:{next(iter(cameras))}")
    return cameras[name or next(iter(cameras))]


def _time(stage: Usd.Stage, prim: Usd.Prim) -> tuple[float, float]:
    """The first and the last time code: those of the stage, where it has more than one frame, else those between which
    the camera changes."""
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if stage.HasAuthoredTimeCodeRange() and -math.inf < first < last < math.inf:
        return first, last
    times = {time for attribute in prim.GetAuthoredAttributes() for time in attribute.GetTimeSamples()}
    times |= moments_of(prim)
    return (min(times), max(times)) if times else (0.0, 0.0)


def _rate(path: Path, stage: Usd.Stage) -> float:
    """Time codes of a second."""
    rate = stage.GetTimeCodesPerSecond()
    if not 0 < rate < math.inf:
        raise DataError(path, f"its timeCodesPerSecond is {rate:g}", "give it a number above zero, such as 24")
    return rate


def _fps(stage: Usd.Stage) -> int | None:
    """Frames in a second, where a stage says a number of them that is whole."""
    layer = stage.GetRootLayer()
    rate = layer.framesPerSecond if layer.HasFramesPerSecond() else stage.GetTimeCodesPerSecond()
    return int(rate) if rate in range(LEAST_FPS, MOST_FPS + 1) else None


def _to_model(path: Path, stage: Usd.Stage, model: Model | None) -> Callable[[float], np.ndarray]:
    """The matrix [4, 4], at a time code, from the coordinates of a stage to the numbers of a model."""
    found = None if model is None else place_of(stage, model.splats.means * np.array(RUB[0], np.float32))
    if found is None:
        fixed = np.eye(4)
        if model is not None:
            metres = np.diag([*[metres_of(stage) or 1.0] * 3, 1.0])
            fixed = RDF @ np.linalg.inv(placing(model.drawing, RUB)) @ metres @ upright(stage)
        return lambda _: fixed

    place, moments = found
    if not all(_keeps_shapes(place(time)) for time in moments):  # no camera sees the file itself so
        remedy = f"film what it shows: dogsplat film {path} --path {path}"
        raise DataError(path, "stretches or mirrors the model", remedy)

    def to_model(time: float) -> np.ndarray:
        matrix = place(time)  # half-way between two turns the mean of their matrices is none
        linear = matrix[:3, :3]
        turned = np.linalg.norm(linear, "nuc") / 3 * _rotation(path, "the model", linear)
        return RDF @ np.linalg.inv(affine(turned, matrix[:3, 3])) @ upright(stage)

    return to_model


def _keeps_shapes(matrix: np.ndarray) -> bool:
    """Whether a matrix [4, 4] only turns, moves and scales."""
    try:
        isometry, _, _ = decompose_similarity(matrix)
    except ValueError:
        return False
    return bool(np.linalg.det(isometry) > 0)


def _rotation(path: Path, what: str, matrix: np.ndarray) -> np.ndarray:
    """The rotation [3, 3] that is nearest to the matrix of something; a mirrored camera goes without its mirror."""
    left, lengths, right = np.linalg.svd(matrix) if np.isfinite(matrix).all() else (matrix, np.zeros(3), matrix)
    if lengths.min() < SMALLEST:
        raise DataError(path, f"{what} is flat", "give it, and its parents, another scale")
    rotation = left @ right
    return rotation @ np.diag([np.sign(np.linalg.det(rotation)), 1.0, 1.0])
