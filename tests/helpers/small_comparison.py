"""Methods and settings of a comparison that takes seconds."""

from typing import Any

NAMES = ("3dgs", "mini_splatting", "mask_gaussian", "dash", "ours")
SETTINGS: dict[str, Any] = {
    "preset": "3dgs",
    "steps": 60,
    "sh_degree": 1,
    "max_primitives": 120,
    "target": 0.25,
    "log_every": 10,
}
