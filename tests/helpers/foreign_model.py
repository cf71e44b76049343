"""A model whose files in ``foreign`` other programs wrote: ``splat-transform`` of PlayCanvas (MIT), and an OpenUSD.

Of ``write_ply("f.ply", model())``. Version 2.7.1: ``splat-transform --spz-version 3 f.ply model.spz``,
``--spz-version 4 f.ply model_4.spz``, ``f.ply model.glb``. Version 3.7.0:
``-g cpu f.ply model.sog``, ``f.ply model.compressed.ply``, and ``f.ply model_mip.compressed.ply`` with the comment
``SplatRenderMode: mip`` in the header of ``f.ply``. NVIDIA's ``usd-convert-gsplat`` 0.1.15 (Apache-2.0) wrote
``model.usda``: ``usd-convert-gsplat -i f.ply -o model.usda``.
"""

from pathlib import Path

import numpy as np
from mi_dogsplat.scene.splats import Splats

FOLDER = Path(__file__).parent / "foreign"
FILES = ("model.compressed.ply", "model_mip.compressed.ply", "model.glb", "model.sog", "model.spz", "model_4.spz")
N = 12


def model() -> Splats:
    """Twelve Gaussians of SH degree 2, all different in every value."""
    rng = np.random.default_rng(7)
    return Splats(
        means=rng.uniform(-3, 3, (N, 3)),
        log_scales=rng.uniform(-5, 0, (N, 3)),
        quats=rng.normal(size=(N, 4)),
        logit_opacities=rng.normal(size=N),
        sh_coeffs=rng.normal(0, 0.3, (N, 9, 3)),
    )
