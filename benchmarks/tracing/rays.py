"""Rays through splats: ``SplatTracer``, ``volprim_rf_basic``, and Mitsuba's acceleration with our blending.

The same rays for all, in turns. *Coherent* rays are those of a camera. *Incoherent* ones leave the floor under the
model in cosine-distributed directions, as from a diffuse surface.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.arrays import array_types, detached, while_loop
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, device_array, upload
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.engine.sh import unit_basis
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.plugin.ellipsoids import to_ellipsoids
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.tracing.blend import passes, radiance
from mi_dogsplat.tracing.kernels import Line
from mi_dogsplat.tracing.options import TraceOptions
from mi_dogsplat.tracing.primitives import primitives_of
from mi_dogsplat.tracing.tracer import SplatTracer
from mi_dogsplat.tracing.tree import Tree, build
from mi_dogsplat.tracing.vectors import dot
from mi_dogsplat.tracing.visits import TreeWalk

from ..flags import at_least_one
from ..models import DATA
from ..renderers.ray_model import ray_directions
from ..timing import medians

MODELS = Path(__file__).parents[2] / "scenes" / "still_life.ply", DATA / "models" / "playbot_lod2_sh2.ply"
RESTART = 1e-4  # units behind a hit, where ``volprim_rf_basic`` goes on


def camera_rays(splats: Splats, count: int) -> mi.Ray3f:
    side = int(count**0.5)
    camera = automatic_camera(splats).resized(side, side)
    y, x = np.mgrid[:side, :side] + 0.5
    directions = ray_directions(camera, np.stack([x.ravel(), y.ravel()], 1))
    return ray_of(np.broadcast_to(camera.position, directions.shape), directions)


def floor_rays(splats: Splats, count: int) -> mi.Ray3f:
    rng = np.random.default_rng(0)
    low, high = np.percentile(splats.means, [2, 98], axis=0)
    origins = rng.uniform(low, high, (count, 3))
    origins[:, 2] = low[2] - 0.02 * (high - low)[2]
    directions = rng.normal(size=(count, 3))
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True) + [0, 0, 1.0001]
    return ray_of(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))


def ray_of(origins: np.ndarray, directions: np.ndarray) -> mi.Ray3f:
    o, d = ([device_array(column) for column in rows.T] for rows in (origins, directions))
    return mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*d))


def over_ellipsoids(
    scene: mi.Scene, tree: Tree, node_from_ellipsoid: Any, ray: mi.Ray3f, options: TraceOptions
) -> list:
    """Our blending, of what Mitsuba's acceleration finds: the next shell that is entered, one after the other."""
    Float = array_types().Float
    o, d = list(detached(ray.o)), list(detached(ray.d))
    line = Line(o, d, dr.rcp(dot(d, d)), detached(ray.maxt))
    width = dr.width(ray)
    basis = unit_basis(d, options.sh_degree)

    def step(walking: Any, start: Any, T: Any, *colors: Any) -> tuple:
        onward = mi.Ray3f(mi.Point3f([dr.fma(start, b, a) for a, b in zip(o, d, strict=True)]), ray.d)
        active: Any = mi.Bool(walking)
        found = scene.ray_intersect_preliminary(onward, active=active)
        walking &= detached(found.is_valid())
        node = dr.gather(array_types().UInt, node_from_ellipsoid, detached(found.prim_index), walking)
        walk = TreeWalk(tree, line, options, walking)
        met = walk.meet(node, walking)
        walking, T_next = passes(met, walking, T, options)
        weight = dr.select(walking, met.alpha * T, 0)
        seen = [dr.maximum(c, 0) for c in radiance(tree, met, basis, walking)]
        blended = [dr.fma(weight, c, color) for c, color in zip(seen, colors, strict=True)]
        return walking, start + detached(found.t) + RESTART, dr.select(walking, T_next, T), *blended

    zero = dr.zeros(Float, width)
    state = dr.full(dr.mask_t(Float), True, width), zero, zero + 1, zero, zero, zero
    return list(while_loop(state, lambda walking, *_: walking, step, "ellipsoids")[3:])


def contestants(splats: Splats, ray: mi.Ray3f) -> dict[str, Callable[[], list]]:
    """What gathers the colours of these rays, by name; ``transmittance`` gathers less."""
    options = TraceOptions(splats.sh_degree)
    params = upload(splats)
    tracer = SplatTracer(params, options)
    scene: Any = mi.load_dict({"type": "scene", "shape": to_ellipsoids(splats),
                               "integrator": {"type": "volprim_rf_basic", "srgb_primitives": False}})
    tree = build(primitives_of(params, options.sh_degree), options.cutoffs.log2_range)
    if tree is None:
        raise SystemExit("a model of which nothing is drawn")
    leaf_from_splat = np.zeros(splats.n_splats, np.uint32)
    there = tree.splat_from_leaf.numpy()
    leaf_from_splat[there[there < splats.n_splats]] = np.flatnonzero(there < splats.n_splats)
    drawn = np.flatnonzero(splats.opacities >= 1 / 255)
    nodes = detached(device_array(leaf_from_splat[drawn] + tree.n_leaves, mi.UInt32))

    def volprim() -> list:
        return list(scene.integrator().sample(dr.ADMode.Primal, scene, None, ray, None, None, True)[0])

    return {
        "volprim_rf_basic": volprim,
        "Mitsuba's acceleration, our blending": lambda: over_ellipsoids(scene, tree, nodes, ray, options),
        "SplatTracer.gather": lambda: list(tracer.gather(ray)[0]),
        "SplatTracer.transmittance": lambda: [tracer.transmittance(ray)],
    }


