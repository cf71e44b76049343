"""Arbitrary output variables (AOVs): what a pixel knows besides its colour, as channels of the film or of an OpenEXR.

    alpha          1 - T, what the background is hidden by
    depth          expected depth Σ z α T / alpha, z along the optical axis to the centre of a primitive
    median_depth   z of the first primitive behind which T ≤ 1/2
    normal         Σ n α T, normalised; n as in ``normals.py``, in world space
    index          primitive of the largest α T; counted through all ``dog`` shapes, in the order of their ids
    count          number of primitives that are blended
    dog_share      share of the DoG primitives in Σ |α T|

Where nothing is seen, index is -1 and all else 0; depth and normal are 0 wherever alpha is not positive, which negative
α can bring about.

What depth and normal need is blended as features of the ordinary walk, and so they are differentiable, as alpha is. The
other four take a walk of their own (``walks/aovs.py``) and have no derivative: it is 0.

Channels are named as Mitsuba's ``aov`` integrator names its own, ``name.X``; its ``depth.T`` is a distance along a ray,
so ours is ``depth.Z``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import drjit as dr
import mitsuba as mi

from ..support.errors import Wrong
from .arrays import detached
from .options import RasterOptions
from .rasterize import Frame
from .walks.aovs import NOTHING, composite_aovs, walked

# Last parts of the names of the channels; I is an integer, Z along the optical axis, Y a plain number
CHANNELS = {
    "alpha": ("",),
    "depth": (".Z",),
    "median_depth": (".Z",),
    "normal": (".X", ".Y", ".Z"),
    "index": (".I",),
    "count": (".I",),
    "dog_share": (".Y",),
}
AOVS = tuple(CHANNELS)


def read_names(text: str, further: Sequence[str] = ()) -> list[str]:
    """Names from a comma-separated list, of ``AOVS`` and ``further`` ones.

    Raises ``Wrong`` for one that is unknown, or is there twice.
    """
    known = (*AOVS, *further)
    names = [name.strip() for name in text.split(",") if name.strip()]
    for k, name in enumerate(names):
        if name not in known:
            raise Wrong(f'unknown AOV "{name}"', f"available are {', '.join(known)}")
        if name in names[:k]:
            raise Wrong(f'the AOV "{name}" is there twice', "name it once")
    return names


def channel_names(names: Sequence[str]) -> list[str]:
    """Names of all channels, in order."""
    return [name + part for name in names for part in CHANNELS[name]]


def options_for(names: Sequence[str], options: RasterOptions) -> RasterOptions:
    """The options, with what the AOVs need to be blended and without what they do not."""
    return replace(options, depth="depth" in names, normal="normal" in names)


def channels(names: Sequence[str], frame: Frame, derivative: bool = False) -> list[mi.Float]:
    """Planes [H*W] as ``channel_names`` lists them; alpha, depth and normal are attached to the AD graph.

    Args:
        names: AOVs.
        frame: rasterized with the options that ``options_for`` gives.
        derivative: only the derivatives matter: what has none is 0, and no walk is made for it.
    """
    alpha = 1 - frame.T
    planes = {"alpha": [alpha]}
    if "depth" in names and frame.depth is not None:
        planes["depth"] = [dr.select(alpha > 0, frame.depth / alpha, 0)]
    if "normal" in names and frame.normal is not None:
        x, y, z = frame.normal
        length2 = dr.fma(x, x, dr.fma(y, y, z * z))
        seen = (alpha > 0) & (length2 > 0)
        inv = dr.rsqrt(dr.select(seen, length2, 1))
        planes["normal"] = [dr.select(seen, n * inv, 0) for n in (x, y, z)]
    planes |= {name: [dr.full(mi.Float, NOTHING[name], dr.width(alpha))] for name in names if name in NOTHING}
    if not derivative:
        planes |= _found_by_a_walk(names, frame)
    return [plane for name in names for plane in planes[name]]


def _found_by_a_walk(names: Sequence[str], frame: Frame) -> dict[str, list[mi.Float]]:
    """Planes of the AOVs of ``walks/aovs.py`` among ``names``; none of a frame without primitives."""
    if frame.projection is None or frame.view is None:
        return {}
    wanted = walked(names, has_dog=frame.projection.pseudo is not None)
    if not wanted:
        return {}
    depths = detached(frame.projection.depth) if "median_depth" in wanted else None
    found = composite_aovs(frame.view, wanted, depths)
    return {name: [mi.Float(plane)] for name, plane in zip(wanted, found, strict=True)}
