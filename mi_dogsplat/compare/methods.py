"""All methods that can be compared, by name, in the order of the table."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..scores.score import ScoreRule
from ..training.presets import RECIPES, Recipe
from ..training.strategy.scheduler import PruningRule
from .rivals import (
    dash,
    gaussian_spa,
    lightgaussian,
    lp_3dgs,
    mask_gaussian,
    mini_splatting,
    pup,
    radsplat,
    speedy_splat,
    taming,
)


@dataclass(frozen=True)
class Method:
    """A row of the table."""

    label: str
    recipe: Recipe
    source: str  # paper

    @property
    def grows(self) -> bool:
        """To the target from the first step on, instead of going on from the densified start."""
        return self.recipe.start_share is not None

    @property
    def compact(self) -> bool:
        """Whether it ends with fewer primitives than the baseline."""
        return self.grows or self.recipe.pruning is not None


OPACITY = ScoreRule("opacity")
EQUAL = PruningRule(division="equal", rounds=5)
PAPER = "Wang et al. 2026"
METHODS = {
    "3dgs": Method("3DGS, 100 %", RECIPES["3dgs"], "Kerbl et al. 2023"),
    "opacity": Method("opacity", Recipe(pruning=EQUAL, score=OPACITY), "smallest opacities go, in five equal rounds"),
    "radsplat": Method("RadSplat", radsplat.RECIPE, "Niemeyer et al. 2024"),
    "mini_splatting": Method("Mini-Splatting", mini_splatting.RECIPE, "Fang and Wang 2024"),
    "lightgaussian": Method("LightGaussian", lightgaussian.RECIPE, "Fan et al. 2024"),
    "pup": Method("PUP-3DGS", pup.RECIPE, "Hanson et al. 2025"),
    "speedy_splat": Method("Speedy-Splat", speedy_splat.RECIPE, "Hanson et al. 2025"),
    "mask_gaussian": Method("MaskGaussian", mask_gaussian.RECIPE, "Liu et al. 2025"),
    "lp_3dgs": Method("LP-3DGS", lp_3dgs.RECIPE, "Zhang et al. 2024"),
    "gaussian_spa": Method("GaussianSpa", gaussian_spa.RECIPE, "Zhang et al. 2025"),
    "taming": Method("Taming-3DGS", taming.RECIPE, "Mallick et al. 2024"),
    "dash": Method("DashGaussian", dash.RECIPE, "Chen et al. 2025"),
    # the ablation: each adds one part to the one before it (paper, Table 3)
    "v1": Method("V1: RIR, equal steps, opacity", Recipe(pruning=EQUAL, score=OPACITY), PAPER),
    "v2": Method("V2: + DPRA", Recipe(pruning=PruningRule(), score=OPACITY), PAPER),
    "v3": Method("V3: + SPS", replace(RECIPES["paper"], dog=None), PAPER),
    "full": Method("full: + 3D-DoG (paper)", RECIPES["paper"], PAPER),
    "paper": Method("paper", RECIPES["paper"], f"{PAPER}, as printed"),
    # its own schedule is longer; here everybody has the same number of steps
    "released": Method(
        "released", replace(RECIPES["released"], reference_steps=30_000), f"{PAPER}, as in the authors' code"
    ),
    "ours_gaussian": Method("ours, without DoG", replace(RECIPES["ours"], dog=None), "this project"),
    "ours": Method("ours", RECIPES["ours"], "this project"),
}
WITHOUT_DOG = {"full": "v3", "paper": "v3", "ours": "ours_gaussian"}  # the same method, and what it is without DoG
GROUPS = {
    "3DGS": ("3dgs",),
    "pruned by a score": ("opacity", "radsplat", "mini_splatting", "lightgaussian", "pup", "speedy_splat"),
    "learned sparsity": ("mask_gaussian", "lp_3dgs", "gaussian_spa"),
    "grown to the budget": ("taming", "dash"),
    "the paper": ("v1", "v2", "v3", "full", "paper", "released"),
    "ours": ("ours_gaussian", "ours"),
}