def beside_splatting(splats: Splats) -> None:
    """The rays through the pixel centres of a picture against the picture, as it is and at four times its size."""
    for factor in (1, 4):
        camera = automatic_camera(splats).resized(400 * factor, 300 * factor)
        y, x = np.mgrid[: camera.height, : camera.width] + 0.5
        directions = ray_directions(camera, np.stack([x.ravel(), y.ravel()], 1))
        ray = ray_of(np.broadcast_to(camera.position, directions.shape), directions)
        params = upload(splats)
        traced, T = SplatTracer(params, TraceOptions(splats.sh_degree)).gather(ray)
        frame = rasterize(params, DeviceCamera.upload(camera, 0), RasterOptions(splats.sh_degree))
        error, of_colors = np.abs(T.numpy() - frame.T.numpy()).mean(), psnr(image(traced), image(frame.colors))
        size = f"{camera.width}x{camera.height}"
        print(f"through pixel centres, beside splats at {size}: PSNR {of_colors:.1f}, transmittance {error:.4f} apart")
    print()


def evaluated(run: Callable[[], Any]) -> Callable[[], None]:
    def evaluate() -> None:
        dr.eval(run())

    return evaluate


def image(colors: Any) -> np.ndarray:
    """[1, P, 3], what can be shown of it."""
    return np.clip(np.stack([c.numpy() for c in colors], -1)[None], 0, 1)


def other_costs(splats: Splats, ray: mi.Ray3f, rounds: int) -> None:
    """Of derivatives, and of models whose primitives are all DoG; times are those of the tree and of the rays."""
    options, params = TraceOptions(splats.sh_degree), upload(splats)
    attached = {name: params[name] + 0 for name in RAW}
    dr.enable_grad(attached)

    def with_derivatives() -> None:
        dr.clear_grad(attached)
        colors, T = SplatTracer(params | attached, options).gather(ray)
        dr.backward(dr.sum(sum(colors) + T))
        dr.eval([dr.grad(value) for value in attached.values()])

    def of(params: dict) -> Callable[[], None]:
        return evaluated(lambda: SplatTracer(params, options).gather(ray))

    n = splats.n_splats
    runs = {"gather": of(params), "gather, with reverse-mode derivatives": with_derivatives}
    for F in (0.6, 1.6):
        dog = replace(splats, dog_index=np.arange(n, dtype=np.uint32), dog_logit_opacities=np.zeros(n),
                      dog_log_scales=np.full((n, 3), np.log(F)))
        runs[f"gather, all primitives DoG, f_a .5, F {F}"] = of(upload(dog))
    times = medians(runs, rounds, dict.fromkeys(runs, 1))
    for name, time in times.items():
        print(f"{name}: {time:.0f} ms, {time / times['gather']:.1f} of plain")
    print()


def build_times(splats: Splats) -> None:
    params, options = upload(splats), TraceOptions(splats.sh_degree)
    built: list = []

    def run() -> None:
        built[:] = [build(primitives_of(params, options.sh_degree), options.cutoffs.log2_range)]

    time = medians({"build": run}, 3, {"build": 1})["build"]
    print(f"tree: {time:.0f} ms, {4 * dr.width(built[0].nodes) / 2**20:.0f} MiB\n", flush=True)


def main(argv: Sequence[str] = ()) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks rays", description=__doc__)
    parser.add_argument("models", nargs="*", type=Path, default=MODELS, help="default: the still life, and playbot")
    parser.add_argument("--rays", type=int, default=65536, help="of each kind (default: %(default)s)")
    parser.add_argument("--rounds", type=at_least_one, default=5, help="(default: %(default)s)")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(argv)
    set_variant(args.variant)
    for path in args.models:
        splats = read_model(path).splats
        print(f"## {path.stem}: {splats.n_splats:,} primitives, SH degree {splats.sh_degree}\n")
        build_times(splats)
        beside_splatting(splats)
        print("| rays | what | ms | times as fast | PSNR to volprim_rf_basic |\n|---|---|---|---|---|")
        for name, make in {"coherent": camera_rays, "incoherent": floor_rays}.items():
            ray = make(splats, args.rays)
            runs = contestants(splats, ray)
            times = medians({key: evaluated(run) for key, run in runs.items()}, args.rounds, dict.fromkeys(runs, 1))
            base, truth = times["volprim_rf_basic"], image(runs["volprim_rf_basic"]())
            for key, time in times.items():
                found = runs[key]()
                same = f"{psnr(image(found), truth):.1f}" if len(found) == 3 else ""
                print(f"| {name} | {key} | {time:.0f} | {base / time:.1f} | {same} |", flush=True)
        print()
        other_costs(splats, floor_rays(splats, args.rays), args.rounds)
