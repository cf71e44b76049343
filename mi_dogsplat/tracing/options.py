"""What rays are traced with, and what the kernels are specialised to."""

from __future__ import annotations

from dataclasses import dataclass

from ..engine.geometry import Cutoffs


@dataclass(frozen=True)
class TraceOptions:
    """Choices that change the kernels.

    negative_transmittance: a negative α amplifies what lies behind, T (1 - α) > T; else it leaves T as it is.
    """

    sh_degree: int = 3  # highest degree evaluated
    negative_transmittance: bool = True
    cutoffs: Cutoffs = Cutoffs()
