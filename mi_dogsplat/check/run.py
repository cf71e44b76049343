"""``dogsplat check``: the parts that are asked for, one after the other, into ``check.json`` and ``check.html``."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..render.render_files import viewpoint
from ..scene.ply import read_ply
from ..support.cores import usable_cores
from ..support.errors import DataError
from ..support.files import replacing, write_json
from ..support.versions import versions
from ..support.wording import finite
from . import PARTS, stability, work_precision
from .scenes import Scene, model_scene, synthetic_scenes
from .training import read_training

TEMPLATE_PACKAGES = ("jinja2", "markupsafe")


def model_to_check(args: argparse.Namespace) -> Scene:
    """The model ``args.model``, seen as ``dogsplat render`` would see it, ``args.width`` pixels wide or high at most.

    Raises ``DataError``.
    """
    splats = read_ply(args.model)
    if splats.n_splats == 0:
        raise DataError(args.model, "holds no primitives", "check a model that has some")
    view = viewpoint(args, splats)
    others = {"background": view.background, "near_clip": view.near_clip, "antialiased": args.antialiased}
    return model_scene(args.model.name, splats, view.camera, args.width, **others)


def check(
    model: Scene | None,
    out: Path,
    runs: Sequence[Path] = (),
    parts: Sequence[str] = PARTS,
    width: int = 256,
    rounds: int = 9,
    progress: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Run ``parts`` of ``PARTS``, write ``check.json`` and, with the extra ``train``, ``check.html`` to ``out``.

    Args:
        model: measured after the scenes that are made here; None: those alone.
        runs: run folders to compare by training error; without one that part is left out.
        width: of the pictures of the scenes made here, in pixels.
        rounds: how often each setting is timed.
        progress: told in one line what is being done.

    Returns what ``check.json`` holds. Its keys are ``model_name`` (None without one), ``machine`` and, of the parts
    that were run, ``work_precision`` (``work_precision.measure`` per scene), ``stability``, ``stiffness`` and
    ``training``. What is not a finite number is null. Raises ``DataError`` before anything is written.
    """
    training = read_training(runs) if "training" in parts else []
    jobs: dict[str, Callable[[], Any]] = {}
    if "work-precision" in parts:
        scenes = synthetic_scenes(width) + ([model] if model else [])
        jobs["work_precision"] = lambda: [work_precision.measure(scene, rounds, progress) for scene in scenes]
    if training:
        jobs["training"] = lambda: training
    if "stability" in parts:
        jobs["stability"] = lambda: stability.run(progress)
    if "stiffness" in parts:
        from . import stiffness  # here: it trains, which needs the extra "train"; and before an hour of other parts

        jobs["stiffness"] = lambda: stiffness.run(progress)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(out, error.strerror or str(error), "name a folder that can be written") from None
    report: dict[str, Any] = {"model_name": model.name if model else None, "machine": _machine(rounds)}
    report = _plain(report | {name: job() for name, job in jobs.items()})
    write_json(out / "check.json", report)
    _write_page(report, out / "check.html")
    return report


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
    load = round(os.getloadavg()[0], 1)
    return {"variant": mi.variant(), "cores": usable_cores(), "load": load, "rounds": rounds} | versions()


def _plain(value: Any) -> Any:
    """The same in types that JSON knows; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    return finite(value) if isinstance(value, float) else value
