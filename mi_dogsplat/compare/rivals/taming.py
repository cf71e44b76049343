"""Taming-3DGS (Mallick et al. 2024, Sec. 3): growth along a parabola to the budget, drawn by a score of many terms.

The budget after refinement x of N is S + 2 D x/N - D (x/N)², from S primitives to S + D. Those whose gradient is above
3DGS's threshold may grow; of the room clones and splits get as much as they have candidates, and who grows is drawn
without replacement in proportion to a sum over 10 random views, each weighted by its training loss, .8 L1 + .2 (1 -
SSIM), of

    gradient (25), opacity (100), product of the scales (25), depth (5), radius on screen (10),
    number of pixels (0.1), Σ α T (50), Σ e α T (10)

each divided by its median over what is above 0; e is the error of a pixel plus the edges of the photograph (the 3 x 3
Laplacian of Pillow's FIND_EDGES), each scaled to at most 50. The numbers are those of the authors' code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageFilter

from ...engine.project import project
from ...measure.metrics import ssim
from ...render.picture import as_taken, photograph
from ...scores.weights import weights
from ...training.recipe import Recipe
from ...training.strategy.densify import Choice, Densification
from ...training.strategy.densify_stats import DensifyStats, radii
from ...training.strategy.strategy import Training
from .growth import START_SHARE, best, bounded, opacities, progress, removed
from .mini_splatting import sampling_keys

DEVIATIONS = (
    "the term of distances to the pixels (50) is left out; a primitive counts in a view if it has a pixel there (the "
    "code: if it is on screen, hidden or not); radii are not rounded up to whole pixels; primitives are removed as in "
    "3DGS (the code removes half of these by score, and only early); opacities do not exceed 1 after step 15,000; at "
    "the last densification step primitives below the threshold fill the rest of the budget; a start of at most half "
    "the budget"
)
VIEWS = 10
OF_MODEL = {"gradient": 25.0, "opacity": 100.0, "scale": 25.0}
OF_VIEW = {"depth": 5.0, "radius": 10.0, "pixels": 0.1, "blend": 50.0, "error": 10.0}
SALIENCY = 50.0  # of the error, and of the edges


def parabola(progress: float, start: int, end: int) -> int:
    """Primitives at ``progress`` 0 to 1."""
    return round(start + (end - start) * (2 * progress - progress**2))


def relative(values: np.ndarray) -> np.ndarray:
    """[N] divided by the median of those above 0; what is not finite or not above 0 becomes 0."""
    positive = np.isfinite(values) & (values > 0)
    return np.where(positive, values / np.median(values[positive]), 0) if positive.any() else np.zeros(len(values))


def edges(photograph: np.ndarray) -> np.ndarray:
    """[H, W] what Pillow finds of a photograph [H, W, 3] in 8 bits, as the authors' code."""
    picture = Image.fromarray((np.clip(photograph, 0, 1) * 255).astype(np.uint8)).convert("L")
    return np.asarray(picture.filter(ImageFilter.FIND_EDGES), np.float64) / 255


def from_0_to_1(values: np.ndarray, mask: np.ndarray | None) -> np.ndarray:
    """[H, W] scaled so that pixels that count have these as their least and greatest; a mask as ``TrainingViews``'."""
    counted = values if mask is None or not mask.any() else values[mask > 0]
    return (values - counted.min()) / max(float(np.ptp(counted)), 1e-12)


def saliency(error: np.ndarray, photograph: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """[H, W] e of a view: error [H, W] and the edges of the photograph [H, W, 3], each scaled to 0..50."""
    return SALIENCY * sum((from_0_to_1(t, mask) for t in (error, edges(photograph))), np.zeros(error.shape))


@dataclass(frozen=True)
class Taming:
    """Who grows: a draw, along the parabola."""

    def __call__(self, t: Training, rule: Densification, stats: DensifyStats) -> Choice:
        remove, small = removed(t, rule), t.optimizer.largest_scales <= rule.clone_scale * t.extent
        room = max(0, self.budget(t, rule) - int(np.sum(~remove)))
        may = ~remove & (stats.mean_gradient() >= rule.gradient_threshold)
        keys = sampling_keys(importance(t, stats), t.rng)
        share = min(room, int(may.sum())) / max(1, int(may.sum()))
        grow = best(keys, may & small, round(share * int(np.sum(may & small))))
        grow |= best(keys, may & ~small, min(room, int(may.sum())) - int(grow.sum()))
        if progress(t, rule) >= 1:
            grow |= best(keys, ~remove & ~grow, room - int(grow.sum()))
        return Choice(grow, small, remove)

    def budget(self, t: Training, rule: Densification) -> int:
        """Primitives after the refinement of this step."""
        count = int(t.target)
        return bounded(parabola(progress(t, rule), min(t.n_start, count), count), rule)


def importance(t: Training, stats: DensifyStats) -> np.ndarray:
    """[N] the sum of all terms over the views."""
    terms = {
        "gradient": stats.mean_gradient().astype(np.float64),
        "opacity": opacities(t),
        "scale": np.exp(t.optimizer.numpy("log_scales").sum(1, dtype=np.float64)),
    }
    of_model = sum(weight * relative(terms[name]) for name, weight in OF_MODEL.items())
    chosen = t.rng.permutation(len(t.photographs))[:VIEWS]
    return sum((_of_view(t, int(k), of_model) for k in chosen), np.zeros(t.optimizer.n))


def _of_view(t: Training, k: int, of_model) -> np.ndarray:
    view, camera, params = t.photographs.views[k], t.photographs.cameras[k], t.optimizer.params
    truth = photograph(view, t.photographs.background)
    mask = t.photographs.shown_mask(k)
    taken, learned = t.picture(view), t.appearance()
    if learned:
        taken = as_taken(taken, view.camera, learned.numbers(view.camera, view.name))
    picture, seen = (x if mask is None else x * mask[..., None] for x in (taken.color, truth))  # as the loss
    error = np.abs(picture - seen).mean(-1)  # [H, W]
    loss = 0.8 * float(error.mean()) + 0.2 * (1 - ssim(picture, seen))
    found = weights(params, [camera], t.options, [saliency(error, truth, mask)], [mask].__getitem__)
    shown = found.pixels > 0
    projection = project(params, camera, sh_degree=0)
    terms = {"depth": projection.depth.numpy(), "radius": radii(projection.kernels).numpy(), "pixels": found.pixels}
    terms |= {"blend": found.total, "error": found.weighted}
    total = of_model + sum(weight * relative(np.where(shown, terms[n], 0)) for n, weight in OF_VIEW.items())
    return loss * np.where(shown, total, 0)


RECIPE = Recipe(densification=Densification(growth=Taming()), start_share=START_SHARE)
