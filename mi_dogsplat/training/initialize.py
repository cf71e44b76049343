"""Where training starts: at a model, at the points of structure from motion, or where cameras look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from ..datasets import Dataset
from ..formats.model import Model
from ..formats.read import read_model
from ..formats.sizes import FileKind
from ..scene.cameras import Camera, spread_of
from ..scene.radiance import brightened
from ..scene.sh_basis import C0
from ..scene.splats import Splats
from ..scene.whole import whole
from ..support.errors import DataError
from ..support.srgb import srgb_to_linear
from ..support.wording import counted, file_size
from .config import TrainConfig
from .point_radiance import point_radiance
from .strategy.scheduler import target_count
from .target import target_bytes

INITIAL_OPACITY = 0.1
NEIGHBOURS = 3
MIN_SQUARED_DISTANCE = 1e-7  # world units squared, the recipe's floor for coincident points
MIN_SHARE = 0.01  # of the median squared distance: the floor where units are so small that it is below
MAX_CAMERAS = 32  # that vote on where random primitives go


def splats_from_points(points: np.ndarray, colors: np.ndarray, sh_degree: int) -> Splats:
    """Isotropic primitives as large as the distance to their neighbours (Kerbl et al. 2023, Sec. 5.1).

    Args:
        points: [P, 3] world space; points that are not finite are left out.
        colors: [P, 3] as the model is to have them: display-referred, 0..1, or linear.
        sh_degree: 0..3; the view-dependent part starts at zero.

    scale = sqrt(mean squared distance to the 3 nearest neighbours, or as many as there are), 1 for a lone
    point, with a floor for points that coincide; opacity 0.1. Raises ``ValueError`` unless there is one colour
    per point.
    """
    points, colors = np.asarray(points, np.float64), np.asarray(colors, np.float64)
    if points.shape != (len(points), 3) or colors.shape != points.shape:
        shapes = f"points {points.shape} and colors {colors.shape}"
        raise ValueError(f"splats_from_points: {shapes}; both need shape [P, 3]")
    finite = np.isfinite(points).all(1) & np.isfinite(colors).all(1)
    points, colors = points[finite], colors[finite]
    n, scales = len(points), _scales(points)
    sh_coeffs = np.zeros((n, (sh_degree + 1) ** 2, 3))
    sh_coeffs[:, 0] = (colors - 0.5) / C0
    return Splats(
        means=points,
        log_scales=np.log(scales)[:, None].repeat(3, axis=1),
        quats=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        logit_opacities=np.full(n, np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY))),
        sh_coeffs=sh_coeffs,
    )


def _scales(points: np.ndarray) -> np.ndarray:
    """[P] as ``splats_from_points`` has them."""
    if len(points) < 2:
        return np.full(len(points), 1.0)
    squared = np.mean(_neighbour_distances(points) ** 2, axis=1)  # [P]
    least = MIN_SHARE * float(np.median(squared)) or MIN_SQUARED_DISTANCE
    return np.sqrt(np.maximum(squared, min(least, MIN_SQUARED_DISTANCE)))


def _neighbour_distances(points: np.ndarray) -> np.ndarray:
    """[P, <= 3] distances of each of P >= 2 points to its nearest others.

    A tree cannot tell coincident points apart, and would look at all of them for each: it has every place once.
    """
    places, place, counts = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    k = min(NEIGHBOURS + 1, len(places))
    distances, nearest = (found.reshape(-1, k) for found in cKDTree(places).query(places, k=k))  # the first is itself
    others = np.cumsum(counts[nearest], axis=1) - 1  # [places, k] how many other points are there, and nearer
    slots = range(1, min(NEIGHBOURS, len(points) - 1) + 1)
    which = np.stack([(others < slot).sum(axis=1) for slot in slots], axis=1)  # place of the first neighbour and so on
    return np.take_along_axis(distances, which, axis=1)[place.reshape(-1)]


def region_of_interest(cameras: Sequence[Camera]) -> tuple[np.ndarray, float]:
    """(centre [3], half side) of the cube that the cameras look at.

    Where the optical axes meet in front of most cameras (least squares), the cube reaches as far as the
    median camera sees across at that distance. Where they do not (parallel axes, a look-around, cameras at one place)
    nothing tells the depth: the cube begins at the cameras and is six times as deep as their spread, or as 1.
    """
    spread = spread_of(cameras)
    directions = np.array([camera.w2c[2, :3] for camera in cameras])  # [V, 3]
    positions = np.array([camera.position for camera in cameras])  # [V, 3]
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # [V, 3, 3]
    A = across.mean(0)
    if spread and np.linalg.eigvalsh(A)[0] > 1e-3:  # 0 for parallel axes; about the mean squared sine of their angles
        centre = np.linalg.solve(A, np.einsum("vij,vj->i", across, positions) / len(cameras))
        depths = np.einsum("vi,vi->v", centre - positions, directions)
        if np.mean(depths > 0) > 0.5:
            tangents = [max(camera.width / camera.fx, camera.height / camera.fy) / 2 for camera in cameras]
            return centre, float(np.median(depths[depths > 0]) * np.median(tangents))
    mean = positions.mean(0)
    spread = spread or 1.0
    return mean + 3 * spread * directions.mean(0), 3 * spread


def random_splats(
    cameras: Sequence[Camera], count: int, rng: np.random.Generator, sh_degree: int, linear: bool = False
) -> Splats:
    """``count`` primitives where cameras look, in colours near grey, display-referred or ``linear``.

    Of candidates spread evenly over the ``region_of_interest`` those are kept that at least half as many
    cameras see as see the best candidate; if they are too few, the next best seen ones are taken too.
    """
    centre, half = region_of_interest(cameras)
    candidates = centre + half * rng.uniform(-1, 1, (8 * count, 3))
    votes = _times_seen(candidates, cameras, 0.01 * half)
    capped = np.minimum(votes, (votes.max(initial=0) + 1) // 2)
    chosen = candidates[np.argsort(-capped, kind="stable")[:count]]  # equal votes keep their random order
    colors = rng.uniform(0.4, 0.6, (count, 3))
    return splats_from_points(chosen, srgb_to_linear(colors) if linear else colors, sh_degree)


def _times_seen(points: np.ndarray, cameras: Sequence[Camera], nearest: float) -> np.ndarray:
    """[P] how many cameras, of some of them, see a point, beyond a depth."""
    votes = np.zeros(len(points), int)
    for i in np.unique(np.linspace(0, len(cameras) - 1, MAX_CAMERAS).astype(int)):
        camera = cameras[i]
        pixels, depth = camera.project(points)
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(1)
        votes += inside & (depth > nearest)
    return votes


def model_to_prune(path: str, target: float | str, format: str = "ply") -> Model:
    """Read a model of any format. Raises ``DataError`` if it cannot be read, or cannot be pruned to ``target``.

    Args:
        path: of the model.
        target: as in ``TrainConfig``.
        format: of the file that a size is of.

    Quaternions are brought to length 1, which changes no picture: a training step of one turns by step / length.
    """
    model = read_model(path)
    splats = model.splats
    if format != "ply":
        # no other format holds the rest; training makes up for it
        splats = whole(splats.plain()).without_slopes().without_shifts()
    if splats.n_splats < 2:
        raise DataError(path, f"holds {counted(splats.n_splats, 'primitive')}", "pruning needs at least 2")
    try:
        _require_less(target, splats, format)
    except ValueError as error:
        raise DataError("--target", str(error), f"choose another one for {path}") from None
    return replace(model, splats=replace(splats, quats=_unit_quats(splats.quats)))


def _require_less(target: float | str, splats: Splats, format: str) -> None:
    """Raise ``ValueError`` unless the target is less than what there is, in primitives or in bytes."""
    most = target_bytes(target)
    if most is None:
        target_count(float(target), splats.n_splats)
        return
    kind = FileKind(format)
    size = kind.size(kind.foreseen(splats))
    if size <= most:
        raise ValueError(f"{target} is not below the {file_size(size)} that the model takes as {format}")


def _unit_quats(quats: np.ndarray) -> np.ndarray:
    """[N, 4] of length 1, where they have a length."""
    length = np.linalg.norm(quats.astype(np.float64), axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    return np.where(usable, quats / np.where(usable, length, 1), quats)


def _require_same_colors(path: str, model: Model, linear: bool) -> None:
    """Raise ``DataError`` unless the colours of a model are of the kind of the images, linear or display-referred."""
    kinds = "display-referred sRGB", "linear radiance"
    if bool(model.drawing.linear) != linear:
        problem = f"its colours are {kinds[not linear]}, the images are {kinds[linear]}"
        raise DataError(path, problem, "use images of its own kind: PNG or JPEG for sRGB, OpenEXR for linear")


def initial_splats(config: TrainConfig, dataset: Dataset, limit: int | None, model: Model | None = None) -> Splats:
    """The model to prune, else the points of the data set, else random in the region that the cameras see.

    Of linear images the colours are linear too, in units of white. Of points and random primitives there are ``limit``
    at most. ``model``: the ``model_to_prune``, where it has been read.
    """
    linear = dataset.white is not None
    if config.model is not None:
        model = model or model_to_prune(config.model, config.target, config.format)
        _require_same_colors(config.model, model, linear)
        return model.splats if dataset.white is None else brightened(model.splats, 1 / dataset.white)
    if len(dataset.points):
        return _splats_of_points(config, dataset, limit)
    count = min(config.initial_primitives, limit or config.initial_primitives)
    rng = np.random.default_rng(config.seed)
    return random_splats([view.camera for view in dataset.train], count, rng, config.sh_degree, linear)


def _splats_of_points(config: TrainConfig, dataset: Dataset, limit: int | None) -> Splats:
    colors = dataset.point_colors if dataset.white is None else point_radiance(dataset)
    splats = splats_from_points(dataset.points, colors, config.sh_degree)
    if limit is None or splats.n_splats <= limit:
        return splats
    keep = np.random.default_rng(config.seed).permutation(splats.n_splats)[:limit]
    return splats.select(np.sort(keep))
