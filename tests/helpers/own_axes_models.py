"""The two things that primitives may have along their own axes, slopes of a colour and cuts, and models that show them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from cut_models import with_cuts
from mi_dogsplat import Splats
from mi_dogsplat.scene.row_groups import CUTS, SLOPES, RowGroup
from sloped_models import with_slopes
from splat_scenes import C0, random_splats


@dataclass(frozen=True)
class Kind:
    """A model of which some primitives are in a group, and what that changes."""

    group: RowGroup
    word: str
    having: Callable[[Any], Splats]
    step: float  # of Adam, a part of how large their values are

    @property
    def name(self) -> str:
        return self.group.names[0]

    def random(self, n=12, seed=1, degree=1) -> Splats:
        """Each second primitive has them.

        They are large and rather opaque, so that a part of one shows. No colour is so dark that it is near the kink of
        max(0, SH + 0.5), where a difference is no derivative.
        """
        splats = random_splats(n, seed, degree)
        splats.log_scales, splats.logit_opacities = splats.log_scales + 0.7, splats.logit_opacities + 1
        splats.sh_coeffs[:, 0] += 0.5 / C0
        return self.having(splats)

    @property
    def model(self) -> Splats:
        return self.random()

    @property
    def without(self) -> Splats:
        return self.bare(self.model)

    def bare(self, splats: Splats) -> Splats:
        return splats.without_slopes() if self.group is SLOPES else splats.without_cuts()

    def index(self, splats: Splats) -> np.ndarray:
        return getattr(splats, self.group.index)

    def values(self, splats: Splats) -> np.ndarray:
        return getattr(splats, self.name)


SLOPED, CUT = Kind(SLOPES, "slopes", with_slopes, 0.02), Kind(CUTS, "cuts", with_cuts, 0.2)
KINDS = {"slopes": SLOPED, "cuts": CUT}
