"""``dogsplat info`` of a run folder, and of what a measurement leaves: settings, result, and what is missing."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from ..report.depth_maps import told_of_depth_maps
from ..report.run_folder import CONFIG, HISTORY, METRICS, MODEL, Run, read_run
from ..scene.drawing import DrawnAs, told
from ..scene.kinds import COUNTED, kinds
from ..support.wording import count, counted, duration, file_size, finite, fixed
from ..training.config import FREE, TrainConfig
from .lines import first_names, line, problem_lines

RUN_FILES = (CONFIG, HISTORY, METRICS)
SETTINGS = ("preset", "downscale", "max_primitives", "seed")  # of a run that are always told
# told elsewhere, of the preset, or of no matter for the result
UNTOLD = ("data", "steps", "max_world_scale", "variant", "log_every", "test_every", *FREE)


def describe_run(path: Path) -> list[str]:
    """Settings, result and completeness of a run folder."""
    run = read_run(path)
    metrics: dict[str, Any] = run.metrics or {}
    if not any((path / name).is_file() for name in (CONFIG, HISTORY, MODEL)):
        return _describe_measurement(path, metrics)
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
    if maps := told_of_depth_maps(metrics):
        lines.append(line("depth maps", maps))
    if settings := _settings(run):
        lines.append(line("settings", ", ".join(settings)))
    problems = [f"{name} is missing" for name in (*RUN_FILES, MODEL) if not (path / name).is_file()]
    if run.metrics is None:
        problems.append("the run is not complete: it was interrupted, or is still running")
    if run.broken_rows:
        problems.append(f"{HISTORY} has {counted(run.broken_rows, 'line')} without valid JSON")
    return lines + problem_lines(problems)


def _describe_measurement(path: Path, metrics: dict[str, Any]) -> list[str]:
    """What ``dogsplat eval -o DIR`` leaves: the metrics of a model that is elsewhere, and pictures."""
    views = metrics.get("views", {})
    lines = [f"{path}: measurement of a model"]
    lines += [line("primitives", count(metrics["n"]))] if "n" in metrics else []
    lines += [line("views", f"{count(len(views))}: {first_names(list(views))}")] if views else []
    lines += [line(name, _quality(metrics[name])) for name in ("test", "train") if metrics.get(name)]
    return lines + problem_lines([] if views else ["it is not complete: it was interrupted, or is still going on"])


def _settings(run: Run) -> list[str]:
    """Those of ``SETTINGS``, and all others that are not as they usually are and bear on the result; in place of the
    preset a recipe that is no preset's."""
    config, label = run.config, (run.recipe or {}).get("label")
    usual = {field.name: field.default for field in fields(TrainConfig) if field.name not in UNTOLD}
    if config.get("near_clip") == DrawnAs().near_clip:  # a run writes it down where nobody has said anything, too
        usual["near_clip"] = config["near_clip"]
    shown = [name for name in config if name in SETTINGS or (name in usual and config[name] != usual[name])]
    words = {name: name if config[name] is True else f"{name} {_short(config[name])}" for name in shown}
    return list((words | ({"preset": f'recipe "{label}"'} if label else {})).values())


def _short(value: Any) -> Any:
    """As lines tell it, and 10000000 for 10000000.0."""
    return int(value) if isinstance(value, float) and value.is_integer() else told(value)


def _quality(values: dict[str, Any]) -> str:
    named = (
        ("PSNR", "psnr", 2, " dB"),
        ("SSIM", "ssim", 4, ""),
        ("FLIP", "flip", 4, ""),
        ("L1", "l1", 5, ""),
    )
    return ", ".join(f"{name} {fixed(values.get(key), digits)}{unit}" for name, key, digits, unit in named)
