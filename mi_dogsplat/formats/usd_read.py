"""Reading OpenUSD with Gaussians: all prims ParticleField3DGaussianSplat that a stage shows, where it has them.

References, payloads, layers and instances are those that the library resolves. Of what moves or changes the first
moment is taken. Where a prim has an attribute in float and in half, float holds; one that is too short is as if it were
not there, as the schema says.
"""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..scene.drawing import Drawing, drawing_of_extras
from ..scene.scales import SMALLEST_SCALE
from ..scene.splats import Array, Splats
from ..support.errors import DataError
from ..support.wording import counted
from .limits import in_proportion
from .model import Model
from .packing import RUB, logits
from .placed import in_one_place, require_alike
from .usd_stage import layers_of, metres_of, missing, moments_of, opened, upright, world_of

if TYPE_CHECKING:
    from pxr import Usd

TYPE = "ParticleField3DGaussianSplat"
DEGREE, COEFFICIENTS = "radiance:sphericalHarmonicsDegree", "radiance:sphericalHarmonicsCoefficients"
USUAL_DEGREE = 3  # the schema's, where a prim says nothing
MOST_DEGREE = 3  # that there is room for here
LINEAR, DISPLAY = "lin_rec709_scene", "srgb_rec709_scene"  # OpenUSD's names of colour spaces
HIDDEN = ("guide", "proxy")  # purposes of what no picture shows
GREY = [0.0, 0.0, 0.0]  # coefficients of a colour of one half
FIRST = -sys.float_info.max  # the time code that the library calls the earliest
NEAR = 0.01  # of the size of a model: the median by which centres of the same one may differ


def read(path: Path) -> Model:
    """The Gaussians of a file, in RUB axes. Raises ``DataError``."""
    with opened(path) as stage:
        prims, lines = _shown(stage)
        if not prims:
            why = f" ({'; '.join(lines)})" if lines else ""
            raise DataError(path, f"holds no prim {TYPE} that is shown{why}", "export it as Gaussians")
        size = sum(layer.stat().st_size for layer in layers_of(stage) if layer.is_file())
        found = list(in_proportion(_models(stage, prims), size))
        require_alike(path, found)
        model = in_one_place(found, RUB)
        if metres := metres_of(stage):
            model = replace(model, drawing=replace(model.drawing, scale=(model.drawing.scale or 1.0) * metres))
    return replace(model, left_out=(*model.left_out, *lines))


def files_beside(path: Path) -> list[Path]:
    """The files, other than itself, that a file is made of: layers that it names. Raises ``DataError``."""
    with opened(path) as stage:
        return [layer for layer in layers_of(stage) if layer.resolve() != path.resolve()]  # a folder may be a link


def place_of(stage: Usd.Stage, means: Array) -> tuple[Callable[[float], Array], set[float]] | None:
    """The matrix [4, 4], at a time code, from a model with these centres [N, 3], in RUB axes, to x right, y up, z back
    of a stage that shows it, and the time codes at which it is said rather than interpolated; None where the stage does
    not show it, or shows other Gaussians, too.

    It is the model if there are as many primitives, and near: a file may be refined, or rounded.
    """
    from pxr import UsdGeom

    prims, _ = _shown(stage)
    held = _column(prims[0], "positions", 3) if len(prims) == 1 else None
    if held is None or len(held) != len(means):
        return None
    name = prims[0].GetPath()  # a prim alone does not keep its stage

    def place(time: float) -> Array:
        return upright(stage) @ world_of(stage.GetPrimAtPath(name), UsdGeom.XformCache(time))

    first = place(FIRST)
    size, off, off_there = (
        np.median(np.abs(means - centres).max(axis=1))
        for centres in (np.median(means, axis=0), held, held @ first[:3, :3].T + first[:3, 3])
    )
    if not off <= NEAR * size or off_there < off:  # what was read from the stage has been moved to its place by then
        return None
    return place, moments_of(prims[0]) or {FIRST}


def _shown(stage: Usd.Stage) -> tuple[list[Usd.Prim], list[str]]:
    """The prims of Gaussians that a picture shows, and a line for each thing that is left out."""
    from pxr import Usd, UsdGeom

    shown, hidden, instancers = [], [], 0
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):  # its prototypes are below it, and are not shown by themselves
            instancers += _repeats_gaussians(stage, prim)
            prims.PruneChildren()
        elif prim.GetTypeName() == TYPE:
            seen = UsdGeom.Imageable(prim)
            if seen.ComputeVisibility(FIRST) == UsdGeom.Tokens.invisible or seen.ComputePurpose() in HIDDEN:
                hidden.append(prim)
            else:
                shown.append(prim)
    lines = [f"{counted(len(hidden), 'prim')} not shown"] * bool(hidden)
    lines += [f"Gaussians of {counted(instancers, 'point instancer')}"] * bool(instancers)
    lines += missing(stage)
    if any(_changes(prim) for prim in (*shown, *hidden)):
        lines.append("what changes with time: the first moment is used")
    return shown, lines


