"""All methods that can be compared, by name, in the order of the table."""

from __future__ import annotations

from dataclasses import replace

from ..ablation.variants import VARIANTS, Variant

METHODS: dict[str, Variant] = {
    "3dgs": replace(VARIANTS["3dgs"], source="Kerbl et al. 2023"),
    "opacity": replace(VARIANTS["v1"], label="opacity", source="smallest opacities go, in five equal rounds"),
    "paper": replace(VARIANTS["full"], label="paper", source="Wang et al. 2026, as printed"),
    "released": replace(VARIANTS["released"], label="released", source="Wang et al. 2026, as in the authors' code"),
    "ours": replace(VARIANTS["ours"], source="this project"),
}
