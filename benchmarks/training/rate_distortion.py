"""Quality against bytes: ``python -m benchmarks rate_distortion DATA -o DIR --downscale 2 --max-primitives 100000``.

From one densified start, as in a comparison: the full model, tenths of it by count, and models trained for a size of
their file, each through the formats it can have. Every file is read back and measured on the test views. Curves:

- ``3dgs``: the full model, as PLY and exported to each format;
- ``count``: ``ours`` to a part of the primitives (``--counts``), as PLY with its DoG and exported to each format;
- ``size``: ``ours`` trained for a size (``--sizes``) in each format, which the trainer measures and meets; with
  ``--preconditioned`` by such steps, too.

``--file LABEL=PATH`` adds a file that another program has made of the same capture. A run that is cut off goes on when
the same command is given again. LPIPS is measured where its weights are installed (``make lpips``), which takes seconds
a view. Times to draw are measured at the end, all files in turn. Writes ``rate_distortion.json``, ``.csv`` and a page
with plots.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mi_dogsplat.compare.method_runs import densified_start
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.export.bake import baked
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.measure.evaluate import Measure, evaluate_views, mean_metrics, render_milliseconds_in_turn
from mi_dogsplat.measure.lpips import Lpips
from mi_dogsplat.render.picture import background_color, picture_of
from mi_dogsplat.report.page import TEMPLATES
from mi_dogsplat.report.plot import Series, line_plot
from mi_dogsplat.report.points import Note
from mi_dogsplat.runs.checkpoint import CHECKPOINT, load_checkpoint
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.files import replacing, write_json
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.strategy.scheduler import target_count

from .kept import same_settings

MEASURES = {"psnr": "PSNR, dB", "ssim": "SSIM", "flip": "FLIP (lower is better)", "lpips": "LPIPS (lower is better)"}
AXES = {"bytes": ("file, MB", 1e-6), "n": ("primitives", 1.0)}
PLOTS = (("bytes", "psnr"), ("n", "psnr"), ("bytes", "ssim"), ("bytes", "flip"), ("bytes", "lpips"))
EXPORTS = {"spz": ".spz", "sog": ".sog", "compressed PLY": ".compressed.ply"}
COLUMNS = ("curve", "run", "file", "n", "n_dog", "bytes", "bytes_each", *MEASURES, "render_ms", "train_seconds")
PAGE = """{% extends "report/templates/base.html" %}{% from "report/templates/parts.html" import plots as drawn %}
{% block body %}<h1>{{ title }}</h1>
<p>Views of {{ data }} that are not trained on; every file is read back.
A point is a file; a curve has its name at its end.</p>
{{ drawn(plots) }}
<div class="scroll"><table><tr>{% for name in columns %}<th>{{ name }}</th>{% endfor %}</tr>
{% for row in rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</table></div>
{% endblock %}"""


@dataclass(frozen=True)
class File:
    """A file to measure: of which curve, and of which run."""

    curve: str
    run: str
    path: Path
    train_seconds: float | None = None


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    base = TrainConfig(
        data=args.data, preset="3dgs", steps=args.steps, downscale=args.downscale, seed=args.seed,
        max_primitives=args.max_primitives, max_world_scale=math.inf, split=args.split, checkpoint_seconds=300,
    )  # fmt: skip
    same_settings(args.out, args, "data", ("downscale", "steps", "max_primitives", "split", "seed"))
    dataset = load_dataset(base.data, base.downscale, split=base.split)
    background = background_color(base.background, dataset.has_alpha)
    measure = Measure(lpips=Lpips.installed(view.camera for view in dataset.test))
    rows, pictures = [], {}
    for file in _files(base, args):
        splats = read_model(file.path).splats
        picture = picture_of(splats, background)
        pictures[str(file.path)] = lambda view, picture=picture: picture(view.camera)
        found = evaluate_views(pictures[str(file.path)], dataset.test, background, measure=measure)
        rows.append(row_of(file, splats, mean_metrics(found)))
        print(rows[-1], flush=True)
        _write(args.out, args.data, rows)
    times = render_milliseconds_in_turn(pictures, dataset.test)
    timed = [row | {"render_ms": round(ms, 2)} for row, ms in zip(rows, times.values(), strict=True)]
    _write(args.out, args.data, timed)


def _files(base: TrainConfig, args: argparse.Namespace) -> Iterator[File]:
    """Each as soon as it is there."""
    start = args.out / "start.npz"
    if not start.exists():
        densified_start(base, start)
    n = np.size(load_checkpoint(start)["optimizer.logit_opacities"])
    for label, path in (text.split("=", 1) for text in args.file):
        yield File(label, label, Path(path))
    yield from _exported("3dgs", _trained(base, args.out / "3dgs", start))
    for share in args.counts:
        config = replace(base, preset="ours", target=target_count(share, n))
        yield from _exported("count", _trained(config, args.out / f"count_{share:g}", start))
    steps = {"": False} | ({"preconditioned": True} if args.preconditioned else {})
    for name, size, (words, jointly) in itertools.product(args.formats, args.sizes, steps.items()):
        config = replace(base, preset="ours", target=size, format=name, preconditioned=jointly)
        run = _trained(config, args.out / "_".join(filter(None, (name, size, words))), start)
        curve = ", ".join(filter(None, ("size", name, words)))
        yield File(curve, run.name, run / f"point_cloud.{name}", _seconds(run))


def _trained(config: TrainConfig, out: Path, start: Path) -> Path:
    """A run folder; one that is complete is left as it is, one that was cut off goes on."""
    if not (out / "metrics.json").exists():
        train(config, out, resume=(out / CHECKPOINT).exists(), start=start)
    return out


def _exported(curve: str, run: Path) -> Iterator[File]:
    """The model of a run as it is, and baked into each other format."""
    yield File(f"{curve}, ply", run.name, run / "point_cloud.ply", _seconds(run))
    model = read_model(run / "point_cloud.ply")
    for name, suffix in EXPORTS.items():
        path = run / f"exported{suffix}"
        if not path.exists():
            write_model(path, replace(model, splats=baked(model.splats)))
        yield File(f"{curve}, {name}", run.name, path)


def _seconds(run: Path) -> float:
    return json.loads((run / "metrics.json").read_text(encoding="utf-8"))["train_seconds"]


def row_of(file: File, splats: Splats, found: Mapping[str, float]) -> dict:
    """What a file has and gives, by the names of ``COLUMNS``; times to draw are still to come."""
    size = file.path.stat().st_size
    row = {"curve": file.curve, "run": file.run, "file": file.path.name, "n": splats.n_splats, "n_dog": splats.n_dog}
    row |= {"bytes": size, "bytes_each": round(size / splats.n_splats, 2)}
    row |= {name: round(found[name], 4) if name in found else None for name in MEASURES}
    return row | {"render_ms": None, "train_seconds": file.train_seconds and round(file.train_seconds, 1)}


def plots(rows: list[dict]) -> list[str]:
    """Each measure that was taken against bytes, and PSNR against what a render pays for; one curve for each name."""
    names = list(dict.fromkeys(row["curve"] for row in rows))
    drawn = []
    for quantity, measure in (plot for plot in PLOTS if all(row[plot[1]] is not None for row in rows)):
        (unit, factor), words, series = AXES[quantity], MEASURES[measure], []
        for k, name in enumerate(names):
            own = sorted((row for row in rows if row["curve"] == name), key=lambda row: row[quantity])
            x, y = np.array([row[quantity] * factor for row in own]), np.array([row[measure] for row in own])
            color = k % 7 + 1
            told = [f"{name}: {row['run']}, {row[measure]} at {row[quantity] * factor:,.4g}" for row in own]
            notes = [Note(text, name if text is told[-1] else "") for text in told]
            series += [Series(name, x, y, "line", color), Series(name, x, y, "points", color, notes)]
        drawn.append(line_plot(series, unit, words, log_x=True, legend=False, height=300))
    return drawn


def _write(out: Path, data: str, rows: list[dict]) -> None:
    write_json(out / "rate_distortion.json", {"data": data, "rows": rows})
    with replacing(out / "rate_distortion.csv") as part, open(part, "w", encoding="utf-8", newline="") as table:
        writer = csv.DictWriter(table, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    cells = [["" if row[name] is None else row[name] for name in COLUMNS] for row in rows]
    page = TEMPLATES.from_string(PAGE).render(
        title="Quality against bytes", data=data, plots=plots(rows), columns=COLUMNS, rows=cells
    )
    with replacing(out / "rate_distortion.html") as part:
        part.write_text(page, encoding="utf-8")


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks rate_distortion", description=__doc__)
    parser.add_argument("data")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--downscale", type=int, default=1)
    parser.add_argument("--steps", type=int, default=7000)
    parser.add_argument("--max-primitives", type=int)
    parser.add_argument("--counts", type=float, nargs="*", default=[0.1, 0.2, 0.4])
    parser.add_argument("--sizes", nargs="*", default=["500kB", "1MB", "2MB"])
    parser.add_argument("--formats", nargs="*", default=["spz", "sog"])
    parser.add_argument("--preconditioned", action="store_true", help="sizes by such steps, beside the usual ones")
    parser.add_argument("--file", action="append", default=[], metavar="LABEL=PATH")
    parser.add_argument("--split", default="test")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    return parser.parse_args(flags)
