"""Stage 3, *composite*: blend every pixel's primitives front to back.

Notation (Kerbl et al. 2023, Sec. 6; DoG as in the method paper, Sec. 3.3)
    p      log2 of a kernel's value at a pixel, lo - u² - v²,  u = ux dx + uy dy,  v = vy dy
    α      min(.99, 2^p), for a DoG primitive min(.99, 2^p) - min(.99, 2^p'), ignored where |α| < 1/255
    T      transmittance in front of the primitive; T ← T (1 - α), the walk ends before T would fall below 1e-4, or,
           behind very many negative α, exceed 2^30
    C      Σ c α T, for each feature c (the colour channels, and depth if asked for)

``walk.py`` says how it runs.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

import drjit as dr

from .frozen import frozen
from .geometry import Grid
from .tables import FEATURES, Tables
from .tiles import Lists
from .walk import Settings, Walk, planes_of


def composite(grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings) -> tuple:
    """Blend. Returns (features: list of [H*W] planes, without background; T: [H*W] plane)."""
    *features, T = planes_of(_composite(grid, lanes, tables, lists, settings), settings.n_features + 1)
    return features, T


@frozen
def _composite(grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings) -> list:
    walk, n_features = Walk(grid, lanes, tables, lists, settings), settings.n_features

    def body(at, T, C):
        T, C = list(T), list(C)
        for _ in range(walk.blocks.unroll):
            entry, active, at = walk.next(at)
            splat, row, dx, dy = walk.fetch(entry, active)
            alpha, *_ = walk.alphas(splat, row, active, dx, dy)
            for k in range(walk.pixels):
                weight, T[k], go = walk.advance(alpha[k], T[k], row, k)
                for f in range(n_features):
                    c = C[f * walk.pixels + k]
                    C[f * walk.pixels + k] = dr.select(go, dr.fma(weight, row[FEATURES + f], c), c)
        return at, T, C

    _, T, C = dr.while_loop(
        (walk.start(), walk.start_T(), [walk.Float(0)] * (n_features * walk.pixels)),
        lambda at, T, C: walk.more(at) & walk.alive(T),
        body,
        labels=("at", "T", "C"),
        label="composite",
    )
    features = [C[f * walk.pixels : (f + 1) * walk.pixels] for f in range(n_features)]
    return walk.write([*features, [dr.abs(t) for t in T]])
