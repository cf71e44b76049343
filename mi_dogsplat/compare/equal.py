"""Equal optimisation: every method with the window and the step sizes of ``ours``, so that what differs is the idea.

Of a score that is all but the score. Learned sparsity learns within the window, and is cut to the budget at its end.
What grows to the budget keeps its densification and gets the step sizes that ours has after pruning. Step sizes of the
authors' own code, and beginnings anew, are left out: they are optimisation.
"""

from __future__ import annotations

from dataclasses import replace

from ..scores.score import Score, ScoreRule
from ..training.presets import RECIPES
from ..training.recipe import Recipe
from ..training.strategy.scheduler import PruningRule
from .rivals import (
    capped,
    dash,
    gaussian_spa,
    gns,
    improved_gs,
    lightgaussian,
    lp_3dgs,
    mask_gaussian,
    mcmc,
    mini_splatting,
    pup,
    radsplat,
    taming,
)

OURS = RECIPES["ours"]
assert OURS.pruning
FROM, TO = OURS.pruning.start, OURS.pruning.stop
AT_ONCE = PruningRule(TO, TO, division=(1.0,), rounds=1)


def scored(score: Score, *also) -> Recipe:
    """A score, and what belongs to it."""
    return Recipe(pruning=OURS.pruning, score=score, also=also, refinement=OURS.refinement)


def learned(score: Score, *also) -> Recipe:
    """Sparsity that is learned, cut to the budget at the end of the window."""
    return Recipe(pruning=AT_ONCE, score=score, also=also, refinement=OURS.refinement)


def grown(recipe: Recipe, *also) -> Recipe:
    """A recipe that grows to the budget."""
    return replace(recipe, also=also, refinement=OURS.refinement)


OPACITY = ScoreRule("opacity")
WITH_DOG = replace(RECIPES["paper"], pruning=OURS.pruning, refinement=OURS.refinement)
DOG = RECIPES["paper"].dog
assert DOG and OURS.dog
EQUAL_RECIPES = {
    "3dgs": Recipe(refinement=OURS.refinement),
    "opacity": scored(OPACITY),
    "radsplat": scored(radsplat.LargestWeight()),
    "mini_splatting": scored(mini_splatting.SummedWeight(), mini_splatting.DrawFirst()),
    "lightgaussian": scored(lightgaussian.GlobalSignificance()),
    "pup": scored(pup.Sensitivity()),
    "speedy_splat": scored(ScoreRule("spatio-spectral", spectral_weight=0.0)),
    "mask_gaussian": learned(OPACITY, mask_gaussian.MaskGaussian(FROM, TO, densified=0)),
    "lp_3dgs": learned(radsplat.LargestWeight(), lp_3dgs.LearnToPrune(TO - 500, TO)),
    "gaussian_spa": learned(OPACITY, gaussian_spa.GaussianSpa(FROM, TO)),
    "gns": learned(OPACITY, gns.NaturalSelection(FROM, TO, gentle=300, rate_factor=1.0)),
    "taming": grown(taming.RECIPE),
    "dash": grown(dash.RECIPE, dash.SmallPictures(holds=False)),
    "mcmc": grown(mcmc.RECIPE, mcmc.Mcmc()),
    "improved_gs": grown(improved_gs.RECIPE, improved_gs.RecoveryAware()),
    "3dgs_capped": grown(capped.RECIPE),
    "paper": replace(WITH_DOG, dog=replace(DOG, start=OURS.dog.start)),
    "released": replace(
        WITH_DOG, score=ScoreRule("released"), dog=replace(DOG, start=OURS.dog.start, scale=1.6, control=False)
    ),
}
# and the other way round: our score and our start of DoG, by the paper's schedule and step sizes
OURS_PUBLISHED = replace(RECIPES["paper"], score=OURS.score, dog=replace(OURS.dog, start=DOG.start))
