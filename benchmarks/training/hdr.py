"""Linear against display-referred training: ``python -m benchmarks hdr -o DIR``.

A scene is captured twice with the same samples, as PNG and with ``--hdr``, and trained on with the same steps: on the
PNG, and on the EXR through several tone curves. All models are measured on validation views of the EXR, in linear
light, which a display-referred model means by the sRGB curve. Columns:

- ``psnr``, ``psnr_mu``, ``hdr_flip``: as ``dogsplat eval`` has them;
- ``shadows``, ``middle``, ``highlights``: mean error in stops, |log2| of the ratio of luminances, of the pixels whose
  truth is below 5 % of white, between, and above white;
- ``lamps``: luminance of all pixels above 10 times white, over what it is in truth.

``--files`` measures the models as files of other formats instead, their DoG baked.

Writes ``hdr.json``, ``hdr.png`` (a view at four exposures, each model below the truth, with labels) and prints a table.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.export.bake import baked
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.measure.evaluate import evaluate_views, mean_metrics
from mi_dogsplat.render.picture import Picture, light_of, picture_of
from mi_dogsplat.runs.run import train
from mi_dogsplat.scene.drawing import drawn_as
from mi_dogsplat.support.files import write_json
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.srgb import displayed, luminance
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.images.tone_curve import SrgbLog, ToneCurve
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.recipe import Recipe
from mi_dogsplat.training.strategy.strategy import Strategy, Training
from PIL import Image, ImageDraw, ImageFont

from .kept import same_settings

SHADOW, LAMP = 0.05, 10.0  # times white
FLOOR = 1e-4  # of white, below which nothing is told apart
SUFFIXES = (".ply", ".sog", ".compressed.ply", ".spz")
EXPOSURES = (-4, -2, 0, 3)  # stops, of the picture
DARK, AROUND = 0.05, 4  # of the display at the longest: below it is background; pixels kept of it
ZOOM, LINE = 2, 28  # pixels of the picture for one of a view, and of a line of text
FONT = ImageFont.load_default(15)


@dataclass(frozen=True)
class Log:
    """k log(1 + x / ε): the μ-law with μ / brightest = 1 / ε, and RawNeRF's loss as a curve; 1 at white."""

    epsilon: float

    def __call__(self, x: Any) -> Any:
        return dr.select(x > 0, dr.log(1 + dr.maximum(x, 0) / self.epsilon), x / self.epsilon) * self._scale

    def slope(self, x: Any) -> Any:
        return self._scale / (self.epsilon + dr.maximum(x, 0))

    @property
    def _scale(self) -> float:
        return 1 / float(np.log1p(1 / self.epsilon))


@dataclass(frozen=True)
class Reinhard:
    """2 x / (1 + x): 1 at white, 2 in the end."""

    def __call__(self, x: Any) -> Any:
        return 2 * x / (1 + dr.maximum(x, 0))

    def slope(self, x: Any) -> Any:
        return 2 / dr.square(1 + dr.maximum(x, 0))


@dataclass(frozen=True)
class Identity:
    """No curve: the loss of radiance itself."""

    def __call__(self, x: Any) -> Any:
        return x

    def slope(self, x: Any) -> Any:
        return dr.full(type(x), 1, dr.width(x))


@dataclass(frozen=True)
class SameSteps(Strategy[None]):
    """Steps of Adam are of one length in radiance for all primitives."""

    def new_state(self, t: Training) -> None:
        t.optimizer.curve = None


CURVES: dict[str, ToneCurve] = {
    "sRGB, log": SrgbLog(),
    "log 0.1": Log(0.1),
    "log 0.01": Log(0.01),
    "log 0.001": Log(0.001),
    "Reinhard": Reinhard(),
    "none": Identity(),
}
SAME_STEPS, PNG = "sRGB, log, same steps", "trained on PNG"
RUNS = (PNG, *CURVES, SAME_STEPS)


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    same_settings(args.out, args, "scene", ("preset", "steps", "views", "size", "spp"))
    names = args.runs.split("; ") if args.runs else RUNS
    folders = {hdr: captured(args, hdr) for hdr in sorted({True, *(name != PNG for name in names)})}
    truth = load_dataset(folders[True], split="validation")
    rows, pictures = {}, {}
    for name in names:
        out = args.out / "".join(c if c.isalnum() else "_" for c in name)
        if not (out / "metrics.json").exists():
            settings = {"preset": args.preset, "steps": args.steps, "target": 0.3, "split": "validation"}
            config, begun = TrainConfig(str(folders[name != PNG]), **settings), (out / "config.json").exists()
            train(config, out, resume=begun, recipe=_recipe(args.preset, name))
        for text, file in _files(name, out) if args.files else [(name, out / "point_cloud.ply")]:
            rows[text], pictures[text] = measured(file, truth)
            print(text, {key: round(value, 4) for key, value in rows[text].items()}, flush=True)
    write_json(args.out / "hdr.json", {"steps": args.steps, "white": truth.white, "rows": rows})
    write_png(args.out / "hdr.png", _sheet(truth, pictures))
    print_rows(rows)


