"""Writing a model, in the format that its name asks for."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..scene.drawing import USUAL, Drawing, told
from ..scene.kinds import varying
from ..scene.radiance import brightened
from ..scene.row_groups import SH
from ..scene.sh_basis import C0
from ..scene.splats import Splats
from ..scene.whole import whole
from ..support.errors import DataError
from ..support.files import write_bytes
from ..support.wording import count, counted
from .model import Model, require_finite
from .packing import turned
from .spz import COLORS
from .spz import encode as encode_spz
from .spz_container import rewrapped, zstandard_for
from .table import PLY, SPZ, USD, Format, format_to_write
from .usd_files import require_package

SPZ_VERSIONS = (3, 4)  # that are written
ROUNDING = 1 / 128  # by which a coefficient or colour is out of range: the step of SPZ, less is rounding
CLAMPED = 1 / 32  # by which a log scale is out of range: half a step of SPZ, less is rounding


def write_model(
    path: str | Path, model: Model | Splats, spz_version: int = SPZ_VERSIONS[0], sh_rows: bool = False
) -> list[str]:
    """Write a model in the axes of 3DGS PLY; returns a line for each thing that the format has no room for.

    Args:
        path: its end names the format, one of ``FORMATS``.
        model: primitives with how they are to be drawn, or primitives alone.
        spz_version: version of an SPZ file, one of ``SPZ_VERSIONS``.
        sh_rows: keep the SH degrees of single primitives where the format can, the layout "rows" of ``write_ply``; else
            all get the coefficients of the highest, as all programs read them.

    Raises ``DataError`` when the format or place cannot be written, for values that are not finite, for no primitives
    where a format must have some, and for DoG primitives where it knows none (``export.bake.baked`` makes plain
    Gaussians of them). Raises ``ValueError`` for what is no path or no model.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise ValueError(f"write_model: the path comes first, then the model; {type(path).__name__} is not a path")
    path = Path(path)
    chosen = format_to_write(path)
    model = model if isinstance(model, Model) else Model(model)
    _require_room(path, chosen, model)
    require_encoder(path, chosen, spz_version)
    splats = _held_by(chosen, model.splats, sh_rows)
    silent = chosen is SPZ and spz_version == 4 and bool(model.drawing.linear)  # its header has no room for a comment
    lost = what_is_lost(chosen, model)
    lost += what_is_clamped(replace(SPZ, radiance=COLORS) if silent else chosen, splats, model.drawing)
    if silent:
        if model.drawing.white:
            lost.append("SPZ 4 cannot say that its colours are linear and in units of white; write version 3")
        else:
            lost.append("SPZ 4 cannot say that its colours are linear; give it by hand, or write version 3")
    if chosen.in_white and model.drawing.linear and model.drawing.white:
        with np.errstate(over="ignore"):  # of what is found below
            splats = brightened(splats, 1 / model.drawing.white)
    if chosen is not PLY:  # whose writer looks at its numbers by itself
        require_finite(path, splats, "nothing was written; remove those primitives")
    if chosen.order:
        splats = splats.select(chosen.order(splats))
    if chosen.turn:
        splats = turned(splats, chosen.turn)
    if chosen is SPZ and spz_version == 4:
        said = replace(model.drawing, linear=None) if silent else model.drawing
        write_bytes(path, rewrapped(path, encode_spz(splats, said)))
    else:
        chosen.write(path, replace(model, splats=splats))
    return lost


def _require_room(path: Path, chosen: Format, model: Model) -> None:
    """Raise ``DataError`` for DoG, or no primitives, that a format has no room for."""
    splats = model.splats
    if splats.n_dog and not chosen.dog:
        problem = f"{chosen.name} cannot hold DoG, and the model has {splats.n_dog} of them"
        raise DataError(path, problem, "bake them first, as dogsplat export does, or write a .ply")
    if not splats.n_splats and not chosen.empty:
        problem = f"{chosen.name} cannot hold a model without primitives"
        raise DataError(path, problem, "write one that has some, or a .ply")


def _held_by(chosen: Format, splats: Splats, sh_rows: bool) -> Splats:
    """The nearest model of those parts that a format holds; ``sh_rows``: as in ``write_model``."""
    if not chosen.shifts:
        splats = splats.without_shifts()
    if not chosen.cuts:
        splats = whole(splats)
    if splats.is_varied.any() and not chosen.slopes:
        splats = splats.without_slopes()
    if splats.mixed_sh and not (sh_rows and chosen.mixed_sh):
        splats = splats.uniform_sh()
    return splats


