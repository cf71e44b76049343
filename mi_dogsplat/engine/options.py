"""What a view is rasterized with, and what the kernels are specialised to."""

from __future__ import annotations

from dataclasses import dataclass

from .geometry import Cutoffs


@dataclass(frozen=True)
class RasterOptions:
    """Choices that change the kernels; each costs nothing when it is off."""

    sh_degree: int = 3  # highest degree evaluated
    antialiased: bool = False
    depth: bool = False  # also blend Σ depth α T
    normal: bool = False  # and Σ normal α T
    negative_transmittance: bool = True
    cutoffs: Cutoffs = Cutoffs()
    patch: int = 4  # pixels per side that share their exponentials; 1 costs time and gains some 1e-7 (docs/numerics.md)
    isect_memory: float | None = None  # bytes for what grows with the isects; what needs more has bands (``bands.py``)


@dataclass(frozen=True)
class Settings:
    """What the kernels that walk are specialised to.

    negative_transmittance: a negative α amplifies what lies behind, T (1 - α) > T; else it leaves T as it is.
    patch: width and height of the pixels that share their exponentials, 1 to 4; 1 gives each pixel its own.
    slopes: whether the first three features, the colours, vary over their primitives.
    curvatures: whether their brightness curves.
    cuts: how many planes may cut a primitive off, 0 to 2.
    """

    n_features: int
    cutoffs: Cutoffs = Cutoffs()
    negative_transmittance: bool = True
    patch: int = 4
    slopes: bool = False
    curvatures: bool = False
    cuts: int = 0
