"""What a scan has become, in numbers (``summary.json``) and in words."""

from __future__ import annotations

from dataclasses import dataclass

from ..support.wording import counted
from .scan_depth import FARTHEST
from .summary import Stored


@dataclass(frozen=True)
class ScanSummary(Stored):
    """``corrected``: whether the app has corrected the poses; ``n_depths``: depth maps in which something is known;
    ``known``: the mean share of their pixels that is; ``up_from``: how up was found."""

    app: str
    n_images: int
    corrected: bool
    n_points: int
    n_depths: int
    known: float
    n_masks: int
    up_from: str

    def lines(self) -> list[str]:
        """Sentences for people."""
        how = "as the app corrected them" if self.corrected else "as ARKit tracked them"
        lines = [f"{counted(self.n_images, 'image')} of a scan by {self.app}, with poses {how}"]
        if self.n_depths:
            lines += [
                f"{counted(self.n_points, 'point')} from {counted(self.n_depths, 'depth map')}, of whose pixels "
                f"{self.known:.0%} are known; the others are uncertain, or beyond {FARTHEST:g} m",
                "train with --depths and the folder depth/ here",
            ]
        else:
            lines.append("no depth maps, and so no points to start from")
        lines.append(f"up is -y, {self.up_from}; the unit is a metre")
        if self.n_masks:
            lines.append(f"{counted(self.n_masks, 'mask')} of black borders; train with --masks and masks/ here")
        if not self.corrected:
            lines.append("such poses drift: train with --refine-poses")
        return lines
