"""``dogsplat info``: what a file or folder is, in a few lines, and what is wrong with it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..formats.read import format_of, is_model_name, is_sog_meta, read_model, size_of
from ..formats.sizes import FileKind, by_part
from ..formats.sog_read import META
from ..poses.config import SETTINGS as POSES
from ..render.framing import CORE, robust_sphere
from ..report.run_folder import CONFIG, HISTORY, METRICS, MODEL, POSED, read_run
from ..scene.drawing import DrawnAs
from ..scene.kinds import COUNTED, kinds, kinds_of
from ..scene.splats import Splats
from ..support.errors import DataError
from ..support.wording import count, counted, duration, file_size, finite, fixed, printable
from ..training.config import FREE, TrainConfig
from .lines import drawn, line, problem_lines, sh_degrees

if TYPE_CHECKING:
    from ..datasets import Dataset

ACCEPTED = (
    "give a model (.ply .spz .sog .glb .gltf .splat), a run folder, or a data set: a COLMAP folder, a folder with "
    "transforms.json or transforms_train.json, or a Mitsuba scene .xml"
)
DATA_FILES = (".xml", ".json")
RUN_FILES = (CONFIG, HISTORY, METRICS)
SETTINGS = ("preset", "downscale", "max_primitives", "seed")  # of a run that are always told
# told elsewhere, of the preset, or of no matter for the result
UNTOLD = ("data", "steps", "max_world_scale", "variant", "log_every", "test_every", *FREE)
NAMES_SHOWN = 4  # of views, and of sizes
SCENE_SPP = 4  # enough to see that the sensors of a Mitsuba scene see something

UNIT_TOLERANCE = 1e-2  # of a quaternion's length
TINY, HUGE = 1e-6, 1.0  # scales, in units of the model's robust radius
INVISIBLE = 1 / 255  # opacity; a primitive below it never changes an 8-bit pixel by itself
FAR = 100.0  # robust radii from the centre


def describe(path: str | Path) -> list[str]:
    """Printable lines about a model, a run folder, a scene or a data set. Raises ``DataError`` for all else and what is
    broken.

    A Mitsuba scene needs a variant to be set; one without splats is a data set, whose sensors are rendered.
    """
    path = Path(path)
    kind = kind_of(path)
    if kind == "data" and path.suffix == ".xml":
        from ..datasets.scene_file import has_splats  # here: see ``_is_dataset``
        from .scene import describe_scene  # of the active variant

        if has_splats(path):
            return [printable(text) for text in describe_scene(path)]
    described = {"model": describe_model, "run": describe_run, "data": describe_dataset}[kind](path)
    return [printable(text) for text in described]


def kind_of(path: Path) -> str:
    """``model``, ``run`` or ``data``, by names, or by the first bytes where these say nothing. Raises ``DataError``."""
    if not path.exists():
        raise DataError(path, "no such file or folder", ACCEPTED)
    if path.is_file() and (is_model_name(path) or _begins_as_model(path)):
        return "model"
    if path.is_dir() and any((path / name).is_file() for name in RUN_FILES):
        return "run"
    if path.suffix in DATA_FILES if path.is_file() else _is_dataset(path):
        return "data"
    raise _unknown(path)


def _begins_as_model(path: Path) -> bool:
    if path.suffix in DATA_FILES:
        return False
    try:
        return bool(format_of(path))
    except (DataError, OSError):
        return False


def _unknown(path: Path) -> DataError:
    from ..poses.input import needs_poses, require_input  # here: see ``_is_dataset``

    meta = path / META
    if meta.is_file() and is_sog_meta(meta):  # whose pictures are no photographs
        return DataError(path, "this is a folder", f"give the model in it: {meta}")
    if (path / POSED / POSES).is_file():
        return DataError(path, "is a run that has not begun to train", "the same dogsplat train goes on with it")
    if needs_poses(path):
        require_input(path)
        remedy = "dogsplat poses makes a data set of it; dogsplat train does that by itself"
        return DataError(path, "has no cameras yet", remedy)
    return DataError(path, "not something dogsplat knows", ACCEPTED)


def _is_dataset(folder: Path) -> bool:
    from ..datasets.colmap import find_model  # here: data sets need the extra "train", models and runs do not
    from ..datasets.numbered_models import numbered_models
    from ..datasets.transforms import find_transforms

    return bool(find_model(folder) or find_transforms(folder) or numbered_models(folder))  # of these the reader tells


def describe_model(path: Path) -> list[str]:
    """Counts, ranges and problems of a model."""
    model = read_model(path)
    splats = model.splats
    size = size_of(path)
    n, m = splats.n_splats, splats.n_dog
    lines = [
        f"{path}: model",
        line("format", format_of(path).name),
        line("primitives", f"{count(n)}, {kinds_of(splats)}"),
        line("SH degree", sh_degrees(splats)),
        line("size", file_size(size) + (f", {size / n:.0f} bytes per primitive" if n else "")),
    ]
    if splats.mixed_sh:
        parts = (f"{name} {file_size(part)}" for name, part in by_part(FileKind("ply", model.drawing), splats).items())
        lines.append(line("bytes of", ", ".join(parts)))
    lines += [line("drawn", drawn(model.drawing))] if model.drawing.said() else []
    lines += [line("not read", text) for text in model.left_out]
    if n:
        centre, radius = robust_sphere(splats)
        lines.append(line("centre, radius", f"({_numbers(centre)}), {radius:.4g}: the median; {CORE:.0%} lie within"))
        lines += [line(f"position {axis}", _range(splats.means[:, i])) for i, axis in enumerate("xyz")]
        lines += [line("scale", _range(splats.scales)), line("opacity", _range(splats.opacities))]
    if m:
        lines += [
            line("DoG opacity", _range(splats.dog_opacities)),
            line("DoG scale", _range(splats.dog_scales)),
        ]
    lines += [line("slopes", _range(splats.color_slopes))] if splats.n_slopes else []
    lines += [line("curvatures", _range(splats.brightness_curvatures))] if splats.n_curvatures else []
    lines += [line("cut normals", _range(np.linalg.norm(splats.cut_normals, axis=1)))] if splats.n_cuts else []
    lengths = np.linalg.norm(splats.second_cut_normals, axis=1)
    lines += [line("second normals", _range(lengths))] if len(lengths) else []
    lines += [line("shifts", _range(splats.view_shifts))] if splats.n_shifts else []
    return lines + problem_lines(model_problems(splats))


def model_problems(splats: Splats) -> list[str]:
    """One sentence per kind of primitive that is broken, wasted, or shown otherwise by other programs."""
    if splats.n_splats == 0:
        return ["there is no primitive: every picture of this model is empty"]
    centre, radius = robust_sphere(splats)
    lengths = np.linalg.norm(splats.quats.astype(np.float64), axis=1)  # [N]
    scales = splats.scales  # [N, 3]
    distances = np.linalg.norm(splats.means - centre, axis=1)  # [N]
    kinds = [
        (lengths == 0, "a quaternion of length zero, so no orientation"),
        (
            (abs(lengths - 1) > UNIT_TOLERANCE) & (lengths > 0),
            "a quaternion that is not of unit length: harmless here, but some programs do not normalise",
        ),
        (scales.min(axis=1) < TINY * radius, f"a scale below {TINY * radius:.2g}, a millionth of the radius"),
        (scales.max(axis=1) > HUGE * radius, f"a scale above {HUGE * radius:.2g}, the radius of the model"),
        (splats.opacities < INVISIBLE, "an opacity below 1/255: they cost time and are hardly seen"),
        (distances > FAR * radius, f"a position more than {FAR:.0f} radii from the centre"),
    ]
    found = ((int(np.sum(which)), text) for which, text in kinds)
    return [f"{count(k)} of {count(splats.n_splats)} have {text}" for k, text in found if k]


def describe_run(path: Path) -> list[str]:
    """Settings, result and completeness of a run folder."""
    run = read_run(path)
    metrics: dict[str, Any] = run.metrics or {}
    last = run.history[-1] if run.history else {}
    lines = [f"{path}: training run on {run.config.get('data', 'unknown data')}"]
    planned = finite(run.config.get("steps"))
    done = metrics.get("steps", last.get("step"))
    lines.append(line("steps", count(done) + (f" of {count(planned)}" if planned else "")))
    seconds = metrics.get("train_seconds", last.get("seconds"))
    lines.append(line("training time", duration(seconds)))
    n, *of_them = (metrics.get(name, last.get(name)) for name in ("n", *COUNTED))
    lines.append(line("primitives", f"{count(n)}, {kinds(dict(zip(COUNTED, of_them, strict=True)))}"))
    if metrics:
        lines.append(line("model", file_size(metrics.get("bytes"))))
        lines.append(line("render time", f"{fixed(metrics.get('render_ms'), 1)} ms"))
        splits = {"test": run.measured, "train": "train"}  # by their names in the file: what they are
        lines += [line(views, _quality(metrics[name])) for name, views in splits.items() if metrics.get(name)]
    if settings := _settings(run.config):
        lines.append(line("settings", ", ".join(settings)))
    problems = [f"{name} is missing" for name in (*RUN_FILES, MODEL) if not (path / name).is_file()]
    if run.metrics is None:
        problems.append("the run is not complete: it was interrupted, or is still running")
    if run.broken_rows:
        problems.append(f"{HISTORY} has {counted(run.broken_rows, 'line')} of something else than JSON")
    return lines + problem_lines(problems)


def _settings(config: dict[str, Any]) -> list[str]:
    """Those of ``SETTINGS``, and all others that are not as they usually are and bear on the result."""
    usual = {field.name: field.default for field in fields(TrainConfig) if field.name not in UNTOLD}
    if config.get("near_clip") == DrawnAs().near_clip:  # a run writes it down where nobody has said anything, too
        usual["near_clip"] = config["near_clip"]
    told = [name for name in config if name in SETTINGS or (name in usual and config[name] != usual[name])]
    return [name if config[name] is True else f"{name} {_whole(config[name])}" for name in told]


def _whole(value: Any) -> Any:
    """The same, but 10000 for 10000.0."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def describe_dataset(path: Path) -> list[str]:
    """Views, split, points, and whether cameras and points agree."""
    from ..datasets import check_cameras, load_dataset  # here: see ``_is_dataset``
    from ..datasets.far_origin import far_from_origin
    from ..datasets.numbered_models import other_models
    from ..datasets.transforms import not_read

    dataset = load_dataset(path, spp=SCENE_SPP, on_disk=True)
    check = check_cameras(dataset)
    lines = [
        f"{path}: data set",
        line("views", f"{len(dataset.train)} for training, {len(dataset.test)} for testing"),
        line("images", _sizes(dataset) + (", with alpha" if dataset.has_alpha else "")),
        line("names", _some([view.name for view in dataset.views])),
        line(
            "points",
            count(check.n_points) if check.n_points else "none: training starts from random primitives",
        ),
    ]
    if check.seen is not None:
        images = "at least two images" if len(dataset.views) > 1 else "the image"
        lines.append(line("cameras", f"{check.seen:.0%} of the points are inside {images}"))
    if check.color_difference is not None:
        lines.append(line("colours", f"points and their pixels differ by {check.color_difference:.3f} (median)"))
    if check.reprojection_px is not None:
        lines.append(line("reprojection", f"{check.reprojection_px:.2f} px (median) at full size"))
    lines += [line("origin", text) for text in far_from_origin(path)]
    return lines + [line("not read", text) for text in (*other_models(path), *not_read(path))]


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _range(values: np.ndarray) -> str:
    return f"{values.min():.4g} to {values.max():.4g}, median {np.median(values):.4g}"


def _quality(values: dict[str, Any]) -> str:
    named = (
        ("PSNR", "psnr", 2, " dB"),
        ("SSIM", "ssim", 4, ""),
        ("FLIP", "flip", 4, ""),
        ("L1", "l1", 5, ""),
    )
    return ", ".join(f"{name} {fixed(values.get(key), digits)}{unit}" for name, key, digits, unit in named)


def _sizes(dataset: Dataset) -> str:
    sizes = sorted({(view.camera.width, view.camera.height) for view in dataset.views})
    return _some([f"{width}x{height}" for width, height in sizes])


def _some(names: list[str]) -> str:
    more = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")
