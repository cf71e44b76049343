"""A model as a point cloud of Blender's own splats, and back without a loss.

Blender draws ``scale`` and the opacity in ``radiance:base``, which are those of the baked Gaussians. The model's own
values are attributes beside them, and so is what was baked: where it still stands there, nobody changed it, and the
model's own bits come back. A scale or opacity that was changed changes the model's own by the same factor.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..files.model import Model, sigmoid
from .attributes import (
    BASE,
    NATIVE_OPACITY,
    NATIVE_SCALE,
    RAW_LOGITS,
    RAW_SCALE,
    SCALE,
    model_of,
    put_columns,
    read_attributes,
)
from .columns import get_column, put_column
from .feature import TYPE


def write_cloud(cloud: bpy.types.PointCloud, model: Model, plain: Model) -> None:
    """Fill an empty point cloud with a model, drawn as ``plain``, as many Gaussians in the same order."""
    cloud.type = TYPE
    cloud.resize(model.n_splats)
    put_columns(cloud, model, "FLOAT4")
    scale, opacity = np.exp(plain.log_scales), sigmoid(plain.logit_opacities)
    put_column(cloud, SCALE, scale)
    put_column(cloud, BASE, np.concatenate([model.sh_coeffs[:, 0], opacity[:, None]], axis=1), "FLOAT4")
    put_column(cloud, NATIVE_SCALE, scale)
    put_column(cloud, NATIVE_OPACITY, opacity)
    cloud.update_tag()


def read_cloud(cloud: bpy.types.PointCloud) -> Model:
    """The model of a point cloud, DoG included, with what was edited; of one that is not ours its plain Gaussians.

    Raises ``ValueError`` that names an attribute that is missing.
    """
    if not all(name in cloud.attributes for name in (NATIVE_SCALE, NATIVE_OPACITY, RAW_SCALE, RAW_LOGITS)):
        return read_attributes(cloud)
    scale, base = get_column(cloud, SCALE, 3), get_column(cloud, BASE, 4)
    own_scale, own_opacity = np.exp(get_column(cloud, RAW_SCALE, 3)), sigmoid(get_column(cloud, RAW_LOGITS, 3)[:, 0])
    base[:, 3] = _unbaked(base[:, 3], get_column(cloud, NATIVE_OPACITY, 1)[:, 0], own_opacity)
    return model_of(cloud, _unbaked(scale, get_column(cloud, NATIVE_SCALE, 3), own_scale), base)


def _unbaked(now: np.ndarray, drawn: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The model's own values, changed as those that are drawn were; points that came later have no own ones."""
    ours = drawn > 0
    factor = np.divide(now, drawn, out=np.ones_like(now), where=ours)
    return np.where(ours, np.where(now == drawn, own, own * factor), now)
