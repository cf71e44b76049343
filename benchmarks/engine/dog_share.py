"""What a share of DoG primitives costs, against the same model without them.

``python -m benchmarks dog_share`` on the points of fern as training starts, or ``--model point_cloud.ply --scene fern``
on a trained model, whose own DoG parameters are then a case as well (100 % is all that it has). DoG primitives are
chosen at random. Colours are constant: SH costs the same with and without DoG. All columns of a table are timed in
turns, medians; "x" is the time against 0 %.

The last columns are shares of the isects of DoG primitives in which the pseudo-Gaussian exceeds a level at some
pixel. In the others the compositor might leave its kernel out: no pixel would change by more than the level.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat import to_dog
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks, Cutoffs, Grid
from mi_dogsplat.engine.parameters import RAW_DOG, upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.tiles import tiles
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.row_groups import row_of_splats
from mi_dogsplat.scene.splats import Array, Splats
from mi_dogsplat.support.variants import set_variant

from ..flags import at_least_one, part
from ..models import DATA, fern_points
from ..timing import medians
from .lean import engine_backward, engine_forward, with_dog

CASES = {"f_a .05, F .6": (0.05, 0.6), "f_a .5, F 1.6": (0.5, 1.6)}
PASSES = ("forward", "forward + backward", "render")
LEVELS = (8, 12, 16, 20)  # -log2 of a value of the pseudo-Gaussian
PAIRS_AT_ONCE = 20_000  # bounds the memory of a look at every pixel of a tile


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    model, camera = load(args)
    plain = model.plain()
    cases: dict[str, Callable[[float], Splats]] = {
        name: partial(with_share_of_dog, plain, *parameters) for name, parameters in CASES.items()
    }
    if model.n_dog:
        cases[f"as trained, {model.n_dog:,} DoG"] = partial(with_some_of_its_dog, model)
    for name, make in cases.items():
        models = {share: make(share) if share else plain for share in args.shares}
        print(f"\n## {name}: {plain.n_splats:,} primitives, {camera.width}x{camera.height}\n", flush=True)
        print(markdown(models, camera, measure(models, camera, args.rounds)), flush=True)


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks dog_share", description=__doc__)
    parser.add_argument("--model", type=Path, help="a trained model; default: the points of fern")
    parser.add_argument("--scene", default="fern", choices=("fox", "fern", "lego"), help="whose first test view it is")
    parser.add_argument("--downscale", type=int, default=2)
    parser.add_argument("--shares", type=part, nargs="+", default=[0, 0.01, 0.05, 0.1, 0.2, 0.5, 1], metavar="SHARE")
    parser.add_argument("--rounds", type=at_least_one, default=15)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(flags)
    if 0 not in args.shares:
        parser.error("--shares needs a 0, which the other shares are compared with")
    return args


def load(args: argparse.Namespace) -> tuple[Splats, Camera]:
    """The model, with constant colours, and a view of it."""
    if args.model is None:
        splats, camera = fern_points()
    else:
        splats = read_ply(args.model)
        camera = load_dataset(str(DATA / args.scene), args.downscale).test[0].camera
    return replace(splats, sh_coeffs=splats.sh_coeffs[:, :1]), camera


def chosen(n: int, share: float) -> Array:
    """A share of 0..n-1 at random, increasing; a larger share contains a smaller one."""
    return np.sort(np.random.default_rng(0).permutation(n)[: round(share * n)])


def with_share_of_dog(plain: Splats, opacity: float, scale: float, share: float) -> Splats:
    """A share of the primitives made DoG with one f_a and F."""
    return with_dog(plain, chosen(plain.n_splats, share), opacity, scale)


def with_some_of_its_dog(model: Splats, share: float) -> Splats:
    """A share of the model's DoG primitives; the others become plain."""
    rows = chosen(model.n_dog, share)
    return replace(model, dog_index=model.dog_index[rows], **{name: getattr(model, name)[rows] for name in RAW_DOG})


