"""What a model loses that is stretched along one of its axes, in pictures from all around it.

Colours: the truth gives every primitive the colour that it had from where the direction came from, for each picture
anew; beside it the stretched model with its new coefficients, and with those that it had.

F: a model that is stretched across a view looks as it does by a lens whose focal length is longer along that axis.
That lens sees pseudo-Gaussians as the stretched model cannot have them; colours are of degree 0 there.

    python -m benchmarks stretched MODEL … [--factors 1.1 1.5 2] [--views 6]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.render.framing import cameras_around
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.linear_map import sh_projection
from mi_dogsplat.scene.sh_basis import C0, sh_basis_table
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.variants import set_variant

FACTORS = (1.1, 1.25, 1.5, 2.0, 3.0)


def seen(splats: Splats, camera: Camera) -> np.ndarray:
    """[H, W, 3] over black."""
    return render_picture(upload(splats), camera, RasterOptions(sh_degree=splats.sh_degree)).color


def of_colors(splats: Splats, cameras: list[Camera], factor: float) -> tuple[float, float]:
    """Mean squared errors of the stretched model, x times ``factor``: with its coefficients, with those of before."""
    linear = np.diag([factor, 1.0, 1.0])
    stretched = transformed(splats, affine(linear))
    errors = []
    for camera in cameras:
        directions = (stretched.means - np.linalg.inv(camera.w2c)[:3, 3]) @ np.linalg.inv(linear)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        colors = np.einsum("nk,nkc->nc", sh_basis_table(directions, splats.sh_degree), splats.sh_coeffs)
        constant = np.maximum(colors, -0.5)[:, None] / C0
        truth = seen(replace(stretched, sh_coeffs=constant), camera)
        ways = (stretched, replace(stretched, sh_coeffs=splats.sh_coeffs))
        errors.append([np.mean((seen(way, camera) - truth) ** 2) for way in ways])
    first, second = np.mean(errors, axis=0)
    return float(first), float(second)


def of_factors(splats: Splats, cameras: list[Camera], factor: float) -> float:
    """Mean squared error of the stretched model, long in x of each picture, against what the longer lens saw."""
    errors = []
    for camera in cameras:
        matrix = np.linalg.inv(camera.w2c) @ np.diag([factor, 1, 1, 1]) @ camera.w2c
        truth = seen(splats, replace(camera, fx=factor * camera.fx))
        errors.append(np.mean((seen(transformed(splats, matrix), camera) - truth) ** 2))
    return float(np.mean(errors))


def of_bands(factor: float, degree: int) -> float:
    """Share of a band's variance, over directions and coefficients, that the nearest function of its degree misses."""
    linear = np.diag([factor, 1.0, 1.0])
    heights, weights = np.polynomial.legendre.leggauss(64)
    angles = np.arange(128) * 2 * np.pi / 128
    z, angle = (grid.ravel() for grid in np.meshgrid(heights, angles, indexing="ij"))
    radius = np.sqrt(1 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    back = directions @ np.linalg.inv(linear).T
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    band = slice(degree**2, (degree + 1) ** 2)
    truth = sh_basis_table(back, degree)[:, band]
    found = sh_basis_table(directions, degree) @ sh_projection(linear, degree)[:, band]
    mean = np.repeat(weights, 128)[:, None] / 256
    return float((mean * (truth - found) ** 2).sum() / (mean * truth**2).sum())


def main(arguments: list[str]) -> None:
    """Print two tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks stretched", description=__doc__)
    parser.add_argument("models", nargs="*", type=Path)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--factors", type=float, nargs="+", default=FACTORS)
    parser.add_argument("--views", type=int, default=6)
    args = parser.parse_args(arguments)
    set_variant(args.variant)
    print("| stretch | degree 1 | degree 2 | degree 3 |\n" + "|---" * 4 + "|")
    for factor in args.factors:
        shares = " | ".join(f"{100 * of_bands(factor, degree):.1f} %" for degree in (1, 2, 3))
        print(f"| {factor:g} | {shares} |", flush=True)
    for path in args.models:
        splats = read_model(path).splats.uniform_sh()
        plain = replace(splats, sh_coeffs=splats.sh_coeffs[:, :1])
        cameras = [camera.downscaled(2) for camera in cameras_around(splats, args.views)]
        print(f"\n{path.name}: {splats.n_splats:,} primitives, {splats.n_dog:,} DoG, degree {splats.sh_degree}")
        print("| stretch | new coefficients | those of before | F, degree 0 |\n" + "|---" * 4 + "|")
        for factor in args.factors:
            errors = (*of_colors(splats, cameras, factor), of_factors(plain, cameras, factor))
            print(f"| {factor:g} | " + " | ".join(f"{-10 * np.log10(e):.1f} dB" for e in errors) + " |", flush=True)