def require_encoder(path: Path, chosen: Format, spz_version: int = SPZ_VERSIONS[0]) -> None:
    """Raise ``DataError`` for a version of SPZ that is not written, and for want of a package: before what takes
    long."""
    if spz_version not in SPZ_VERSIONS:
        raise DataError(path, f"SPZ {spz_version} is not written", f"use version {' or '.join(map(str, SPZ_VERSIONS))}")
    if chosen is SPZ and spz_version == 4:
        zstandard_for(path)
    if chosen is USD:
        require_package(path)


def what_is_lost(chosen: Format, model: Model) -> list[str]:
    """Lines about what a format has no room for, beside rounding."""
    said, lost = model.drawing.said(), []
    known = chosen.carries | ({"white"} if chosen.in_white else set())  # in units of which its white is 1, as usual
    unsaid = {name: value for name, value in said.items() if name not in known}
    if unusual := [f"{name} {told(value)}" for name, value in unsaid.items() if value != USUAL[name]]:
        lost.append(f"{chosen.name} cannot say how it is drawn: {', '.join(unusual)}; give it by hand")
    if model.splats.is_cut.any() and not chosen.cuts:
        n = count(model.splats.is_cut.sum())
        became = "each becomes the nearest whole primitive"
        lost.append(f"{chosen.name} cannot hold cuts: those of {n} are left out; {became}")
    if model.splats.is_varied.any() and not chosen.slopes:
        n = count(model.splats.is_varied.sum())
        what = f"the {varying(model.splats)} of {n} are left out"
        lost.append(f"{chosen.name} cannot hold colours that vary over a primitive: {what}; each has its mean colour")
    if model.splats.n_shifts and not chosen.shifts:
        what = f"the shifts of {count(model.splats.n_shifts)} are left out"
        lost.append(f"{chosen.name} cannot hold places that depend on the view: {what}; each has its mean place")
    if model.splats.sh_degree > chosen.sh_degree:
        lost.append(f"{chosen.name} has no view-dependent colour above SH degree {chosen.sh_degree}")
    return lost


def what_is_clamped(chosen: Format, splats: Splats, drawing: Drawing) -> list[str]:
    """Lines about numbers of the primitives that are written which are out of the range of a format."""
    clamped = []
    least, most = chosen.log_scales
    largest = splats.log_scales.max(axis=1)  # [N]; what is flat is often flatter than any format can say
    if n := int(((largest < least - CLAMPED) | (largest > most + CLAMPED)).sum()):
        sizes = f"below {math.exp(least):.3g} or above {math.exp(most):.3g}"
        clamped.append(f"{chosen.name} has no scales {sizes}, to which it clamps {counted(n, 'primitive')}")
    if chosen.moved and (n := int(chosen.moved(splats).sum())):
        farthest = f"{np.abs(splats.means).max():.3g}"
        what = f"moves {counted(n, 'primitive')} by more than their size"
        clamped.append(f"{chosen.name} has {chosen.bits}: with one of {farthest} it {what}")
    unit = (drawing.white or 1.0) if chosen.in_white and drawing.linear else 1.0
    if n := _beyond(splats, chosen.largest_sh * unit * (1 + ROUNDING)):
        what = f"SH coefficients beyond ±{chosen.largest_sh * unit:.4g}"
        clamped.append(f"{chosen.name} has no {what}, to which it clamps {counted(n, 'primitive')}")
    least, most = (bound * unit for bound in (chosen.radiance if drawing.linear else chosen.colors))
    colors = 0.5 + C0 * splats.sh_coeffs[:, 0]  # [N, 3]
    above = (colors > most * (1 + ROUNDING)).any(axis=1)
    lightened = min(chosen.sh_degree, splats.sh_degree) > 0  # what is black may be, by what depends on the view
    below = (-colors > -least * (1 + ROUNDING)).any(axis=1) & lightened
    if n := int((below | above).sum()):
        sides = " or ".join([f"below {least:.4g}"] * bool(below.any()) + [f"above {most:.4g}"] * bool(above.any()))
        what = "radiance" if drawing.linear else "mean colour (where 1 is white)"
        clamped.append(f"{chosen.name} has no {what} {sides}, to which it clamps {counted(n, 'primitive')}")
    return clamped


def _beyond(splats: Splats, most: float) -> int:
    """How many primitives have a larger coefficient of view-dependent colour, of either sign."""
    if math.isinf(most):
        return 0
    found = np.any(np.abs(splats.sh_coeffs[:, 1:]) > most, axis=(1, 2))
    for group in SH.values():
        (name,) = group.names
        found[getattr(splats, group.index)] |= np.any(np.abs(getattr(splats, name)) > most, axis=(1, 2))
    return int(found.sum())
