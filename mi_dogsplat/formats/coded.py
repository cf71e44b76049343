"""The grids of SPZ and of SOG for a model, in the axes of 3DGS PLY."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..scene.sh_basis import C0
from ..scene.splats import Array, Splats
from ..support.srgb import linear_to_srgb_log, srgb_log_to_linear
from . import spz
from .grids import LLOYD_ROUNDS, MOST_ENTRIES, Extents, FileGrids, Grid, Steps
from .packing import SQRT2, logits, signed_exp, signed_log
from .palette import CODES

MOST_BITS = 20  # of a position in SPZ, for a table that is searched


def _spz(extents: Extents, steps: Steps) -> FileGrids:
    """Positions are multiples of a power of two. Grids are even, as y and z change their signs (RUB)."""
    reach = max(np.abs(extents.low).max(), np.abs(extents.high).max(), 2.0**-10)
    bits = min(np.ceil(-np.log2(steps.position * extents.small)), np.floor(MOST_BITS - np.log2(reach)))
    bounds = [
        (np.floor(low * 2**bits), np.ceil(high * 2**bits)) for low, high in zip(extents.low, extents.high, strict=True)
    ]
    x, y, z = (Grid.of(np.arange(low, high + 1) / 2**bits) for low, high in bounds)
    step = 4 * steps.rotation  # of 511: as far as in SOG
    codes = (np.arange(0, 256, steps.color) / 255 - 0.5) / 0.15
    return FileGrids(
        means=(x, y, z),
        log_scales=Grid.of(np.arange(0, 256, steps.log_scale) / 16 - 10),
        three=Grid.of(_multiples(step, 511) / (511 * SQRT2)),
        logit_opacities=_opacities(steps),
        sh_dc=_through(spz.radiance, codes) if extents.linear else Grid.of(codes),
        sh_rest=Grid.of(_multiples(steps.sh, 127) / 128),
    )


def _sog(extents: Extents, steps: Steps) -> FileGrids:
    """Positions lie between bounds, 16 bits of sign(x) ln(1 + |x|); other tables may hold 256 values of any kind."""
    low, high = signed_log(extents.low), signed_log(extents.high)
    between = max(float((high - low).max()) / 65535, 1e-12)  # two codes, at most
    bits = int(np.clip(np.floor(np.log2(steps.position * extents.small_at_1 / between)), 0, 15))
    codes = np.append(np.arange(0, 65535, 2**bits), 65535)  # both ends: what encodes it finds them as bounds
    logs = [a + (b - a) * codes / 65535 for a, b in zip(low, high, strict=True)]
    x, y, z = (Grid.of(signed_exp(log)) for log in logs)
    middle = np.arange(0, 256, steps.rotation) + steps.rotation // 2
    return FileGrids(
        means=(x, y, z),
        log_scales=_codebook(extents.log_scales, steps.log_scale / 16),
        three=Grid.of((middle[middle < 256] / 127.5 - 1) / SQRT2),
        logit_opacities=_opacities(steps),
        sh_dc=_radiance(extents.dc, steps.color / 40) if extents.linear else _codebook(extents.dc, steps.color / 40),
        sh_rest=Grid.of(_multiples(steps.sh, 127 * steps.sh) / 128),
    )


CODED: dict[str, Callable[[Extents, Steps], FileGrids]] = {"spz": _spz, "sog": _sog}
STEPS = {"spz": Steps(rotation=3), "sog": Steps(entries=0.375)}  # SPZ packs worse


def snapped(
    name: str,
    splats: Splats,
    steps: Steps | None = None,
    rounds: int = LLOYD_ROUNDS,
    linear: bool = False,
    most: int = MOST_ENTRIES,
) -> Splats:
    """A model of plain Gaussians as a small file of a format of ``CODED`` holds it.

    Args:
        steps: None: those of ``STEPS``.
        rounds, most: as ``FileGrids.palette`` takes them.
        linear: its colours are radiance, in units of white.
    """
    if splats.n_splats == 0:
        return splats
    steps = steps or STEPS[name]
    grids = CODED[name](Extents.of(splats, linear), steps)
    return grids.snap(splats, grids.palette(splats, steps.entries, rounds=rounds, most=most))


def _opacities(steps: Steps) -> Grid:
    codes = np.arange(0, 256, steps.opacity) / 255
    return Grid.of(logits(codes), logits((codes[1:] + codes[:-1]) / 2))


def _multiples(step: int, most: int) -> Array:
    """Of ``step``, from -``most`` to ``most``."""
    return np.arange(-(most // step), most // step + 1) * step


def _codebook(bounds: tuple[float, float], step: float) -> Grid:
    """Multiples of ``step`` within bounds, or of more where they are too many."""
    low, high = bounds
    step *= max(1, np.ceil((high - low) / step / (CODES - 3)))
    return Grid.of(np.arange(np.floor(low / step), np.ceil(high / step) + 1) * step)


def _radiance(bounds: tuple[float, float], step: float) -> Grid:
    """f_dc of linear colours, in steps that are even through the tone curve."""
    low, high = linear_to_srgb_log(0.5 + C0 * np.array(bounds))
    even = _codebook((float(low), float(high)), C0 * step).values.astype(np.float64)
    return _through(lambda shown: (srgb_log_to_linear(shown) - 0.5) / C0, even)


def _through(curve: Callable[[Array], Array], values: Array) -> Grid:
    """What increasing values become; a number goes to the nearest of them before the curve."""
    return Grid.of(curve(values), curve((values[1:] + values[:-1]) / 2))
