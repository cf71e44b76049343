"""``dogsplat`` against Mitsuba's ``volprim_rf_basic`` on the same splats, through ``mi.render``, in one run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
from mi_dogsplat import to_dog
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.scene.splats import Splats

from ..models import CASES
from ..timing import medians


def scenes(splats: Splats, camera: Camera) -> dict[str, mi.Scene]:
    """A scene for each renderer, of the same splats and camera."""
    sensor = camera_to_mitsuba(camera) | {"sampler": {"type": "independent", "sample_count": 1}}
    sensor["film"] |= {"rfilter": {"type": "box"}}
    tensor = mi.TensorXf
    theirs = {
        "type": "ellipsoids",
        "centers": tensor(splats.means),
        "scales": tensor(splats.scales),
        "quaternions": tensor(splats.quats),
        "opacities": tensor(splats.opacities[:, None]),
        "sh_coeffs": tensor(splats.sh_coeffs.reshape(splats.n_splats, -1)),
        "extent": 3.0,
        "extent_adaptive_clamping": True,
    }
    integrators = {
        "ours": {"type": "dogsplat", "near_clip": 0.01},
        "volprim": {"type": "volprim_rf_basic", "srgb_primitives": True},
    }
    shapes = {"ours": to_dog(splats), "volprim": theirs}
    return {
        name: mi.load_dict({"type": "scene", "integrator": integrators[name], "sensor": sensor, "splats": shapes[name]})
        for name in integrators
    }


def passes(scene: mi.Scene) -> tuple[Callable[[], None], Callable[[], None]]:
    """Its forward pass, and that with the gradients of all parameters of its splats."""
    params: Any = mi.traverse(scene)
    ours = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")
    keys = [k for k in params.keys() if k.startswith("splats.") and k.split(".")[1] in (*ours, "data", "opacities")]

    def forward():
        dr.eval(mi.render(scene, spp=1))

    def forward_backward():
        for key in keys:
            params[key] = mi.TensorXf(dr.detach(params[key]))
            dr.enable_grad(params[key])
        params.update()
        dr.backward(dr.mean(mi.render(scene, params, spp=1), axis=None))
        dr.eval([dr.grad(params[key]) for key in keys])

    return forward, forward_backward


def main() -> None:
    for case, make in CASES.items():
        runs = {}
        splats, camera = make()
        for name, scene in scenes(splats, camera).items():
            runs[f"{name} forward"], runs[f"{name} forward+backward"] = passes(scene)
        result = medians(runs, 5, {name: 1 for name in runs if name.startswith("volprim")})
        for kind in ("forward", "forward+backward"):
            ours, theirs = result[f"ours {kind}"], result[f"volprim {kind}"]
            print(
                f"{case:26s} {splats.n_splats:7,d} primitives, {kind:16s}: {ours:6.1f} ms, "
                f"volprim_rf_basic {theirs:7.1f} ms, {theirs / ours:6.1f}x",
                flush=True,
            )
