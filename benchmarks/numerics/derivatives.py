"""Derivatives of ``mi.render`` by every kind of parameter against central differences: docs/derivatives.md.

What is derived is Σ A I, the image I under a fixed random image A, along a fixed direction of the parameter. Errors are
relative to the differences.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

from .derivative_cases import HEIGHT, SEED, TWIN_SPP, WIDTH, Case, broad_splats, cases, scene_with

HALVINGS = 6  # of the step of differences
TWIN_STEP = 1e-6


def render(*args: Any, **kwargs: Any) -> Any:
    """``mi.render``, whose stub asks for seeds that are arrays."""
    return mi.render(*args, **kwargs)


@dataclass(frozen=True)
class Film:
    """What is rendered: a pixel format, a reconstruction filter, samples per pixel."""

    pixel_format: str
    rfilter: str
    spp: int

    @property
    def adjoint(self) -> np.ndarray:
        """A [H, W, channels]: noise, and waves under which the changes of broad splats do not average out."""
        rng, channels = np.random.default_rng(0), 1 if self.pixel_format == "luminance" else 3
        y, x = ((np.arange(n) + 0.5) / n for n in (HEIGHT, WIDTH))
        waves = [np.cos(np.pi * k * y)[:, None, None] * np.cos(np.pi * j * x)[:, None] * rng.normal(size=channels)
                 for k in range(4) for j in range(4)]
        return (np.sum(waves, 0) + 0.5 * rng.normal(size=(HEIGHT, WIDTH, channels))).astype(np.float32)

    def scene(self, case: Case, splats: Splats) -> tuple[mi.Scene, Any, dict]:
        """(scene, its parameters, copies of their values, which an assignment would write into)."""
        scene = scene_with(case, splats, {"pixel_format": self.pixel_format, "rfilter": {"type": self.rfilter}})
        params: Any = mi.traverse(scene)
        values = {name: value for name, value in params if isinstance(value, mi.Float | mi.TensorXf)}
        return scene, params, {name: cast(Any, type(value))(value) for name, value in values.items()}

    def title(self) -> str:
        return f"{self.pixel_format}, {self.spp} " + ("spp" if self.spp == 1 else f"spp, {self.rfilter}")


FILMS = (Film("rgb", "box", 1), Film("rgb", "box", 4), Film("rgb", "gaussian", 4), Film("luminance", "box", 1),
         Film("luminance", "gaussian", 4))


def derived(case: Case, film: Film, splats: Splats, spp: int | None = None) -> tuple[float, float]:
    """By θ, in forward and in backward mode."""
    results = []
    for forward in (True, False):
        scene, params, at_0 = film.scene(case, splats)
        θ = mi.Float(0)
        dr.enable_grad(θ)
        for name, value in case.move(at_0, θ).items():
            params[name] = value
        params.update()
        image = render(scene, params, spp=spp or film.spp, seed=SEED + 1, seed_grad=SEED)
        if forward:
            dr.forward(θ)
            results.append(float(np.sum(film.adjoint.astype(np.float64) * dr.grad(image).numpy())))
        else:
            dr.backward(dr.sum(image * mi.TensorXf(film.adjoint), axis=None))
            results.append(float(dr.grad(θ).numpy()[0]))
    return results[0], results[1]


def differences(case: Case, film: Film, splats: Splats) -> tuple[float, float]:
    """(derivative by θ from differences of ``mi.render`` itself, by how much its best two estimates differ).

    Steps are halved from the longest on; pairs of steps are extrapolated (Richardson, h⁴). Of all neighbouring
    estimates those two are taken that agree best: long steps are curved, short ones are lost in rounding.
    """
    scene, params, at_0 = film.scene(case, splats)

    def loss(θ: float) -> float:
        for name, value in case.move(at_0, dr.opaque(mi.Float, θ)).items():
            params[name] = value
        params.update()
        image = render(scene, spp=film.spp, seed=SEED).numpy()
        return float(np.sum(film.adjoint.astype(np.float64) * image))

    steps = case.step * 0.5 ** np.arange(HALVINGS)
    central = np.array([(loss(h) - loss(-h)) / (2 * h) for h in steps.astype(np.float32).astype(np.float64).tolist()])
    better = (4 * central[1:] - central[:-1]) / 3
    apart = np.abs(np.diff(better))
    best = int(apart.argmin())
    return float(0.5 * (better[best] + better[best + 1])), float(apart[best])


def twin_difference(case: Case, splats: Splats) -> float:
    """The same of the float64 twin, with a step so small that no pixel crosses a cutoff."""
    assert case.twin is not None
    sides = [np.sum(FILMS[0].adjoint * case.twin(splats, side)) for side in (TWIN_STEP, -TWIN_STEP)]
    return float((sides[0] - sides[1]) / (2 * TWIN_STEP))


def rough_splats() -> Splats:
    """Of all sizes, opacities and orientations, half of them DoG: every cutoff is met somewhere."""
    rng, n = np.random.default_rng(4), 12
    dog = np.arange(0, n, 2, dtype=np.uint32)
    return Splats(
        means=rng.uniform([-1.5, -1.2, 1.5], [1.5, 1.2, 5], (n, 3)),
        log_scales=rng.uniform(-3.5, -0.8, (n, 3)),
        quats=rng.normal(size=(n, 4)),
        logit_opacities=rng.normal(0, 2, n),
        sh_coeffs=np.concatenate([rng.uniform(-1.7, 1.7, (n, 1, 3)), rng.normal(0, 0.2, (n, 8, 3))], 1),
        dog_index=dog,
        dog_logit_opacities=rng.normal(size=len(dog)),
        dog_log_scales=rng.normal(0.2, 0.4, (len(dog), 3)),
    )


def error(got: float, expected: float) -> str:
    return f"{abs(got / expected - 1):.0e}".replace("e-0", "e-")


def cells(case: Case, broad: Splats, rough: Splats) -> list[str]:
    """The row of a case: against the twin, then against ``mi.render`` for each film."""
    row = [case.name]
    if case.twin is None:
        row += ["", "no twin"]
    else:
        spp, expected = TWIN_SPP if case.least_spp > 1 else 1, twin_difference(case, rough)
        row += [f"{expected:.5g}", " / ".join(error(d, expected) for d in derived(case, FILMS[0], rough, spp))]
    for film in FILMS:
        if film.spp < case.least_spp:
            row.append("no effect")
            continue
        expected, apart = differences(case, film, broad)
        forward, backward = (error(d, expected) for d in derived(case, film, broad))
        row.append(f"{forward} / {backward} ({error(expected + apart, expected)})")
    return row


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks derivatives", description=__doc__)
    parser.add_argument("--only", default="", help="cases whose name holds this")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(argv)
    set_variant(args.variant)
    broad, rough = broad_splats(), rough_splats()
    titles = ["parameter", "derivative", "against the twin: rgb, 1 spp", *(film.title() for film in FILMS)]
    print("| " + " | ".join(titles) + " |\n" + "|---" * len(titles) + "|")
    for case in cases():
        if args.only in case.name:
            print("| " + " | ".join(cells(case, broad, rough)) + " |", flush=True)
