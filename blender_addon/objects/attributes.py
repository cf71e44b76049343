"""Models as attributes of a mesh of loose vertices, and back.

Names and types are those of Blender 5.3's own splats (``scale``, ``rotation``, ``radiance:*``) plus ``dog:*``.
Activated values are what nodes and people use; the raw values beside them let an export give back the very bits of the
file.
"""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ..files.model import (
    CURVATURES,
    CUTS,
    SECOND_CUTS,
    SHIFTS,
    SLOPES,
    Model,
    RowGroup,
    importance,
    logit,
    normalized,
    positive_log,
    sigmoid,
)
from .columns import Geometry, get_column, put_column

SCALE, ROTATION, BASE, SH = "scale", "rotation", "radiance:base", "radiance:sh_{}"
OPACITY_FACTOR, SCALE_FACTOR = "dog:opacity_factor", "dog:scale_factor"
SLOPE_VECTORS = tuple(f"dog:slope_{axis}" for axis in "xyz")  # along that axis of the splat
# A brightness has the same values in every working space: white is (1, 1, 1) in each, so grey stays grey
CURVATURE_SQUARES = "dog:curvature_squares"  # xx, yy, zz of its matrix
CURVATURE_VECTORS = (CURVATURE_SQUARES, "dog:curvature_products")  # xy, xz, yz
OF_GROUPS = {  # where any splat has rows of the group: the attribute that is 1 for those, and their vectors
    SLOPES: ("dog:has_slopes", SLOPE_VECTORS),
    CURVATURES: ("dog:has_curvatures", CURVATURE_VECTORS),
    CUTS: ("dog:has_cuts", ("dog:cut_normal",)),
    SECOND_CUTS: ("dog:has_second_cuts", ("dog:second_cut_normal",)),
    SHIFTS: ("dog:has_shifts", (*(f"dog:shift_{axis}" for axis in "xyz"), "dog:mean_view")),
}
RAW_LOGITS = "dog:raw_logits"  # logit opacity, logit of the opacity factor, 0
RAW_SCALE, RAW_ROTATION, RAW_FACTOR = "dog:raw_scale", "dog:raw_rotation", "dog:raw_factor"
NATIVE_SCALE, NATIVE_OPACITY = "dog:native_scale", "dog:native_opacity"  # as baked: how edits of them are noticed
RAW_POSITION = "dog:raw_position"  # where the splat's other attributes were right; see ``editing/following.py``
RANK = "dog:rank"  # 0 for the most important splat, below 1 for the least, so that a share is a prefix
ERASE, TINT = "Erase", "Tint"  # painted
PAINT_INDEX, PAINT_OWNER = "paint:index", "paint:owner"  # which part of which stand-in is the splat's


def write_attributes(mesh: bpy.types.Mesh, model: Model) -> None:
    """Fill an empty mesh with a vertex per primitive, or give those that it has other values; the rest stays."""
    if not mesh.vertices:
        mesh.vertices.add(model.n_splats)
    put_columns(mesh, model, "FLOAT_COLOR")
    mesh.update()


def put_columns(geometry: Geometry, model: Model, base_kind: str) -> None:
    """Store a model as attributes of as many points; ``base_kind`` is the type of ``radiance:base``."""
    geometry.attributes["position"].data.foreach_set("vector", model.means.ravel())
    put_column(geometry, RAW_POSITION, model.means)
    if RANK not in geometry.attributes:
        put_column(geometry, RANK, importance_ranks(model))
    base, values = _activated(model)
    put_column(geometry, BASE, base, base_kind)
    for name, (kind, array) in values.items():
        put_column(geometry, name, array, kind)
    for k in range(1, model.sh_coeffs.shape[1]):
        put_column(geometry, SH.format(k - 1), model.sh_coeffs[:, k])
    for name, array in (_raw(model) | _groups(model)).items():
        put_column(geometry, name, array)


def importance_ranks(model: Model) -> np.ndarray:
    """[N] in [0, 1): the share of the primitives that are more important."""
    return _shares_before(-importance(model))


def spread_ranks(mesh: bpy.types.Mesh) -> None:
    """Give what is left of a model ranks from 0 on again, in its order, so that a share is a share of what is left.

    Ranks end at one less than their number, as a share of it. So those that end elsewhere are of other splats. Where
    few of very many are missing single precision does not tell, and a share is hardly another.
    """
    if RANK not in mesh.attributes or not mesh.vertices:
        return
    ranks, n = get_column(mesh, RANK, 1)[:, 0], len(mesh.vertices)
    if ranks.max() != np.float32((n - 1) / n):
        put_column(mesh, RANK, _shares_before(ranks))


