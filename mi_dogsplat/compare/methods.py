"""All methods that can be compared, by name, in the order of the table."""

from __future__ import annotations

from dataclasses import replace

from ..ablation.variants import VARIANTS, Variant
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

GROUPS = {
    "3DGS": ("3dgs",),
    "pruned by a score": ("opacity", "radsplat", "mini_splatting", "lightgaussian", "pup", "speedy_splat"),
    "learned sparsity": ("mask_gaussian", "lp_3dgs", "gaussian_spa"),
    "grown to the budget": ("taming", "dash"),
    "the paper": ("paper", "released"),
    "ours": ("ours",),
}
METHODS: dict[str, Variant] = {
    "3dgs": replace(VARIANTS["3dgs"], source="Kerbl et al. 2023"),
    "opacity": replace(VARIANTS["v1"], label="opacity", source="smallest opacities go, in five equal rounds"),
    "radsplat": Variant("RadSplat", radsplat.RECIPE, source="Niemeyer et al. 2024"),
    "mini_splatting": Variant(
        "Mini-Splatting", mini_splatting.RECIPE, mini_splatting.MiniSplatting, "Fang and Wang 2024"
    ),
    "lightgaussian": Variant("LightGaussian", lightgaussian.RECIPE, source="Fan et al. 2024"),
    "pup": Variant("PUP-3DGS", pup.RECIPE, source="Hanson et al. 2025"),
    "speedy_splat": Variant("Speedy-Splat", speedy_splat.RECIPE, source="Hanson et al. 2025"),
    "mask_gaussian": Variant("MaskGaussian", mask_gaussian.RECIPE, mask_gaussian.MaskGaussian, "Liu et al. 2025"),
    "lp_3dgs": Variant("LP-3DGS", lp_3dgs.RECIPE, lp_3dgs.LearnToPrune, "Zhang et al. 2024"),
    "gaussian_spa": Variant("GaussianSpa", gaussian_spa.RECIPE, gaussian_spa.GaussianSpa, "Zhang et al. 2025"),
    "taming": Variant("Taming-3DGS", taming.RECIPE, taming.Taming, "Mallick et al. 2024", grows=True),
    "dash": Variant("DashGaussian", dash.RECIPE, dash.Dash, "Chen et al. 2025", grows=True),
    "paper": replace(VARIANTS["full"], label="paper", source="Wang et al. 2026, as printed"),
    "released": replace(VARIANTS["released"], label="released", source="Wang et al. 2026, as in the authors' code"),
    "ours": replace(VARIANTS["ours"], source="this project"),
}
