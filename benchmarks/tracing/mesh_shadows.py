"""``mesh_shadows`` of ``dogpath`` beside the path-traced truth: mean error where the camera sees the model.

The scenes are scenes/still_life_in_the_shade.xml, where boards shade the model, and scenes/still_life_in_the_light.xml,
where only what it stands among does. Their truth has the meshes that the model was trained from; the model of both is
still_life.ply. Errors are as of ``dogpath.py``. "picture": of the rendered picture, whose model has an error
of its own. "shadow": of the meshes in the light of the capture, without anything around them, times the ratio of the
two pictures with and without ``mesh_shadows``: so what is wrong with the shadows alone.
"""

from __future__ import annotations

import time

import drjit as dr
import numpy as np
from mi_dogsplat.plugin.shadow_ratios import estimated

from .error_table import display
from .lit_runs import parsed, parser_of
from .lit_scenes import LIGHT, MODEL, SHADE, loaded, of_meshes, picture
from .regions import regions

LEAST = 1e-4  # radiance, below which the ratio of two pictures says nothing


def main(argv: list[str]) -> None:
    """Print the tables."""
    parser = parser_of("mesh_shadows", __doc__, (160, 120), 512)
    parser.add_argument("--samples", nargs="+", type=int, default=[4, 16, 64, 256], help="per primitive")
    parser.add_argument("--spp", type=int, default=16)
    args = parsed(parser, argv)
    size = args.size
    for path in (SHADE, LIGHT):
        truth, model = of_meshes(path), loaded(path, MODEL)
        shown, captured = picture(truth, args.truth, size), picture(of_meshes(path, alone=True), args.truth, size)
        mask = regions(truth, shown, shown, size)["model"]

        def error(image: np.ndarray, shown: np.ndarray = shown, mask: np.ndarray = mask) -> float:
            return float(np.abs(display(image) - display(shown)).mean(-1)[mask].mean())

        integrator, shape = model.integrator(), next(s for s in model.shapes() if s.id() == "still_life")
        integrator.mesh_shadows = False
        plain = picture(model, args.spp, size)
        integrator.mesh_shadows = True
        print(f"{path.stem}: {mask.sum()} pixels of the model")
        print("| samples per primitive | seconds | picture | shadow |")
        print("|---|---|---|---|")
        print(f"| no shadows | | {error(plain):.4f} | {error(captured):.4f} |")
        for samples in args.samples:
            seconds = 0.0
            for _ in range(2):  # the first one compiles
                start = time.perf_counter()
                ratios = estimated(model, shape.parameters, integrator.max_depth, samples)
                dr.eval(ratios.front, ratios.back)
                dr.sync_thread()
                seconds = time.perf_counter() - start
            integrator.mesh_shadow_samples = samples
            image = picture(model, args.spp, size)
            ratio = np.where(plain > LEAST, image / np.maximum(plain, LEAST), 1)
            print(f"| {samples} | {seconds:.2f} | {error(image):.4f} | {error(captured * ratio):.4f} |", flush=True)