def _shares_before(values: np.ndarray) -> np.ndarray:
    """[N] in [0, 1): the share of the N values that come before each, the smallest first."""
    shares = np.empty(len(values), np.float32)
    shares[np.argsort(values, kind="stable")] = np.arange(len(values)) / max(len(values), 1)
    return shares


def is_splats(obj: bpy.types.Object | None) -> bool:
    """Whether an object holds splats of ours."""
    return obj is not None and obj.type == "MESH" and BASE in obj.data.attributes


def is_native(obj: bpy.types.Object | None) -> bool:
    """Whether an object holds splats as Blender draws them itself, whoever made them."""
    return obj is not None and obj.type == "POINTCLOUD" and BASE in obj.data.attributes


def has_splats(obj: bpy.types.Object | None) -> bool:
    """Either of them."""
    return is_splats(obj) or is_native(obj)


def has_any(obj: bpy.types.Object, *groups: RowGroup) -> bool:
    """Whether any of its splats may have rows of one of these, such as slopes, which Blender's engines do not draw."""
    return any(OF_GROUPS[group][0] in obj.data.attributes for group in groups)


def can_edit(obj: bpy.types.Object | None) -> bool:
    """Whether an object holds splats of ours that this file may change."""
    return is_splats(obj) and _is_local(obj)


def can_edit_native(obj: bpy.types.Object | None) -> bool:
    """The same of splats that Blender draws itself."""
    return is_native(obj) and _is_local(obj)


def _is_local(obj: bpy.types.Object) -> bool:
    return obj.library is None and obj.override_library is None


def own_data(obj: bpy.types.Object) -> None:
    """Give an object splats that no other object has, and no other file, before they are changed."""
    if obj.data.users > 1 or obj.data.library is not None:
        obj.data = obj.data.copy()


def read_attributes(mesh: Geometry) -> Model:
    """The model that a mesh or point cloud holds: raw values of the file where nobody changed them, else the activated.

    Raises ``ValueError`` that names an attribute that is missing.
    """
    return model_of(mesh, get_column(mesh, SCALE, 3), get_column(mesh, BASE, 4))


def model_of(mesh: Geometry, scale: np.ndarray, base: np.ndarray) -> Model:
    """The same with these scales [N, 3], colours and opacities [N, 4] in place of its own."""
    now = {SCALE: scale, ROTATION: get_column(mesh, ROTATION, 4), **_dog_values(mesh, len(base))}
    edited = Model(
        means=get_column(mesh, "position", 3),
        log_scales=positive_log(now[SCALE]),
        quats=now[ROTATION],
        logit_opacities=logit(base[:, 3]),
        sh_coeffs=_bands(mesh, base),
        is_dog=now[OPACITY_FACTOR] > 0,
        dog_logit_opacities=logit(now[OPACITY_FACTOR]),
        dog_log_scales=positive_log(now[SCALE_FACTOR]),
        **_group_values(mesh, len(base)),
    )
    if not all(name in mesh.attributes for name in (RAW_LOGITS, RAW_SCALE, RAW_ROTATION, RAW_FACTOR)):
        return edited
    logits = get_column(mesh, RAW_LOGITS, 3)
    raw = replace(
        edited,
        log_scales=get_column(mesh, RAW_SCALE, 3),
        quats=get_column(mesh, RAW_ROTATION, 4),
        logit_opacities=logits[:, 0],
        dog_logit_opacities=logits[:, 1],
        dog_log_scales=get_column(mesh, RAW_FACTOR, 3),
    )
    raw_base, shown = _activated(raw)
    same = {name: _rows(values == shown[name][1]) for name, values in now.items()}
    untouched = {
        "log_scales": same[SCALE],
        "quats": same[ROTATION],
        "logit_opacities": base[:, 3] == raw_base[:, 3],
        "dog_logit_opacities": same[OPACITY_FACTOR],
        "dog_log_scales": same[SCALE_FACTOR],
    }
    return replace(edited, **{name: _chosen(rows, raw, edited, name) for name, rows in untouched.items()})


