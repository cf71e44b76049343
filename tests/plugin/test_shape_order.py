"""Several ``dog`` shapes in a scene: in which order they are joined. Mitsuba's own changes from load to load."""

from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Splats
from mi_dogsplat.engine.parameters import RAW
from splat_scenes import dog_dict, make_splats, rounded, scene_of, square_camera

CAMERA = square_camera(16, 12, f=14.0)
IDS = ("splats", *(f"tail_{k}" for k in range(5)))


@pytest.fixture
def parts() -> list[Splats]:
    """One primitive each, all in one place, of different colours: the first one is in front."""
    colors = np.random.default_rng(0).uniform(size=(len(IDS), 3))
    return [rounded(make_splats([[0, 0, 3]], 0.6, 0.6, color)) for color in colors]


def test_primitives_of_one_depth_are_in_the_order_of_the_ids_of_their_shapes(parts):
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in RAW}
    expected = mi.render(scene_of(Splats(**joined), CAMERA)).numpy()
    others: dict[str, Any] = {name: dog_dict(part) for name, part in zip(IDS[1:], parts[1:], strict=True)}
    for extra in (others, dict(reversed(others.items()))):
        np.testing.assert_array_equal(mi.render(scene_of(parts[0], CAMERA, extra=extra)).numpy(), expected)


def test_an_index_counts_through_the_shapes_in_the_order_of_their_ids(parts):
    """The one that is far more opaque than those before it."""
    for shown, name in enumerate(IDS):
        opacities = {other: mi.TensorXf([8.0 if other == name else -4.0]) for other in IDS}
        of_shapes: Any = {n: dog_dict(p) | {"logit_opacities": opacities[n]} for n, p in zip(IDS, parts, strict=True)}
        first = of_shapes.pop("splats")
        scene = scene_of(parts[0], CAMERA, shape=first, extra=of_shapes, aovs="index")
        assert set(np.unique(mi.render(scene).numpy()[..., 3])) <= {-1.0, float(shown)}
        assert (mi.render(scene).numpy()[..., 3] == shown).any()
