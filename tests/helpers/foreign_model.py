"""A model whose files in ``tests/foreign`` another program wrote: ``splat-transform`` 3.7.0 of PlayCanvas (MIT).

Made with ``write_ply("f.ply", model())`` and ``splat-transform --spz-version 3 f.ply model.spz``,
``splat-transform -g cpu f.ply model.sog``, ``splat-transform f.ply model.compressed.ply``.
It writes numbers to SPZ as they are; the specification has them in RUB axes.
"""

from pathlib import Path

import numpy as np
from mi_dogsplat.scene.splats import Splats

FOLDER = Path(__file__).parent / "foreign"
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
