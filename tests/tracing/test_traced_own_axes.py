"""What holds on rays for slopes, curvatures and cuts: beside models without them, and where they are not finite."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, concatenate, upload
from mi_dogsplat.reference import rays as twin
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.tracing.options import TraceOptions
from mi_dogsplat.tracing.tracer import SplatTracer
from own_axes_models import EACH_KIND, KINDS, Kind, for_each_kind
from ray_sets import decided, gathered, kernels_of_tracing, random_rays, tracer_of
from splat_scenes import random_splats, rounded


@EACH_KIND
def test_a_model_without_them_beside_one_with_them(kind: Kind):
    parts = [rounded(kind.drawn(share, 20, seed=5 + k, degree=1)) for k, share in enumerate((0, 0.5, 0))]
    params, _ = concatenate([upload(part) for part in parts], [4, 4, 4])
    assert len(params[kind.group.index]) == len(kind.index(parts[1])) > 0
    rays = random_rays(150, seed=6)
    colors, _ = gathered(SplatTracer(params, TraceOptions(1)), rays)
    whole = Splats(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in (*RAW, *RAW_DOG)},
        dog_index=np.concatenate([part.dog_index + 20 * k for k, part in enumerate(parts)]),
        **{kind.group.index: kind.index(parts[1]) + 20, kind.name: kind.values(parts[1])},
    )
    sure = decided(whole, rays)
    np.testing.assert_allclose(colors[sure], twin.gather(rays.meet(whole))[0][sure], atol=2e-5, rtol=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@for_each_kind("place", (2, 1, 0), (2, 4), (2, 1))
def test_a_primitive_whose_values_are_not_finite_is_not_drawn(kind: Kind, place, value):
    splats = rounded(kind.drawn(0.5, 20, seed=7))
    broken = Splats(**{**vars(splats), kind.name: kind.values(splats).copy()})
    kind.values(broken)[place] = value
    rest = splats.select(np.delete(np.arange(20), kind.index(splats)[place[0]]))
    rays = random_rays(100, seed=8)
    for a, b in zip(gathered(tracer_of(broken), rays), gathered(tracer_of(rest), rays), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


@EACH_KIND
def test_a_model_without_them_has_the_kernels_of_one_that_never_had_any(kind: Kind):
    """Beside those of the other kinds that it has."""
    never = rounded(random_splats(40, seed=9, degree=1))
    for other in KINDS[: KINDS.index(kind)]:
        never = other.having(never)
    rays = random_rays(100, seed=10)

    having = kind.having(never)
    emptied = {kind.group.index: kind.index(having)[:0], kind.name: kind.values(having)[:0]}
    assert kernels_of_tracing(replace(having, **emptied), rays) == kernels_of_tracing(never, rays)
    assert kernels_of_tracing(having, rays) != kernels_of_tracing(never, rays)
