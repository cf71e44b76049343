"""What ``dr.freeze`` of somebody else cannot record."""

from __future__ import annotations

import drjit as dr


def refuse_freezing(name: str, what: str) -> None:
    """Raises ``RuntimeError`` inside of a function that is being recorded.

    How many primitives touch how many tiles is read on the host, and decides what is launched. Dr.Jit would stop
    without saying so, or end the process where an array that shares its memory with NumPy goes
    (docs/performance/traps.md).
    """
    if dr.flag(dr.JitFlag.FreezingScope):
        raise RuntimeError(f"{name}: dr.freeze cannot record {what}; call it outside, kernels are recorded already")