def measure(models: dict[float, Splats], camera: Camera, rounds: int) -> dict[tuple[float, str], float]:
    """Median milliseconds by share and pass."""
    runs: dict[str, Callable[[], None]] = {}
    for share, splats in models.items():
        runs[f"{share} forward"] = engine_forward(splats, camera)
        runs[f"{share} forward + backward"] = engine_backward(splats, camera)
        runs[f"{share} render"] = rendering(splats, camera)
    ms = medians(runs, rounds, dict.fromkeys(runs, 2))
    return {(share, name): ms[f"{share} {name}"] for share in models for name in PASSES}


def rendering(splats: Splats, camera: Camera) -> Callable[[], None]:
    """``mi.render``: the film and the conversion of colours come on top."""
    sensor = camera_to_mitsuba(camera) | {"sampler": {"type": "independent", "sample_count": 1}}
    scene = mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat"}, "sensor": sensor,
                         "splats": to_dog(splats)})

    def run() -> None:
        dr.eval(mi.render(scene, spp=1))  # pyright: ignore[reportArgumentType]

    return run


def markdown(models: dict[float, Splats], camera: Camera, ms: dict[tuple[float, str], float]) -> str:
    head = ["DoG", "isects", "x", *(f"{name}, ms | x" for name in PASSES), *(f"> 2^-{level}" for level in LEVELS)]
    lines = ["| " + " | ".join(head) + " |", "|---" * (3 + 2 * len(PASSES) + len(LEVELS)) + "|"]
    plain_isects, _ = tile_pairs(models[0], camera)
    for share, splats in models.items():
        isects, met = tile_pairs(splats, camera)
        cells = [f"{share:.0%}", f"{isects:,}", f"{isects / plain_isects:.3f}"]
        for name in PASSES:
            cells += [f"{ms[share, name]:.2f}", f"{ms[share, name] / ms[0, name]:.3f}"]
        cells += [f"{value:.0%}" for value in met] or [""] * len(LEVELS)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def tile_pairs(splats: Splats, camera: Camera) -> tuple[int, list[float]]:
    """(isects, share of the DoG ones that exceed each of LEVELS); no shares without DoG."""
    projection = project(upload(splats), DeviceCamera.upload(camera), sh_degree=0)
    grid = Grid.of(camera.width, camera.height, Blocks.of_backend())
    lists = tiles(projection, grid, Cutoffs())
    splat = lists.splat_from_isect.numpy()
    if projection.pseudo is None:
        return len(splat), []
    tile = np.repeat(np.arange(grid.n_tiles), lists.end.numpy() - lists.begin.numpy())
    dog_row = row_of_splats(splats.dog_index, splats.n_splats)
    is_dog = dog_row[splat] >= 0
    splat, tile = splat[is_dog], tile[is_dog]

    b, kernel = grid.blocks, projection.pseudo
    center = [dr.detach(v).numpy()[splat] for v in (projection.x, projection.y)]
    ux, uy, vy, lo = (dr.detach(v).numpy()[dog_row[splat]] for v in (kernel.ux, kernel.uy, kernel.vy, kernel.lo))
    corner = tile % grid.tiles_x * b.tile_width, tile // grid.tiles_x * b.tile_height
    x, y = np.arange(b.tile_width) + 0.5, (np.arange(b.tile_height) + 0.5)[:, None]
    largest = np.empty(len(splat))
    for start in range(0, len(splat), PAIRS_AT_ONCE):
        some = slice(start, start + PAIRS_AT_ONCE)

        def column(v: Array, some: slice = some) -> Array:
            return v[some, None, None]

        dx = column(corner[0]) - column(center[0]) + x
        dy = column(corner[1]) - column(center[1]) + y
        p = column(lo) - (column(ux) * dx + column(uy) * dy) ** 2 - (column(vy) * dy) ** 2
        largest[some] = p.max((1, 2))
    return len(lists.splat_from_isect), [float((largest > -level).mean()) for level in LEVELS]