def _repeats_gaussians(stage: Usd.Stage, prim: Usd.Prim) -> bool:
    """Whether Gaussians are among the prototypes of a point instancer, which lie below it or anywhere else."""
    from pxr import Usd, UsdGeom

    named = UsdGeom.PointInstancer(prim).GetPrototypesRel().GetForwardedTargets()
    roots = (prim, *filter(None, map(stage.GetPrimAtPath, named)))
    everything = Usd.PrimAllPrimsPredicate  # also a class, which is not shown by itself
    return any(below.GetTypeName() == TYPE for root in roots for below in Usd.PrimRange(root, everything))


def _changes(prim: Usd.Prim) -> bool:
    """Whether the Gaussians of a prim, their place, or whether they are shown, are others at another time."""
    from pxr import UsdGeom

    if any(attribute.ValueMightBeTimeVarying() for attribute in prim.GetAuthoredAttributes()):
        return True
    place: Any = prim
    while place and not place.IsPseudoRoot():
        if UsdGeom.Xformable(place) and UsdGeom.Xformable(place).TransformMightBeTimeVarying():
            return True
        if UsdGeom.Imageable(place) and UsdGeom.Imageable(place).GetVisibilityAttr().ValueMightBeTimeVarying():
            return True
        place = place.GetParent()
    return False


def _models(stage: Usd.Stage, prims: list[Usd.Prim]) -> Iterator[tuple[Model, Array]]:
    """The model of each prim, and the matrix [4, 4] to x right, y up, z back."""
    from pxr import UsdGeom

    cache, axes = UsdGeom.XformCache(FIRST), upright(stage)
    for prim in prims:
        yield _of_prim(prim), axes @ world_of(prim, cache)


def _of_prim(prim: Usd.Prim) -> Model:
    means = _column(prim, "positions", 3)
    means, left_out = np.zeros((0, 3), np.float32) if means is None else means, []

    def of_each(name: str, width: int, usual: list[float], size: int = 1) -> Array:
        """Rows [N, size, width] of an attribute; as the schema has it, what is too long is cut off, what is too short
        left out."""
        values, n = _column(prim, name, width), len(means)
        if values is not None and len(values) >= n * size:
            return values[: n * size].reshape(n, size, width)
        if values is not None:
            left_out.append(f"its {name}, which are too few")
        return np.tile(np.array(usual, np.float32), (n, 1, 1))

    degree = prim.GetAttribute(DEGREE)
    degree = degree.Get(FIRST) if degree and degree.HasAuthoredValue() else None  # some programs sample all there is
    degree = USUAL_DEGREE if degree is None else int(degree)
    if degree < 0:
        raise ValueError(f"its spherical harmonics have degree {degree}")
    coefficients = of_each(COEFFICIENTS, 3, GREY, (degree + 1) ** 2)
    if degree > MOST_DEGREE:
        left_out.append(f"its spherical harmonics above degree {MOST_DEGREE}")
    scales = np.abs(of_each("scales", 3, [1.0, 1.0, 1.0]).astype(np.float64))  # Gaussians have no sides
    splats = Splats(
        means=means,
        log_scales=np.log(np.maximum(scales, SMALLEST_SCALE))[:, 0],
        quats=of_each("orientations", 4, [0.0, 0.0, 0.0, 1.0])[:, 0],
        logit_opacities=logits(of_each("opacities", 1, [1.0])[:, 0, 0]),
        sh_coeffs=coefficients[:, : (MOST_DEGREE + 1) ** 2],
    )
    return Model(splats, _drawing(prim), tuple(left_out))


def _column(prim: Usd.Prim, name: str, width: int) -> Array | None:
    """The rows [N, width] of an attribute of floats, else of halves; None where it says nothing.

    Quaternions are x, y, z, w, as NumPy gets them.
    """
    for each in (name, f"{name}h"):
        attribute = prim.GetAttribute(each)
        value = attribute.Get(FIRST) if attribute and attribute.HasAuthoredValue() else None
        if value is not None:
            rows = np.array(value, np.float32)
            if rows.ndim != 1 + (width > 1) or rows.size != len(rows) * width:
                raise ValueError(f"{prim.GetPath()}.{each} has no rows of {counted(width, 'number')}")
            return rows.reshape(-1, width)
    return None


def _drawing(prim: Usd.Prim) -> Drawing:
    """What is said on the drawing: by the colour space, and before it by our ``customData``."""
    coefficients = prim.GetAttribute(COEFFICIENTS)
    space = coefficients.GetColorSpace() if coefficients else ""
    linear = {LINEAR: True, DISPLAY: False}.get(str(space))
    return drawing_of_extras(dict(prim.GetCustomData())).over(Drawing(linear=linear))
