"""gsplat's rasterization of our splats, to be timed. It is no requirement, so it is imported only when it is called."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats

NEAR = 0.2  # as DeviceCamera.upload has it


def missing() -> str | None:
    """Why gsplat cannot run here; None where it can."""
    for name in ("torch", "gsplat"):
        if importlib.util.find_spec(name) is None:
            return f"there is no package {name}"
    import torch  # pyright: ignore[reportMissingImports]

    return None if torch.cuda.is_available() else "PyTorch sees no GPU"


def passes(splats: Splats, camera: Camera) -> tuple[Callable[[], None], Callable[[], None]]:
    """Its forward pass, and that with the gradients of all parameters, through the same activations as ours."""
    import torch  # pyright: ignore[reportMissingImports]

    raw, draw = _prepared(splats, camera)
    adjoint = torch.from_numpy(np.random.default_rng(0).normal(size=(camera.height, camera.width, 3))).float().cuda()

    def forward() -> None:
        with torch.no_grad():
            draw()
        torch.cuda.synchronize()

    def forward_backward() -> None:
        for value in raw:
            value.grad = None
        draw().backward(adjoint)
        torch.cuda.synchronize()

    return forward, forward_backward


def picture(splats: Splats, camera: Camera) -> np.ndarray:
    """What it draws, [H, W, 3], over black."""
    return _prepared(splats, camera)[1]().detach().cpu().numpy()


def _prepared(splats: Splats, camera: Camera) -> tuple[list[Any], Callable[[], Any]]:
    """Raw parameters on the device, and a function that draws them, as a tensor [H, W, 3]."""
    import torch  # pyright: ignore[reportMissingImports]
    from gsplat import rasterization  # pyright: ignore[reportMissingImports]

    def upload(array: np.ndarray) -> Any:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).cuda()

    quats = splats.quats[:, [3, 0, 1, 2]]  # w first
    arrays = (splats.means, quats, splats.log_scales, splats.logit_opacities, splats.sh_coeffs)
    raw = [upload(array).requires_grad_() for array in arrays]
    means, quats, log_scales, logits, sh_coeffs = raw
    w2c, K = upload(camera.w2c)[None], upload(camera.K)[None]

    def draw() -> Any:
        colors, _, _ = rasterization(
            means, quats, log_scales.exp(), logits.sigmoid(), sh_coeffs, w2c, K, camera.width, camera.height,
            near_plane=NEAR, sh_degree=splats.sh_degree, packed=False,
        )
        return colors[0]

    return raw, draw
