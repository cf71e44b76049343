"""A model as Mitsuba's own shape ``ellipsoids``, which rays can meet: the way out of splatting into ray tracing.

What this buys with the integrator ``volprim_rf_basic`` (a thin lens, any other sensor, meshes that stand in front), and
how its pictures differ from those of ``dogsplat``: docs/ellipsoids.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..formats.model import Model
from ..scene.finite import finite_in, finite_rows
from ..scene.quaternions import unit_quaternions
from ..scene.row_groups import BESIDE_DOG
from ..scene.splats import Splats
from ..scene.transform import transformed
from ..scene.whole import whole
from ..support.variants import require_variant
from ..support.wording import counted, in_words
from .given_model import model_of
from .properties import matrix_of

EXTENT = 3.0  # standard deviations, the default of Mitsuba; a Gaussian is 1.1 % of its peak there
MIN_OPACITY = 1 / 255  # fainter primitives are not drawn by ``dogsplat`` either
MIN_SCALE = 1e-6  # world units; Mitsuba's loader raises scales to this too, a ray divides by their squares in float32


def to_ellipsoids(
    model: Splats | Model | str | Path | mi.Shape, *, to_world: Any = None, extent: float = EXTENT
) -> dict:
    """A shape for ``mi.load_dict``, alone or in the dict of a scene, of type ``ellipsoids``.

    Its ``opacities`` [N', 1] and ``sh_coeffs`` [N', 3 K] (K = (degree + 1)²) are the attributes that
    ``volprim_rf_basic`` reads. The colours are sRGB, as its ``srgb_primitives`` expects by default; where a ``Model``,
    a file or a shape says that they are linear radiance a warning asks for ``srgb_primitives`` to be false.

    An ellipsoid is one whole Gaussian of one colour. Of a DoG primitive the positive Gaussian is kept, and what the
    pseudo-Gaussian subtracts is left out. Where a colour varies over its primitive its mean is kept. A primitive that
    planes cut off becomes the whole one nearest to it, and one whose place depends on the view stands where it is
    stored. Primitives that are not drawn are left out, too: those fainter than 1/255, and those with values that are
    not finite. A warning of Mitsuba's logger says what is left out.

    Args:
        model: primitives, with how they are drawn or alone, the path of a file in any format, or a loaded shape
            ``dog`` (its parameters of this moment).
        to_world: 4 x 4, any map that does not flatten (``mi.ScalarTransform4f``, ``mi.Transform4f`` or an array).
            Maps the spherical harmonics too; the shape's own ``to_world`` does not, and it refuses tensors.
        extent: radius of the shells in standard deviations. A ray meets a primitive where it enters its shell, in
            that order, so that a larger extent costs time and mixes up neighbours.

    Raises ``ValueError`` for a transform that flattens, an extent that is not positive, and a model of which
    nothing is left (Mitsuba divides by the number of ellipsoids); ``DataError`` for a file that is no model.
    """
    require_variant()
    if not extent > 0:
        raise ValueError(f"to_ellipsoids: extent is {extent}, it must be positive")
    model = model_of(model, "to_ellipsoids")
    splats, linear = model.splats, bool(model.drawing.linear)
    if to_world is not None:
        splats = transformed(splats, matrix_of(to_world))
    found = whole(splats.select(_drawn(splats)).plain())
    found = found.without_slopes().select(_drawn(found))
    _report(splats, splats.n_splats - found.n_splats, linear)
    splats = found.uniform_sh()
    if splats.n_splats == 0:
        raise ValueError("to_ellipsoids: the model has no primitive that can be seen; Mitsuba needs one")
    return {
        "type": "ellipsoids",
        "centers": mi.TensorXf(splats.means),
        "scales": mi.TensorXf(np.maximum(splats.scales, np.float32(MIN_SCALE))),
        "quaternions": mi.TensorXf(unit_quaternions(splats.quats).astype(np.float32)),
        "opacities": mi.TensorXf(splats.opacities[:, None]),
        "sh_coeffs": mi.TensorXf(splats.sh_coeffs.reshape(splats.n_splats, -1)),
        "extent": float(extent),  # extent_adaptive_clamping would save time, but is NaN for opacities below .01
    }


def _drawn(splats: Splats) -> np.ndarray:
    """[N] whether a primitive shows at all; a positive part may, though its pseudo-Gaussian is broken."""
    finite = finite_rows(splats.opacities, splats.means, splats.scales, splats.quats, splats.uniform_sh().sh_coeffs)
    return finite & (splats.opacities >= MIN_OPACITY) & finite_in(splats, BESIDE_DOG)


def _report(splats: Splats, n_hidden: int, linear: bool) -> None:
    """Warn of what the ellipsoids of ``splats`` have not, and of colours that need a setting."""
    log: Any = mi.Log
    if linear:
        log(mi.LogLevel.Warn, "to_ellipsoids: its colours are linear radiance; set srgb_primitives to false")
    parts = {"slopes": splats.n_slopes, "curvatures": splats.n_curvatures}
    parts |= {"cuts": int(splats.is_cut.sum()), "shifts": splats.n_shifts}
    left_out = [f"the negative part of {counted(splats.n_dog, 'DoG primitive')}"] if splats.n_dog else []
    left_out += [f"the {part} of {counted(n, 'primitive')}" for part, n in parts.items() if n]
    if n_hidden:
        left_out.append(f"{n_hidden} of {splats.n_splats} primitives that are fainter than 1/255 or not finite")
    if left_out:
        log(mi.LogLevel.Warn, f"to_ellipsoids: left out {in_words(left_out)}")
