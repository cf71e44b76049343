"""Time as a function of primitives, of pixels and of overlap, with the growth exponent of every stage.

``python -m benchmarks scaling``; ``--help`` names the sizes. Primitives are spread evenly over the view, in a random
order of depth, with constant colours (``training_step`` has SH). They are faint, so that no walk ends early and time
follows the work. "Fixed coverage": areas shrink as primitives become more, which keeps the sum of their pixels; lists
grow all the same, because no primitive has less than one isect. All columns of a table are timed in turns, medians.

The stages are those of ``rasterize``: project (with SH and the table the compositor reads), tiles (lists, sorts), and
composite; "backward" is the difference of the two passes. An exponent is the slope of log(time) over log(size), by
least squares over the upper half of the sizes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import drjit as dr
import numpy as np
from markupsafe import Markup
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks, Cutoffs, Grid
from mi_dogsplat.engine.options import RasterOptions, Settings
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.tables import pack
from mi_dogsplat.engine.tiles import tiles
from mi_dogsplat.engine.view import arrange
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.report.page import TEMPLATES
from mi_dogsplat.report.plot import Series, line_plot
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

from ..flags import at_least_one
from ..timing import medians
from .lean import engine_backward, engine_forward

STAGES = ("project", "tiles", "composite", "forward", "backward", "forward + backward")
PAGE = """{% extends "report/templates/base.html" %}
{% from "report/templates/parts.html" import legend %}
{% block body %}
<h1>Scaling</h1>
{{ legend(stages) }}
<div class="plots">
{% for plot, title in figures %}
<figure>{{ plot }}<figcaption>{{ title }}</figcaption></figure>
{% endfor %}
</div>
{% endblock %}"""
REFERENCE_N = 10_000  # primitives at which --sigma holds under fixed coverage, and of the other sweeps


@dataclass
class Point:
    """One size of a sweep: ``x`` is what the sweep varies."""

    label: str
    x: float
    splats: Splats
    camera: Camera
    isects: int = 0  # in the tile lists

    @property
    def grid(self) -> Grid:
        return Grid.of(self.camera.width, self.camera.height, Blocks.of_backend())


@dataclass
class Sweep:
    """One table; ``axis`` says what the sizes of its points are."""

    title: str
    axis: str
    points: list[Point]


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    figures = []
    for sweep in sweeps(args):
        sweep.points = [p for p in sweep.points if _count_isects(p) <= args.max_isects]
        if not sweep.points:
            continue
        times = measure(sweep.points, args.rounds)
        print(f"\n## {sweep.title}\n\n" + markdown(sweep.points, times), flush=True)
        figures.append((figure(sweep, times), sweep.title))
    if args.page:
        stages = [(stage, color) for color, stage in enumerate(STAGES, 1)]
        html = TEMPLATES.from_string(PAGE).render(title="Scaling", stages=stages, figures=figures)
        args.page.write_text(html, encoding="utf-8")


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks scaling", description=__doc__)
    thousands = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]
    parser.add_argument("--primitives", type=int, nargs="*", default=[1000 * k for k in thousands])
    parser.add_argument("--widths", type=int, nargs="*", default=[100, 200, 400, 800, 1600], help="images of 4:3")
    parser.add_argument("--overlaps", type=float, nargs="*", default=[0.25, 0.5, 1, 2, 4, 8], help="factors of sigma")
    parser.add_argument("--sigma", type=float, default=3.0, help="median standard deviation in pixels at 400x300")
    parser.add_argument("--opacity", type=float, default=0.02)
    parser.add_argument("--max-isects", type=float, default=2e7, help="leave out larger sizes: 64 bytes each backward")
    parser.add_argument("--rounds", type=at_least_one, default=11)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--page", type=Path, help="also write the curves to this HTML file")
    return parser.parse_args(flags)


def sweeps(args: argparse.Namespace) -> list[Sweep]:
    """What the flags ask for; a sweep without sizes has no table."""

    def point(label: str, x: float, n: int, sigma: float, width: int = 400) -> Point:
        camera = front_camera(width)
        return Point(label, x, even_splats(n, sigma * width / 400, camera, args.opacity), camera)

    shrinking = {n: args.sigma * (REFERENCE_N / n) ** 0.5 for n in args.primitives}
    sizes = {w: w * (w * 3 // 4) for w in args.widths}
    sigmas = [args.sigma * k for k in args.overlaps]
    n = REFERENCE_N
    return [
        Sweep(
            "Primitives at fixed coverage, 400x300",
            "primitives",
            [point(f"{n:,}", n, n, sigma) for n, sigma in shrinking.items()],
        ),
        Sweep(
            "Primitives at fixed scales, 400x300",
            "primitives",
            [point(f"{n:,}", n, n, args.sigma) for n in args.primitives],
        ),
        Sweep(
            f"Pixels, {n:,} primitives",
            "pixels",
            [point(f"{w}x{w * 3 // 4}", size, n, args.sigma, w) for w, size in sizes.items()],
        ),
        Sweep(
            f"Overlap, {n:,} primitives, 400x300",
            "median standard deviation, pixels",
            [point(f"{sigma:.4g} px", sigma, n, sigma) for sigma in sigmas],
        ),
    ]


def front_camera(width: int) -> Camera:
    """At the origin, looking along z; 4:3, horizontal field of view of 53 degrees."""
    return Camera(np.eye(4), width, width, width / 2, width * 3 / 8, width, width * 3 // 4)


def even_splats(n: int, sigma: float, camera: Camera, opacity: float) -> Splats:
    """N plain primitives spread evenly over the image, at depths 2 to 6, ``sigma`` pixels large wherever they are."""
    rng = np.random.default_rng(0)
    depth = np.exp(rng.uniform(np.log(2), np.log(6), n))
    pixels = rng.uniform(0, (camera.width, camera.height), (n, 2))
    xy = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy) * depth[:, None]
    return Splats(
        means=np.column_stack([xy, depth]),
        log_scales=np.log(sigma * depth / camera.fx)[:, None] + rng.normal(0, 0.4, (n, 3)),
        quats=rng.normal(size=(n, 4)),
        logit_opacities=np.full(n, np.log(opacity / (1 - opacity))),
        sh_coeffs=rng.normal(0, 1, (n, 1, 3)),
    )


def even_model(n: int, camera: Camera) -> Splats:
    """``even_splats`` of opacity 0.1, as training starts, with SH degree 3; the same coverage for each number."""
    splats = even_splats(n, 3.0 * camera.width / 400 * (REFERENCE_N / n) ** 0.5, camera, 0.1)
    rest = np.random.default_rng(1).normal(0, 0.05, (n, 15, 3))
    splats.sh_coeffs = np.ascontiguousarray(np.concatenate([splats.sh_coeffs, rest], 1), np.float32)
    return splats


def _count_isects(point: Point) -> int:
    projection = project(upload(point.splats), DeviceCamera.upload(point.camera), sh_degree=0)
    point.isects = tiles(projection, point.grid, Cutoffs()).n_isects
    return point.isects


def measure(points: Sequence[Point], rounds: int) -> dict[str, list[float]]:
    """Median milliseconds of every stage at every point, timed in turns."""
    runs: dict[str, Callable[[], None]] = {}
    for k, p in enumerate(points):
        params, view, grid = upload(p.splats), DeviceCamera.upload(p.camera), p.grid
        projection = project(params, view, sh_degree=0)
        prepared = arrange(projection, projection.colors, grid, RasterOptions())
        dr.eval(projection, prepared)

        def project_stage(params=params, view=view):
            projection = project(params, view, sh_degree=0)
            dr.eval(projection, pack(projection, projection.colors, Settings(3)))

        def tiles_stage(projection=projection, grid=grid):
            dr.eval(tiles(projection, grid, Cutoffs()))

        def composite_stage(prepared=prepared):
            dr.eval(composite(prepared))

        runs |= {f"project {k}": project_stage, f"tiles {k}": tiles_stage, f"composite {k}": composite_stage}
        runs[f"forward {k}"] = engine_forward(p.splats, p.camera)
        runs[f"forward + backward {k}"] = engine_backward(p.splats, p.camera)
    ms = medians(runs, rounds, dict.fromkeys(runs, 1))
    for k in range(len(points)):
        ms[f"backward {k}"] = ms[f"forward + backward {k}"] - ms[f"forward {k}"]
    return {stage: [ms[f"{stage} {k}"] for k in range(len(points))] for stage in STAGES}


def upper_half(points: Sequence[Point]) -> list[int]:
    """The larger sizes, two at least, by index."""
    order = sorted(range(len(points)), key=lambda k: points[k].x)
    return order[-max(2, -(-len(points) // 2)) :]


def exponent(x: Sequence[float], ms: Sequence[float]) -> float:
    """Slope of log(ms) over log(x) by least squares; NaN for fewer than two sizes, or a difference that is not > 0."""
    if len(x) < 2 or min(ms) <= 0:
        return float("nan")
    return float(np.polyfit(np.log(x), np.log(ms), 1)[0])


def markdown(points: Sequence[Point], times: dict[str, list[float]]) -> str:
    def row(*cells: str) -> str:
        return "| " + " | ".join(cells) + " |"

    def slopes(label: str, size: Callable[[Point], float]) -> str:
        x = [size(points[k]) for k in upper]
        values = [f"{exponent(x, [times[stage][k] for k in upper]):.2f}" for stage in STAGES]
        return row(f"exponent in {label}, {points[upper[0]].label} to {points[upper[-1]].label}", "", "", *values)

    upper = upper_half(points)
    lines = [row("", "isects", "per tile", *(f"{stage}, ms" for stage in STAGES)), "|---" * (3 + len(STAGES)) + "|"]
    for k, p in enumerate(points):
        values = [f"{times[stage][k]:.2f}" for stage in STAGES]
        lines.append(row(p.label, f"{p.isects:,}", f"{p.isects / p.grid.n_tiles:.1f}", *values))
    lines += [slopes("size", lambda p: p.x), slopes("isects", lambda p: p.isects)]
    return "\n".join(lines)


def figure(sweep: Sweep, times: dict[str, list[float]]) -> Markup:
    x = np.array([p.x for p in sweep.points])
    series = [Series(stage, x, np.array(times[stage]), color=k) for k, stage in enumerate(STAGES, 1)]
    return line_plot(series, sweep.axis, "milliseconds", log_x=True, log_y=True, legend=False)
