"""The shade under the table top of scenes/still_life_in_the_light.xml: what models let through, and what they send.

``through`` is the mean transmittance of rays that meet the meshes which a model was trained from, ``beside`` what the
model takes from rays that miss them: 0 and 0 of a perfect model. The rays leave the floor in a circle of radius
``CIRCLE``, in cosine-distributed directions. ``shade`` is the mean radiance of the pixels of the floor in which the
truth has less than half of the light that there is without a model, ``black`` the same where the model sends no light.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.tracing.options import TraceOptions
from mi_dogsplat.tracing.tracer import SplatTracer

from .lit_runs import parsed, parser_of
from .lit_scenes import IN_PLACE, LIGHT, MODEL, empty, loaded, meshes_alone, of_meshes, picture
from .regions import regions

FLOOR, CIRCLE = -0.7, 1.9  # height; radius about the axis of the table
RAYS = 200_000
DEEP = 0.5  # of the light without a model


def rays_from_the_floor() -> Any:
    """``RAYS`` of them: mi.Ray3f."""
    pcg: Any = mi.PCG32
    random = pcg(RAYS)
    r, φ = CIRCLE * dr.sqrt(random.next_float32()), 2 * dr.pi * random.next_float32()
    above = mi.warp.square_to_cosine_hemisphere(mi.Point2f(random.next_float32(), random.next_float32()))
    return mi.Ray3f(mi.Point3f(r * dr.cos(φ), r * dr.sin(φ), FLOOR), above)


def passed(model: Path, ray: Any, meets: np.ndarray) -> tuple[float, float]:
    """(through, beside)"""
    splats = read_model(model).splats
    T = np.array(SplatTracer(upload(splats), TraceOptions(splats.sh_degree)).transmittance(ray))
    return float(T[meets].mean()), float(1 - T[~meets].mean())


def blackened(scene: Any) -> Any:
    """The scene, whose splats send no light from now on."""
    params: Any = mi.traverse(scene)
    name = next(name for name in params.keys() if name.endswith("sh_coeffs"))
    coefficients = np.zeros(params[name].shape, np.float32)
    coefficients[:, 0] = -10  # a radiance that is negative counts as none
    params[name] = mi.TensorXf(coefficients)
    params.update()
    return scene


def main(argv: list[str]) -> None:
    """Print the table."""
    parser = parser_of("shade", __doc__, (160, 120), 512)
    parser.add_argument("models", nargs="*", type=Path, default=[MODEL, IN_PLACE], help="(default: the two in scenes/)")
    parser.add_argument("--samples", type=int, default=32)
    args = parsed(parser, argv)
    size = args.size
    meshes = of_meshes(LIGHT)
    shown, alone = picture(meshes, args.truth, size), picture(empty(LIGHT), args.truth, size)
    deep = regions(meshes, shown, alone, size)["shadow"] & (shown.mean(-1) < DEEP * alone.mean(-1))
    black = picture(of_meshes(LIGHT, black=True), args.truth, size)
    ray, object_alone = rays_from_the_floor(), meshes_alone()  # the scene has to live until the rays are traced
    meets = np.array(object_alone.ray_intersect(ray).is_valid())
    print("| model | through | beside | shade | black |")
    print("|---|---|---|---|---|")
    print(f"| none | 1 | 0 | {alone[deep].mean():.4f} | |")
    print(f"| the meshes ({deep.sum()} pixels) | 0 | 0 | {shown[deep].mean():.4f} | {black[deep].mean():.4f} |")
    for model in args.models:
        scene = loaded(LIGHT, model)
        lit = picture(scene, args.samples, size)[deep].mean()
        unlit = picture(blackened(scene), args.samples, size)[deep].mean()
        through, beside = passed(model, ray, meets)
        figures = " | ".join(f"{value:.4f}" for value in (through, beside, lit, unlit))
        print(f"| {model.parent.name}/{model.name} | {figures} |", flush=True)
