"""The rasteriser once more, in plain float64 NumPy: the oracle that the fast stages are tested against.

Same stages, same argument order as the engine (project -> tiles -> composite), written for reading.
`render` needs no tiles at all: it evaluates every primitive at every pixel, so it checks the tile lists as
well.

Notation. A primitive has the centre mu, the rotation R, the scales s and Sigma = R S S^T R^T. W is the
rotation of the camera, J the Jacobian of the perspective projection at mu, and Sigma' = J W Sigma W^T J^T +
0.3 I its covariance in pixels (EWA splatting). A DoG primitive is primary minus pseudo: the pseudo-Gaussian
has the same centre, rotation and colour, the opacity f_a o and the scales F s. `alpha` is what gets
composited and may be negative. A colour c may vary over its primitive: w = S^-1 R^T (x - mu) standard
deviations away from the centre it is c + sum_a w_a slopes_a + w^T Q w / 2. A pixel at the offset d sees that of the
mean w there, (J W R S)^T Sigma'^-1 d. A cut multiplies both kernels by g of the same mean w (`own_axes.py`). Symmetric
2x2 matrices are stored as rows (xx, xy, yy). The pixel in column i, row j has its centre at (i + .5, j + .5).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np

from ..scene.row_groups import BESIDE_DOG
from .mixed_sh import group_names, sh_groups
from .own_axes import index_of, kept, names_of_rows
from .projection import MIN_ALPHA, Projection, project

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats

# The nearest float32, as the engine has it: behind two saturated primitives T = (1 - .99)^2 lies on the stop
# threshold, and the rounding of this constant alone decides between stopping and blending one more.
MAX_ALPHA = float(np.float32(0.99))
MIN_T = 1e-4  # the walk stops before the transmittance falls below this
MAX_T = 2.0**30  # and before negative alphas take it above this

RAW_PARAMETERS = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs",
                  "dog_logit_opacities", "dog_log_scales")


def raw_names(splats: Splats) -> tuple[str, ...]:
    """`RAW_PARAMETERS` and those that only some models have."""
    return RAW_PARAMETERS + names_of_rows(splats) + group_names(splats)


def raw_indices(splats: Splats) -> dict[str, np.ndarray]:
    """The primitives of those that only some primitives have."""
    of_degrees = {f"sh{degree}_index": index for degree, index in sh_groups(splats).items()}
    return {"dog_index": splats.dog_index} | {g.index: index_of(splats, g) for g in BESIDE_DOG} | of_degrees


def depth_order(projection: Projection) -> np.ndarray:
    """Indices of the visible primitives, nearest first; equal depths keep the order of their indices."""
    order = np.argsort(projection.depths, kind="stable")
    return order[projection.visible[order]]


def kernels(projection: Projection, i: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """G and G_p of primitive i at the points (x, y), with what cuts leave of them, not yet limited to .99.

    G_p is 0 for a Gaussian.
    """
    dx, dy = x - projection.means2d[i, 0], y - projection.means2d[i, 1]
    left = 1.0
    for cut, (of_x, of_y) in zip(projection.cut[:, i], projection.cuts[:, i], strict=True):
        left = left * kept(of_x * dx + of_y * dy) if cut else left

    def gaussian(opacity, conic):
        return left * opacity * np.exp(-0.5 * (conic[0] * dx * dx + 2 * conic[1] * dx * dy + conic[2] * dy * dy))

    G = gaussian(projection.opacities[i], projection.conics[i])
    if not projection.dog[i]:
        return G, np.zeros_like(G)
    return G, gaussian(projection.pseudo_opacities[i], projection.pseudo_conics[i])


def colors_at(projection: Projection, i: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The colour of primitive i at P points (x, y), [P, 3]."""
    if not (projection.sloped[i] or projection.curved[i]):
        return np.broadcast_to(projection.colors[i], (len(x), 3))
    offsets = np.stack([x, y], axis=1) - projection.means2d[i]
    brighter = np.einsum("pi,ij,pj->p", offsets, projection.curvatures[i], offsets) / 2
    return projection.colors[i] + offsets @ projection.slopes[i].T + brighter[:, None]