def print_rows(rows: dict[str, dict[str, float]]) -> None:
    """As a table."""
    columns = list(next(iter(rows.values())))
    print(f"\n| | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}")
    for name, row in rows.items():
        print(f"| {name} | {' | '.join(f'{row[column]:.3g}' for column in columns)} |")


def _files(name: str, run: Path) -> Iterator[tuple[str, Path]]:
    """Names and files of a run's model: as it is, and baked in several formats."""
    yield f"{name}: PLY, with its DoG", run / "point_cloud.ply"
    model = read_model(run / "point_cloud.ply")
    plain = replace(model, splats=baked(model.splats))
    for suffix in SUFFIXES:
        file = run / f"baked{suffix}"
        write_model(file, plain)
        yield f"{name}: {suffix[1:]}", file


def _recipe(preset: str, name: str) -> Recipe:
    recipe = RECIPES[preset]
    if name == SAME_STEPS:
        return replace(recipe, also=(SameSteps(),))
    return replace(recipe, curve=CURVES.get(name, recipe.curve))


def captured(args: argparse.Namespace, hdr: bool) -> Path:
    """The data set of the scene that the arguments name, in its folder: OpenEXR, or PNG."""
    config = CaptureConfig(
        views=args.views, size=tuple(args.size), spp=args.spp, radius=1.75, center=(0.0, 0.0, 0.4), hdr=hdr
    )
    return capture(args.scene, args.out / ("exr" if hdr else "png"), config)


def measured(model: Path, truth: Dataset) -> tuple[dict[str, float], np.ndarray]:
    """The row of a model, by the columns above, and the radiance of the middle view."""
    read = read_model(model)
    picture = picture_of(read.splats, 0.0, drawn_as(read.drawing))
    seen: dict[str, Picture] = {view.name: picture(view.camera) for view in truth.test}
    row = mean_metrics(evaluate_views(lambda view: seen[view.name], truth.test, 0.0))
    ours = np.concatenate([luminance(light_of(seen[view.name])).ravel() for view in truth.test]) / truth.white
    real = np.concatenate([luminance(view.image[..., :3]).ravel() for view in truth.test]) / truth.white
    stops = np.abs(np.log2((ours + FLOOR) / (real + FLOOR)))
    parts = {"shadows": real < SHADOW, "middle": (real >= SHADOW) & (real <= 1), "highlights": real > 1}
    row = {name: row[name] for name in ("psnr", "psnr_mu", "hdr_flip")}
    row |= {name: float(stops[part].mean()) for name, part in parts.items()}
    row["lamps"] = float(ours[real > LAMP].sum() / real[real > LAMP].sum())
    row |= {"n": read.splats.n_splats, "bytes": model.stat().st_size}
    return row, light_of(seen[truth.test[len(truth.test) // 2].name])


def _sheet(truth: Dataset, pictures: dict[str, np.ndarray]) -> np.ndarray:
    """A row for the truth and for each model, a column for each exposure, without what is black around the scene."""
    real = truth.test[len(truth.test) // 2].image[..., :3]
    white = truth.white or 1.0
    lit = displayed(real, white / 2.0 ** max(EXPOSURES)).max(axis=-1) > DARK
    ends = zip(np.nonzero(lit), lit.shape, strict=True)
    part = tuple(slice(max(x.min() - AROUND, 0), min(x.max() + AROUND + 1, side)) for x, side in ends)
    name_width = 8 + round(max(FONT.getlength(name) for name in pictures))
    width = ZOOM * (part[1].stop - part[1].start)
    heads = [_text(f"{stop:+d} stops" if stop else "0 stops", width, LINE) for stop in EXPOSURES]
    rows = [np.concatenate([_text("", name_width, LINE), *heads], axis=1)]
    for name, image in {"truth": real, **pictures}.items():
        cells = [displayed(image[part], white / 2.0**stop) for stop in EXPOSURES]
        cells = [cell.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1) for cell in cells]
        rows.append(np.concatenate([_text(name, name_width, len(cells[0])), *cells], axis=1))
    return np.concatenate(rows)


def _text(text: str, width: int, height: int) -> np.ndarray:
    """[height, width, 3], in grey on black."""
    canvas = Image.new("RGB", (width, height))
    ImageDraw.Draw(canvas).text((width / 2, height / 2), text, (220, 220, 220), FONT, anchor="mm")
    return np.asarray(canvas) / 255.0


def parser_of(name: str, description: str | None) -> argparse.ArgumentParser:
    """Of an experiment that trains on a scene of high contrast."""
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks {name}", description=(description or "").partition("\n")[0]
    )
    parser.add_argument("--scene", type=Path, default=Path("scenes/hdr_lamp.xml"), metavar="SCENE.xml")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--preset", default="ours", choices=tuple(RECIPES))
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--views", type=int, default=40)
    parser.add_argument("--size", type=int, nargs=2, default=[160, 120], metavar=("W", "H"))
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--variant", default="auto")
    return parser


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = parser_of("hdr", __doc__)
    parser.add_argument("--runs", help=f'some of "{"; ".join(RUNS)}", separated by "; " (default: all)')
    parser.add_argument("--files", action="store_true", help="each model as files of other formats instead")
    return parser.parse_args(flags)