def _dog_values(mesh: Geometry, n: int) -> dict[str, np.ndarray]:
    """Factors of the pseudo-Gaussians, [N] and [N, 3]; of a plain model those that say so."""
    if OPACITY_FACTOR not in mesh.attributes:
        return {OPACITY_FACTOR: np.zeros(n, np.float32), SCALE_FACTOR: np.ones((n, 3), np.float32)}
    return {OPACITY_FACTOR: get_column(mesh, OPACITY_FACTOR, 1)[:, 0], SCALE_FACTOR: get_column(mesh, SCALE_FACTOR, 3)}


def _group_values(mesh: Geometry, n: int) -> dict[str, np.ndarray]:
    """The arrays of each group of rows, by their names in a ``Model``."""
    found: dict[str, np.ndarray] = {}
    for group, (has, names) in OF_GROUPS.items():
        if has in mesh.attributes:
            rows = np.stack([get_column(mesh, name, 3) for name in names], axis=1)
            found |= {group.has: get_column(mesh, has, 1)[:, 0] > 0, group.values: rows.reshape(n, *group.shape)}
        else:
            found |= group.of_none(n)
    return found


def _bands(mesh: Geometry, base: np.ndarray) -> np.ndarray:
    """Spherical harmonics [N, K, 3], of as many whole bands as there are."""
    degree = next(d for d in (3, 2, 1, 0) if d == 0 or SH.format((d + 1) ** 2 - 2) in mesh.attributes)
    rest = (get_column(mesh, SH.format(k), 3) for k in range((degree + 1) ** 2 - 1))
    return np.stack([base[:, :3], *rest], axis=1)


def _rows(equal: np.ndarray) -> np.ndarray:
    """[N]: where all of a row [N] or [N, width] is true."""
    return equal if equal.ndim == 1 else equal.all(axis=1)


def _chosen(rows: np.ndarray, raw: Model, edited: Model, name: str) -> np.ndarray:
    """Values of the one model in these rows [N], of the other one in the rest."""
    first, second = getattr(raw, name), getattr(edited, name)
    return np.where(rows.reshape(-1, *[1] * (first.ndim - 1)), first, second)


def get_positions(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray] | None:
    """Positions at which the other attributes were right, and those of now, [N, 3]; None for models of before."""
    if RAW_POSITION not in mesh.attributes:
        return None
    return get_column(mesh, RAW_POSITION, 3), get_column(mesh, "position", 3)


def put_positions(mesh: bpy.types.Mesh, positions: np.ndarray) -> None:
    """Move the splats of a mesh, whose other attributes are right there."""
    mesh.attributes["position"].data.foreach_set("vector", positions.ravel())
    put_column(mesh, RAW_POSITION, positions)
    mesh.update()


def _activated(model: Model) -> tuple[np.ndarray, dict[str, tuple[str, np.ndarray]]]:
    """(base [N, 4], the other activated attributes as name -> (type, values)), float32, as they are stored."""
    base = np.concatenate([model.sh_coeffs[:, 0], sigmoid(model.logit_opacities)[:, None]], axis=1)
    with np.errstate(over="ignore"):
        factor = np.where(model.is_dog, np.maximum(sigmoid(model.dog_logit_opacities), np.float32(1e-30)), 0)
        scale_factor = np.where(model.is_dog[:, None], np.exp(model.dog_log_scales), np.float32(1))
        values = {
            SCALE: ("FLOAT_VECTOR", np.exp(model.log_scales)),
            ROTATION: ("QUATERNION", normalized(model.quats)),
            OPACITY_FACTOR: ("FLOAT", factor),
            SCALE_FACTOR: ("FLOAT_VECTOR", scale_factor),
        }
    return base.astype(np.float32), {name: (kind, array.astype(np.float32)) for name, (kind, array) in values.items()}


def _raw(model: Model) -> dict[str, np.ndarray]:
    logits = np.stack([model.logit_opacities, model.dog_logit_opacities, np.zeros(model.n_splats)], axis=1)
    values = {RAW_LOGITS: logits, RAW_SCALE: model.log_scales, RAW_ROTATION: model.quats,
              RAW_FACTOR: model.dog_log_scales}  # fmt: skip
    return {name: array.astype(np.float32) for name, array in values.items()}


def _groups(model: Model) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    for group, (has, names) in OF_GROUPS.items():
        values = getattr(model, group.values)
        if values.shape[1]:
            along = values.reshape(-1, len(names), 3).swapaxes(0, 1)
            found |= {has: getattr(model, group.has).astype(np.int32), **dict(zip(names, along, strict=True))}
    return found
