"""Stage 3 once more: replay the walk of ``composite`` for how the image, patch by patch, depends on each primitive.

Notation as in ``score.py``: d, the derivative of a channel by α. Of a primitive, in a patch of 4 x 4 pixels,

    g_c = Σ d_c ∂α/∂(x, y, ux, uy, vy)     derivative of the patch's sum of channel c by the projected shape, 5 numbers
    s   = Σ α T                             derivative of the same by the primitive's colour in that channel

and the result adds up, over patches, their products: what the squares of derivatives of the image by any parameters
behind the projection are made of (``compare/rivals/pup.py``). Of a DoG primitive: by the shape of the primary kernel.
That a colour with slopes moves along with the shape is left out, and so is that a cut does: g is what the kernel does.
"""

from __future__ import annotations

from dataclasses import replace

import drjit as dr

from ..bands import PreparedView, WalkableView
from ..frozen import frozen
from ..geometry import MAX_ALPHA, Blocks
from ..screen_kernels import LN2
from ..tables import KernelRow
from .slot_rows import SlotRows, sums_over_bands
from .walk import Meeting, Walk

SHAPE = 5  # numbers of a projected shape: x y ux uy vy
PAIRS = [(i, j) for i in range(SHAPE) for j in range(i, SHAPE)]
COLUMNS = len(PAIRS) + 3 * SHAPE + 1


def patch_blocks() -> Blocks:
    """The backend's blocks, made to be patches of 4 x 4 pixels."""
    return replace(Blocks.of_backend(), width=4, height=4)


def composite_fisher(view: WalkableView, image: list, mask=None) -> list:
    """Sums over the patches of a view: Σ_c g_c[i] g_c[j] for ``PAIRS``, then s g_c[i] by channel, then s²; [N] each.

    Args:
        view: made with ``patch_blocks``.
        image: the 3 planes of the view [H*W], background included.
        mask: [H*W] 1 where a pixel counts, else 0, or by how much its derivatives count; None: all do.
    """
    return sums_over_bands(view, COLUMNS, lambda band, *others: _composite_fisher(band, image, mask, *others))


@frozen
def _composite_fisher(view: PreparedView, image: list, mask, in_turn: bool, above: list) -> list:
    walk, rows = Walk(view), SlotRows(view.lists, COLUMNS, in_turn)
    Float = walk.types.Float
    counted = None if mask is None else walk.pixels.read(mask)

    def step(meeting: Meeting, T: list, behind: list) -> None:
        slot, colors, alphas = walk.slot(meeting), walk.features(meeting), walk.alphas(meeting)
        g, s = [[Float(0)] * SHAPE for _ in range(3)], Float(0)
        for k, (dx, dy) in enumerate(walk.offsets(meeting)):
            α, primary = alphas.values[k], alphas.primary[k]
            weight, T_behind, goes_on = walk.advance(α, T[k], meeting, k)
            is_blended = goes_on & (α != 0)
            weight = dr.select(is_blended, weight, 0)
            s = s + (weight if counted is None else weight * counted[k])
            α_by_p = dr.select(is_blended & (primary < MAX_ALPHA), LN2 * primary, 0)
            α_by_p = α_by_p if counted is None else α_by_p * counted[k]
            p_by_shape = _exponent_by_shape(meeting.row.kernel, dx, dy)
            for c in range(3):
                behind[c][k] = dr.fma(-weight, colors[c][k], behind[c][k])
                d = dr.fma(T[k], colors[c][k], -walk.hidden(behind[c][k], α, α))
                d_by_p = α_by_p * d
                g[c] = [dr.fma(d_by_p, by, value) for by, value in zip(p_by_shape, g[c], strict=True)]
            T[k] = T_behind
        products = [g[0][i] * g[0][j] + g[1][i] * g[1][j] + g[2][i] * g[2][j] for i, j in PAIRS]
        products += [s * value for channel in g for value in channel]
        rows.add(slot, [*products, s * s], meeting.active)

    walk.run(step, [walk.pixels.read(plane) for plane in image], "composite_fisher", unroll=False)
    return rows.sums(above=above)


def _exponent_by_shape(kernel: KernelRow, dx, dy) -> list:
    """∂p/∂(x, y, ux, uy, vy) of p = lo - u² - v², u = ux dx + uy dy, v = vy dy; (dx, dy) is the pixel minus (x, y)."""
    ux, uy, vy = kernel.ux, kernel.uy, kernel.vy
    u, v = dr.fma(ux, dx, uy * dy), vy * dy
    return [2 * u * ux, 2 * dr.fma(u, uy, v * vy), -2 * u * dx, -2 * u * dy, -2 * v * dy]
