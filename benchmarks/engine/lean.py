"""The engine against a hand-stripped renderer of plain Gaussians, and what a share of DoG primitives costs.

Both tables are timed in turns. In the second, DoG primitives are chosen at random, or as the leftmost of the model, so
that whole tiles meet none; ``met`` is the share of the isects that are DoG. The plain model has no DoG arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.arrays import backward
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import RAW, RAW_OF_GROUPS, upload
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats

from ..models import fern_points
from ..timing import medians, ratio
from . import plain_renderer

SHARES = (0.0, 0.01, 0.1, 0.5, 1.0)
DOG_OPACITY, DOG_SCALE = 0.05, 0.6  # f_a and F with which the preset "ours" starts
ROUNDS = 15


def main() -> None:
    splats, camera = fern_points()
    splats.sh_coeffs = np.ascontiguousarray(splats.sh_coeffs[:, :1])
    against_the_stripped_renderer(splats, camera)
    shares_of_dog(splats, camera)


def against_the_stripped_renderer(splats: Splats, camera: Camera) -> None:
    passes = {
        "forward": (engine_forward(splats, camera), stripped_forward(splats, camera)),
        "forward+backward": (engine_backward(splats, camera), stripped_backward(splats, camera)),
    }
    print(f"{splats.n_splats:,} plain Gaussians of SH degree 0, {camera.width}x{camera.height}")
    for name, pair in passes.items():
        r = ratio(*pair)
        print(f"{name:18s} engine {r.a_ms:6.2f} ms, hand-stripped {r.b_ms:6.2f} ms = {r.median:.3f}x "
              f"({r.low:.3f} .. {r.high:.3f}; target 1.02x)", flush=True)


def shares_of_dog(splats: Splats, camera: Camera) -> None:
    left = np.argsort(camera.project(splats.means)[0][:, 0])  # from the left border of the image
    orders = {"random": np.random.default_rng(0).permutation(splats.n_splats), "leftmost": left}
    models = {
        (where, share): with_dog(splats, order[: round(share * splats.n_splats)])
        for where, order in orders.items()
        for share in SHARES
        if where == "random" or 0 < share < 1
    }
    contestants: dict[str, Callable[[], None]] = {}
    for (where, share), model in models.items():
        contestants[f"{where} {share} forward"] = engine_forward(model, camera)
        contestants[f"{where} {share} both"] = engine_backward(model, camera)
    ms = medians(contestants, ROUNDS)
    print("DoG share            met    forward           forward+backward")
    for (where, share), model in models.items():
        cells = [
            f"{ms[f'{where} {share} {p}']:6.2f} ms {ms[f'{where} {share} {p}'] / ms[f'random 0.0 {p}']:5.2f}x"
            for p in ("forward", "both")
        ]
        print(f"{share:5.0%} {where:12s} {share_met(model, camera):5.0%}    {cells[0]}   {cells[1]}")


def with_dog(splats: Splats, index: np.ndarray, opacity: float = DOG_OPACITY, scale: float = DOG_SCALE) -> Splats:
    """A plain model with the primitives ``index`` made DoG, of one f_a and F."""
    return replace(
        splats,
        dog_index=np.sort(index).astype(np.uint32),
        dog_logit_opacities=np.full(len(index), np.log(opacity / (1 - opacity))),
        dog_log_scales=np.full((len(index), 3), np.log(scale)),
    )


def share_met(splats: Splats, camera: Camera) -> float:
    """Part of the isects that are DoG primitives."""
    lists = rasterize(upload(splats), DeviceCamera.upload(camera), RasterOptions(0)).lists
    assert lists is not None
    return float(np.isin(lists.splat_from_isect.numpy(), splats.dog_index).mean())


def engine_forward(splats: Splats, camera: Camera, sh_degree: int = 0) -> Callable[[], None]:
    params, view, options = upload(splats), DeviceCamera.upload(camera), RasterOptions(sh_degree)

    def run() -> None:
        frame = rasterize(params, view, options)
        dr.eval(frame.colors, frame.T)

    return run


def stripped_forward(splats: Splats, camera: Camera) -> Callable[[], None]:
    params, view = upload(splats), DeviceCamera.upload(camera)

    def run() -> None:
        dr.eval(plain_renderer.render(params, view))

    return run


def engine_backward(splats: Splats, camera: Camera, sh_degree: int = 0) -> Callable[[], None]:
    view, options, δcolors = DeviceCamera.upload(camera), RasterOptions(sh_degree), adjoints(camera)

    return gradients(splats, lambda params: backward(rasterize(params, view, options).colors, δcolors))


def stripped_backward(splats: Splats, camera: Camera) -> Callable[[], None]:
    view = DeviceCamera.upload(camera)
    δcolors = [dr.detach(δ, preserve_type=False) for δ in adjoints(camera)]
    return gradients(splats, lambda params: plain_renderer.backward(params, view, δcolors))


def gradients(splats: Splats, propagate: Callable[[dict], None]) -> Callable[[], None]:
    """A pass that accumulates gradients on the parameters, evaluates and forgets them."""
    params = upload(splats)
    values = [params[name] for name in RAW + RAW_OF_GROUPS if name in params]
    dr.enable_grad(values)

    def run() -> None:
        propagate(params)
        dr.eval([dr.grad(value) for value in values])
        dr.clear_grad(values)

    return run


def adjoints(camera: Camera) -> list:
    rng = np.random.default_rng(0)
    δcolors = [mi.Float(rng.normal(size=camera.width * camera.height).astype(np.float32)) for _ in range(3)]
    dr.make_opaque(δcolors)
    return δcolors
