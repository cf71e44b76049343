"""LPIPS (Zhang et al. 2018), the learned distance of the papers' tables, where the package and its weights are there.

The weights of the VGG network underneath are not ours to ship, and nothing is downloaded here: without them the column
is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

LPIPS = "lpips.json"  # in a run folder
VGG = "vgg16-397923af.pth"  # as torchvision calls it


def lpips_of_run(run: Path, views: Sequence[str]) -> float | None:
    """Mean over the test views of a run folder, by the network VGG; None where it cannot be had."""
    if not views or not find_spec("lpips") or not find_spec("torch"):
        return None
    import lpips  # pyright: ignore[reportMissingImports]
    import torch  # pyright: ignore[reportMissingImports]

    if not (Path(torch.hub.get_dir()) / "checkpoints" / VGG).exists():
        return None
    distance = lpips.LPIPS(net="vgg", verbose=False)
    with torch.no_grad():
        pairs = ((_picture(run / "test" / f"{name}{end}.png") for end in ("", "_gt")) for name in views)
        return float(np.mean([float(distance(*(torch.from_numpy(p) for p in pair))) for pair in pairs]))


def _picture(path: Path) -> Any:
    """[1, 3, H, W] in -1..1."""
    from PIL import Image

    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB"), np.float32) / 127.5 - 1
    return np.ascontiguousarray(pixels.transpose(2, 0, 1)[None])
