"""What holds on rays for all rows of primitives: beside models without them, and where they are not finite."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, concatenate, upload
from mi_dogsplat.reference import rays as twin
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.tracing.options import TraceOptions
from mi_dogsplat.tracing.tracer import SplatTracer
from own_axes_models import AND_SHIFTS, KINDS, SHIFTED, Kind
from ray_sets import decided, gathered, kernels_of_tracing, random_rays, tracer_of
from splat_scenes import random_splats, rounded


@AND_SHIFTS
def test_a_model_without_them_beside_one_with_them(kind: Kind):
    parts = [rounded(kind.drawn(share, 20, seed=5 + k, degree=1)) for k, share in enumerate((0, 0.5, 0))]
    params, _ = concatenate([upload(part) for part in parts], [4, 4, 4])
    assert len(params[kind.group.index]) == len(kind.index(parts[1])) > 0
    rays = random_rays(150, seed=6)
    colors, T = gathered(SplatTracer(params, TraceOptions(1)), rays)
    whole = Splats(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in (*RAW, *RAW_DOG)},
        dog_index=np.concatenate([part.dog_index + 20 * k for k, part in enumerate(parts)]),
        **{name: getattr(parts[1], name) for name in kind.group.names},
        **{kind.group.index: kind.index(parts[1]) + 20},
    )
    sure, (expected, expected_T) = decided(whole, rays), twin.gather(rays.meet(whole))
    np.testing.assert_allclose(colors[sure], expected[sure], atol=2e-5, rtol=1e-4)
    np.testing.assert_allclose(T[sure], expected_T[sure], atol=2e-6, rtol=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@AND_SHIFTS
def test_a_primitive_whose_values_are_not_finite_is_not_drawn(kind: Kind, value):
    splats = rounded(kind.drawn(0.5, 20, seed=7))
    rest, rays = splats.select(np.delete(np.arange(20), kind.index(splats)[2])), random_rays(100, seed=8)
    for name in kind.group.names:
        broken = Splats(**{**vars(splats), name: getattr(splats, name).copy()})
        getattr(broken, name)[2].ravel()[1] = value
        for a, b in zip(gathered(tracer_of(broken), rays), gathered(tracer_of(rest), rays), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-6)


@AND_SHIFTS
def test_a_model_without_them_has_the_kernels_of_one_that_never_had_any(kind: Kind):
    """Beside those of the other kinds that it has."""
    never = rounded(random_splats(40, seed=9, degree=1))
    for other in KINDS if kind is SHIFTED else KINDS[: KINDS.index(kind)]:
        never = other.having(never)
    rays = random_rays(100, seed=10)

    having = kind.having(never)
    emptied = {name: getattr(having, name)[:0] for name in (kind.group.index, *kind.group.names)}
    assert kernels_of_tracing(replace(having, **emptied), rays) == kernels_of_tracing(never, rays)
    assert kernels_of_tracing(having, rays) != kernels_of_tracing(never, rays)
