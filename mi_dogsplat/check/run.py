"""The parts of ``dogsplat check``, one after the other, into ``check.json`` and ``check.html``."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..formats.read import read_model, require_primitives
from ..render.picture_options import PictureOptions
from ..render.viewpoint import viewpoint
from ..support.arguments import checks_arguments, require_path
from ..support.cores import usable_cores
from ..support.errors import DataError, making
from ..support.files import replacing, write_json
from ..support.variants import require_arrays
from ..support.versions import versions
from ..support.wording import finite, printable
from . import PARTS, UNUSED, stability, work_precision
from .scenes import Scene, model_scene, synthetic_scenes
from .training import read_training

TEMPLATE_PACKAGES = ("jinja2", "markupsafe")


@checks_arguments
def check(
    out: str | Path,
    model: str | Path | None = None,
    parts: Sequence[str] | None = None,
    runs: Sequence[str | Path] = (),
    data: str | Path | None = None,
    camera: str | Path | None = None,
    width: int = 256,
    rounds: int = 9,
    options: PictureOptions = PictureOptions(),
    progress: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Measure the numerics of the engine; write ``check.json`` and, with the extra ``train``, ``check.html``.

    Args:
        out: folder to write.
        model: model file to measure after the scenes that are made here; None: those alone.
        parts: of ``PARTS``; None: all that can be run.
        runs: run folders to compare by training error.
        data, camera: from where the model is seen (``render/viewpoint.py``).
        width: of the pictures, in pixels; one of the model is at most so wide and high.
        rounds: how often each setting is timed.
        options: how the model is drawn; ``linear`` and ``white`` must not be given.
        progress: told in one line what is being done.

    Returns what ``check.json`` holds: ``model_name`` (None without one), ``machine`` and, of the parts that were run,
    ``work_precision`` (``work_precision.measure`` per scene), ``stability`` and ``training``. What is not a finite
    number is null. Needs a Mitsuba variant. Raises ``DataError`` before anything is written.
    """
    require_arrays()
    for name, given in (("parts", parts), ("runs", runs)):
        if isinstance(given, str | Path):  # its letters would be taken one by one
            raise DataError(f"check: {name}", f'"{given}" is no list', f'give one, as {name}=["{given}"]')
    for run in runs:
        require_path("check: runs", run)
    out, parts = Path(out), parts or [part for part in PARTS if part != "training" or runs]
    _require_parts(parts, model, runs, width, rounds)
    _require_use(model, data, camera, options)
    scene = _model_scene(Path(model), data, camera, width, options) if model else None
    training = read_training([Path(run) for run in runs])
    jobs: dict[str, Callable[[], Any]] = {}
    if "work-precision" in parts:
        scenes = synthetic_scenes(width) + ([scene] if scene else [])
        jobs["work_precision"] = lambda: [work_precision.measure(each, rounds, progress) for each in scenes]
    if training:
        jobs["training"] = lambda: training
    if "stability" in parts:
        jobs["stability"] = lambda: stability.run(progress)
    with making(out):
        out.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {"model_name": scene.name if scene else None, "machine": _machine(rounds)}
    report = _plain(report | {name: job() for name, job in jobs.items()})
    write_json(out / "check.json", report)
    _write_page(report, out / "check.html")
    return report


def _require_parts(
    parts: Sequence[str], model: str | Path | None, runs: Sequence[str | Path], width: int, rounds: int
) -> None:
    """Raise ``DataError`` for parts that are unknown or lack what they need, and for what no part would use."""
    if unknown := [part for part in parts if part not in PARTS]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(PARTS)}")
    if "training" in parts and not runs:
        raise DataError("--only", "the part training has no run to read", "add --runs RUN")
    for part, place, given in (("training", "--runs", runs), ("work-precision", model, model)):
        if given and part not in parts:
            raise DataError(str(place), f"is only for the part {part}", f"add {part} to --only, or leave it out")
    for flag, value, least in (("--width", width, 16), ("--rounds", rounds, 1)):
        if value < least:
            raise DataError(flag, f"{value} is too small", f"use at least {least}")


def _require_use(
    model: str | Path | None, data: str | Path | None, camera: str | Path | None, options: PictureOptions
) -> None:
    """Raise ``DataError`` for what says something of a model where there is none, or changes no number of one."""
    said = [name for name in asdict(options) if getattr(options, name) != getattr(PictureOptions, name)]
    places = {"data": data, "camera": camera}
    how = {name: "from where a model is seen" for name, given in places.items() if given is not None}
    how |= dict.fromkeys(said, "how a model is drawn")
    for name in how if model is None else ():
        flag = "--" + name.replace("_", "-")
        raise DataError(flag, f"says {how[name]}, but no model is given", "name a model, or leave it out")
    for name in UNUSED:
        if name in said:
            raise DataError(f"--{name}", "changes no number that is measured", "leave it out")


def _model_scene(
    model: Path, data: str | Path | None, camera: str | Path | None, width: int, options: PictureOptions
) -> Scene:
    """The model, seen as ``render_files.render_model`` would see it."""
    read = read_model(model)
    require_primitives(model, read, "check")
    splats = read.splats.uniform_sh()  # one array of colours, whose errors are told
    view = viewpoint(splats, data, camera, options, read.drawing)
    how = {"near_clip": view.drawn.near_clip, "antialiased": view.drawn.antialiased}
    return model_scene(model.name, splats, view.camera, width, background=view.background, **how)


def _write_page(report: dict[str, Any], path: Path) -> None:
    """The page. Without the extra ``train`` there is none, and none of an earlier check either."""
    path.unlink(missing_ok=True)
    try:
        from .page import check_page
    except ModuleNotFoundError as error:
        if error.name not in TEMPLATE_PACKAGES:
            raise
        return
    with replacing(path) as part:
        part.write_text(check_page(report), encoding="utf-8")


def _machine(rounds: int) -> dict[str, Any]:
    """What the times depend on; the load is that of the minute before."""
    load = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None  # not on Windows
    return {"variant": mi.variant(), "cores": usable_cores(), "load": load, "rounds": rounds} | versions()


def _plain(value: Any) -> Any:
    """The same in types that JSON knows; numbers that are not finite become None, and names are printable."""
    if isinstance(value, Mapping):
        return {str(key): _plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str):
        return printable(value)  # a name may be no UTF-8
    return finite(value) if isinstance(value, float) else value