def pixel_centres(x0: int, y0: int, x1: int, y1: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres (x, y) of the pixels in columns x0..x1-1 and rows y0..y1-1, row by row."""
    y, x = np.mgrid[y0:y1, x0:x1] + 0.5
    return x.ravel(), y.ravel()


def tile_boxes(width: int, height: int, tile_width: int, tile_height: int) -> list[tuple[int, ...]]:
    """x0, y0, x1, y1 of each tile as `pixel_centres` takes them, row-major, cut at the image border."""
    return [(x, y, min(x + tile_width, width), min(y + tile_height, height))
            for y in range(0, height, tile_height) for x in range(0, width, tile_width)]


def tiles(projection: Projection, width: int, height: int, tile_width: int = 16,
          tile_height: int = 16) -> list[np.ndarray]:
    """Per tile (row-major) the primitives with G or G_p >= 1/255 at one of its pixel centres, in depth order.

    An engine that intersects ellipses with tiles instead may list more than these, never less.
    """
    lists: list[list[int]] = []
    order = depth_order(projection)
    for box in tile_boxes(width, height, tile_width, tile_height):
        x, y = pixel_centres(*box)
        lists.append([i for i in order if max(G.max() for G in kernels(projection, i, x, y)) >= MIN_ALPHA])
    return [np.array(indices, np.int64) for indices in lists]


@dataclass
class Meeting:
    """A primitive at P points, as a walk front to back comes to it; arrays are [P]."""

    splat: int
    difference: np.ndarray  # G - G_p, each limited to .99
    alpha: np.ndarray  # the same, 0 where it is ignored
    T: np.ndarray  # in front of it
    T_past: np.ndarray  # behind it, if the walk goes on
    reached: np.ndarray  # bool, the walk had not ended before
    goes_on: np.ndarray  # bool, it does not end here either: only then is the primitive blended

    @property
    def weight(self) -> np.ndarray:
        """alpha T, 0 where the walk has ended."""
        return np.where(self.goes_on, self.alpha * self.T, 0)

    @property
    def T_behind(self) -> np.ndarray:
        """As the walk leaves it."""
        return np.where(self.goes_on, self.T_past, self.T)


def walk(projection: Projection, order: np.ndarray, x: np.ndarray, y: np.ndarray, *,
         negative_transmittance: bool = True, smooth: bool = False) -> Iterator[Meeting]:
    """Go through the primitives `order` at the points (x, y); options as in `composite`."""
    T, going = np.ones(len(x)), np.ones(len(x), bool)
    for i in order:
        G, G_p = kernels(projection, i, x, y)
        difference = np.minimum(MAX_ALPHA, G) - np.minimum(MAX_ALPHA, G_p)
        alpha = difference if smooth else np.where(np.abs(difference) < MIN_ALPHA, 0, difference)
        T_past = T * (1 - (alpha if negative_transmittance else np.maximum(alpha, 0)))
        goes_on = going & (T_past <= MAX_T) & (smooth | (T_past >= MIN_T))
        meeting = Meeting(i, difference, alpha, T, T_past, going, goes_on)
        T, going = meeting.T_behind, goes_on
        yield meeting


def _blend(projection: Projection, order: np.ndarray, x: np.ndarray, y: np.ndarray, features: np.ndarray | None,
           **options) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P points -> features [P, C], T [P], depth [P]; no background. `features` [N, C] or, of None, the colours."""
    channels = 3 if features is None else features.shape[1]
    out, T, depth = np.zeros((len(x), channels)), np.ones(len(x)), np.zeros(len(x))
    for meeting in walk(projection, order, x, y, **options):
        i, weight = meeting.splat, meeting.weight
        out += weight[:, None] * (colors_at(projection, i, x, y) if features is None else features[i])
        depth += weight * projection.depths[i]
        T = meeting.T_behind
    return out, T, depth


def composite(projection: Projection, tiles: Sequence[np.ndarray], width: int, height: int,
              background: Sequence[float] | np.ndarray = (0, 0, 0), *, negative_transmittance: bool = True,
              features: np.ndarray | None = None, smooth: bool = False, tile_width: int = 16,
              tile_height: int = 16) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Blend tile lists -> image [H, W, 3] (not clamped), T [H, W], depth [H, W] = sum of depth alpha T.

    `features` [N, C] takes the place of the colours (image [H, W, C], background of C values).
    `negative_transmittance=False`: negative alpha subtracts colour but leaves T alone.
    `smooth=True`: no 1/255 skip, no stop, for derivatives; the lists must then hold every visible primitive.
    Raises ValueError if the number of lists is not that of the tiles.
    """
    boxes = tile_boxes(width, height, tile_width, tile_height)
    if len(boxes) != len(tiles):
        raise ValueError(f"composite: {len(tiles)} lists for {len(boxes)} tiles; pass one list per tile")
    features = None if features is None else np.asarray(features, np.float64)
    image = np.empty((height, width, 3 if features is None else features.shape[1]))
    T, depth = np.empty((height, width)), np.empty((height, width))
    for (x0, y0, x1, y1), order in zip(boxes, tiles, strict=True):
        x, y = pixel_centres(x0, y0, x1, y1)
        blended = _blend(projection, order, x, y, features, negative_transmittance=negative_transmittance,
                         smooth=smooth)
        for whole, part in zip((image, T, depth), blended, strict=True):
            whole[y0:y1, x0:x1] = part.reshape(y1 - y0, x1 - x0, *part.shape[1:])
    return image + T[..., None] * np.asarray(background, np.float64), T, depth


def render(splats: Splats, camera: Camera, background: Sequence[float] | np.ndarray = (0, 0, 0), *,
           near_clip: float = 0.2, antialiased: bool = False, sh_degree: int | None = None,
           negative_transmittance: bool = True, smooth: bool = False,
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All primitives at all pixels -> image [H, W, 3], T, depth [H, W]; options of `project`, `composite`."""
    projection = project(splats, camera, near_clip=near_clip, antialiased=antialiased, sh_degree=sh_degree)
    width, height = camera.width, camera.height
    return composite(projection, [depth_order(projection)], width, height, background, smooth=smooth,
                     negative_transmittance=negative_transmittance, tile_width=width, tile_height=height)


def loss_gradients(splats: Splats, camera: Camera, adjoint: np.ndarray, *,
                   keys: Sequence[str] | None = None, eps: float = 1e-5,
                   background: Sequence[float] | np.ndarray = (0, 0, 0), smooth: bool = True,
                   **options) -> dict[str, np.ndarray]:
    """Central differences of sum(adjoint [H, W, 3] * image) by every entry of the raw parameters in `keys`, or of all.

    Perturbs in float64, one entry at a time: two renders each, for small scenes. `options` go to `render`.
    Raises ValueError if the adjoint has not the shape of the image.
    """
    if np.shape(adjoint) != (camera.height, camera.width, 3):
        raise ValueError(f"loss_gradients: adjoint has the shape {np.shape(adjoint)}, the image "
                         f"{(camera.height, camera.width, 3)}; both need to be equal")
    raw = {name: np.array(getattr(splats, name), np.float64) for name in raw_names(splats)}
    # Not a `Splats`, which is float32: too coarse for these steps.
    perturbed = cast("Splats", SimpleNamespace(**raw, **raw_indices(splats)))

    def loss() -> float:
        return float(np.sum(adjoint * render(perturbed, camera, background, smooth=smooth, **options)[0]))

    gradients = {}
    for key in raw if keys is None else keys:
        gradients[key] = np.zeros_like(raw[key])
        for index in np.ndindex(raw[key].shape):
            value = raw[key][index]
            raw[key][index] = value + eps
            above = loss()
            raw[key][index] = value - eps
            below = loss()
            raw[key][index] = value
            gradients[key][index] = (above - below) / (2 * eps)
    return gradients
