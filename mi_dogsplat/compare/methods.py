"""All methods that can be compared, by name, in the order of the table."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..scores.score import ScoreRule
from ..training.presets import EARLY_SHARE, RECIPES
from ..training.recipe import GROWTH_GAIN, Recipe
from ..training.strategy.scheduler import PruningRule
from .equal import EQUAL_RECIPES, OURS_PUBLISHED
from .names import ALL, OURS, SUFFIX
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
    speedy_splat,
    taming,
)


@dataclass(frozen=True)
class Method:
    """A row of the table."""

    label: str
    recipe: Recipe
    source: str  # paper
    deviations: str = ""  # in what it is not what the authors published
    whole: bool = False  # trained from the first step on, not from the densified start
    revision: int = 1  # one more where the method changes and its numbers do not: earlier runs are not of it
    masked_revision: int = 1  # likewise, where it changes for photographs with masks alone

    @property
    def grows(self) -> bool:
        """To the target from the first step on, instead of going on from the densified start."""
        return self.recipe.start_share is not None

    @property
    def from_the_start(self) -> bool:
        """Whether it goes on from the densified start of its seed."""
        return not (self.grows or self.whole)

    @property
    def length(self) -> float:
        """Of its run, times the steps of all others."""
        return self.recipe.reference_steps / STEPS

    @property
    def compact(self) -> bool:
        """Whether it ends with fewer primitives than the baseline."""
        return self.grows or self.recipe.pruning is not None


STEPS = 30_000  # of the schedule that all share
OPACITY = ScoreRule("opacity")
EQUAL = PruningRule(division="equal", rounds=5)
PAPER = "Wang et al. 2026"
EARLY_STEPS = f"a growth of its own: {100 * EARLY_SHARE:.0f} % of the steps, {GROWTH_GAIN:g} times as large"
EARLY_3DGS = EQUAL_RECIPES["3dgs"].growing(EARLY_SHARE)
EQUAL_STEPS = "window and step sizes are ours"
DENSIFIED = (
    "first densified at step 500 (the code: at 600); a densification step is also one of Adam (in the code it is "
    "not); opacities are not reset at step 500 over a white background; all methods that go on from the densified "
    "start share this"
)
AS_PUBLISHED = {
    "3dgs": Method("3DGS, 100 %", RECIPES["3dgs"], "Kerbl et al. 2023", DENSIFIED),
    "opacity": Method("opacity", Recipe(pruning=EQUAL, score=OPACITY), "smallest opacities go, in five equal rounds"),
    "radsplat": Method("RadSplat", radsplat.RECIPE, "Niemeyer et al. 2024", radsplat.DEVIATIONS, masked_revision=2),
    "mini_splatting": Method(
        "Mini-Splatting", mini_splatting.RECIPE, "Fang and Wang 2024", mini_splatting.DEVIATIONS, revision=2,
        masked_revision=2,
    ),  # fmt: skip
    "lightgaussian": Method(
        "LightGaussian", lightgaussian.RECIPE, "Fan et al. 2024", lightgaussian.DEVIATIONS, masked_revision=2
    ),
    "pup": Method("PUP-3DGS", pup.RECIPE, "Hanson et al. 2025", pup.DEVIATIONS, masked_revision=2),
    "speedy_splat": Method("Speedy-Splat", speedy_splat.RECIPE, "Hanson et al. 2025", speedy_splat.DEVIATIONS),
    "mask_gaussian": Method(
        "MaskGaussian", mask_gaussian.RECIPE, "Liu et al. 2025", mask_gaussian.DEVIATIONS, whole=True, revision=2
    ),
    "lp_3dgs": Method("LP-3DGS", lp_3dgs.RECIPE, "Zhang et al. 2024", lp_3dgs.DEVIATIONS, masked_revision=2),
    "gaussian_spa": Method(
        "GaussianSpa", gaussian_spa.RECIPE, "Zhang et al. 2025", gaussian_spa.DEVIATIONS, revision=2, masked_revision=2
    ),
    "gns": Method("GNS", gns.RECIPE, "arXiv 2511.16980", gns.DEVIATIONS, revision=3, masked_revision=2),
    "taming": Method(
        "Taming-3DGS", taming.RECIPE, "Mallick et al. 2024", taming.DEVIATIONS, revision=3, masked_revision=2
    ),
    "dash": Method("DashGaussian", dash.RECIPE, "Chen et al. 2025", dash.DEVIATIONS, revision=2),
    "mcmc": Method("3DGS-MCMC", mcmc.RECIPE, "Kheradmand et al. 2024", mcmc.DEVIATIONS),
    "improved_gs": Method(
        "Improved-GS", improved_gs.RECIPE, "Deng et al. 2025", improved_gs.DEVIATIONS, revision=2, masked_revision=2
    ),
    "3dgs_capped": Method("3DGS, capped", capped.RECIPE, "Kerbl et al. 2023, with the budget as its cap"),
    # the ablation: each adds one part to the one before it (paper, Table 3)
    "v1": Method("V1: RIR, equal steps, opacity", Recipe(pruning=EQUAL, score=OPACITY), PAPER),
    "v2": Method("V2: + DPRA", Recipe(pruning=PruningRule(), score=OPACITY), PAPER),
    "v3": Method("V3: + SPS", replace(RECIPES["paper"], dog=None), PAPER),
    "full": Method("full: + 3D-DoG (paper)", RECIPES["paper"], PAPER),
    "paper": Method("paper", RECIPES["paper"], f"{PAPER}, as printed", "what the text leaves open is our choice"),
    "released": Method(
        "released",
        replace(RECIPES["released"], reference_steps=STEPS),
        f"{PAPER}, as in the authors' code",
        "30,000 of its 40,000 steps, as all others",
        revision=2,
    ),
    "released_40k": Method(
        "released, 40,000 steps",
        RECIPES["released"],
        f"{PAPER}, as in the authors' code",
        "a third more steps than all others",
        revision=2,
    ),
    "ours_published": Method("ours, the paper's schedule", OURS_PUBLISHED, "this project"),
    "ours_gaussian": Method("ours, without DoG", replace(RECIPES["ours"], dog=None), "this project"),
    "ours": Method("ours", RECIPES["ours"], "this project; removal error: GaussianPOP, arXiv 2602.06830"),
    "ours_slopes": Method("ours, with slopes", RECIPES["ours_slopes"], "this project: docs/slopes.md"),
    "ours_cuts": Method("ours, with slopes and cuts", RECIPES["ours_cuts"], "this project: docs/cuts.md"),
    "ours_preconditioned": Method(
        "ours, preconditioned", RECIPES["ours_preconditioned"], "this project: docs/preconditioning.md"
    ),
    "ours_second_cuts": Method("ours, with second cuts", RECIPES["ours_second_cuts"], "this project: docs/cuts.md"),
    "ours_curvatures": Method("ours, with curvatures", RECIPES["ours_curvatures"], "this project: docs/curvatures.md"),
    "ours_shifts": Method("ours, with shifts", RECIPES["ours_shifts"], "this project: docs/shifts.md"),
    "3dgs_early": Method("3DGS, 100 %, our steps, early", EARLY_3DGS, "Kerbl et al. 2023", EARLY_STEPS, whole=True),
    "ours_early": Method("ours, early", RECIPES["ours_early"], "this project", EARLY_STEPS, whole=True),
}


def equal(name: str) -> Method:
    """A method with our window and step sizes."""
    known = AS_PUBLISHED[name]
    words = "; ".join(filter(None, [EQUAL_STEPS, known.deviations]))
    return Method(
        f"{known.label}, our steps", EQUAL_RECIPES[name], known.source, words,
        revision=known.revision, masked_revision=known.masked_revision,
    )  # fmt: skip


WITH_OURS = {name + SUFFIX: equal(name) for name in EQUAL_RECIPES}
METHODS = {name: (AS_PUBLISHED | WITH_OURS)[name] for name in ALL}
# the same method, and what it is without DoG
WITHOUT_DOG = {"full": "v3", "paper": "v3", "ours": "ours_gaussian"}
GROUPS = {
    "3DGS": ("3dgs", "3dgs_early"),
    "pruned by a score": ("opacity", "radsplat", "mini_splatting", "lightgaussian", "pup", "speedy_splat"),
    "learned sparsity": ("mask_gaussian", "lp_3dgs", "gaussian_spa", "gns"),
    "grown to the budget": ("taming", "dash", "mcmc", "improved_gs", "3dgs_capped"),
    "the paper": ("v1", "v2", "v3", "full", "paper", "released", "released_40k"),
    "ours": ("ours_published", "ours_gaussian", *OURS, "ours_early"),
}
GROUPS = {
    group: (*names, *(name + SUFFIX for name in names if name + SUFFIX in METHODS)) for group, names in GROUPS.items()
}
