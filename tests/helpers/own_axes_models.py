"""What primitives may have along their own axes, slopes of a colour and cuts: models that show them, and pictures."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
from cut_models import with_cuts, with_second_cuts
from mi_dogsplat import Splats, reference
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, SECOND_CUTS, SHIFTS, SLOPES
from row_kinds import RowKind, of_each
from shifted_models import with_shifts
from sloped_models import with_curvatures, with_slopes
from splat_scenes import C0, random_splats, scene_of, square_camera

CAMERA = square_camera(16, 12, f=14.0)
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3))


@dataclass(frozen=True)
class Kind(RowKind):
    """A model of which some primitives are in a group, and what that changes."""

    having: Callable[..., Splats]  # the model with them in each second primitive, or each `every`-th
    step: float  # of Adam, a part of how large their values are

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a row."""
        return self.group.arrays[self.name]

    @property
    def share(self) -> str:
        """What `random_splats` calls the share of the primitives that have them."""
        return self.group.index.replace("_index", "_share")

    def drawn(self, share: float, n: int, seed=0, degree=3) -> Any:
        """What `random_splats` makes when such a share of the primitives is to have them."""
        shares: dict[str, Any] = {self.share: share}
        return random_splats(n, seed, degree, **shares)

    def given(self, splats: Any, values: Any, rows: Any = (0,)) -> Any:
        """The same object, in which the primitives ``rows`` have these."""
        setattr(splats, self.group.index, np.asarray(rows))
        setattr(splats, self.name, np.reshape(np.asarray(values, float), (-1, *self.shape)))
        return splats

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


SLOPED, CUT = Kind("slopes", SLOPES, with_slopes, 0.02), Kind("cuts", CUTS, with_cuts, 0.2)
SECOND_CUT = Kind("second_cuts", SECOND_CUTS, with_second_cuts, 0.2)
CURVED = Kind("curvatures", CURVATURES, with_curvatures, 0.02)
SHIFTED = Kind("shifts", SHIFTS, with_shifts, 0.02)  # which no ray and no pixel has to know: not among the others
PLANE_KINDS = CUT, SECOND_CUT
KINDS = SLOPED, CURVED, *PLANE_KINDS
EACH_KIND, EACH_PLANE, AND_SHIFTS = of_each(*KINDS), of_each(*PLANE_KINDS), of_each(*KINDS, SHIFTED)


def picture(splats: Splats, **others) -> np.ndarray:
    return mi.render(scene_of(splats, CAMERA, **others)).numpy()


def traversed(splats: Splats, **others) -> tuple[Any, Any]:
    scene: Any = scene_of(splats, CAMERA, **others)
    return scene, mi.traverse(scene)


def nearest_on_ray(splats: Any, i: int, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """[3] where a ray is nearest to primitive ``i``, in standard deviations along its axes, by a search up to 12."""
    points = origin + np.linspace(0, 12, 600_001)[:, None] * direction
    w = (points - splats.means[i]) @ reference.rotations(splats.quats)[i] / np.exp(splats.log_scales[i])
    return w[(w**2).sum(1).argmin()]
