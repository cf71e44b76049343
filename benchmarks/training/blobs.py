"""A small model whose pictures anybody can learn from: training on them can only succeed."""

from __future__ import annotations

import numpy as np
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats


def blobs(n: int = 60, seed: int = 0) -> Splats:
    """Coloured blobs within the unit ball, of SH degree 1 with a small view-dependent part."""
    rng = np.random.default_rng(seed)
    sh_coeffs = rng.normal(size=(n, 4, 3)) * 0.05
    sh_coeffs[:, 0] = (rng.uniform(0.05, 0.95, (n, 3)) - 0.5) / C0
    return Splats(
        means=rng.uniform(-0.6, 0.6, (n, 3)),
        log_scales=np.log(rng.uniform(0.06, 0.2, (n, 3))),
        quats=rng.normal(size=(n, 4)),
        logit_opacities=rng.uniform(0.5, 3, n),
        sh_coeffs=sh_coeffs,
    )
