"""The box of a shape with primitives whose place depends on the view."""

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Splats
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.row_groups import SHIFTS
from mi_dogsplat.scene.transform import transformed
from shifted_models import places_seen, with_shifts
from splat_scenes import axis_rotation, dog_dict, random_splats

NAMES = SHIFTS.names
VIEWS = np.random.default_rng(0).normal(size=(1000, 3))
VIEWS /= np.linalg.norm(VIEWS, axis=1, keepdims=True)
TURN = axis_rotation([1, 2, -1], 0.4)[0]


@pytest.fixture
def model() -> Splats:
    return with_shifts(random_splats(12, seed=1, degree=1))


def placed(linear: np.ndarray) -> Any:
    return affine(linear, (0.1, 0.2, 0.5))


@pytest.mark.parametrize(
    "linear", [np.eye(3), 1.2 * TURN @ np.diag([1, -1, 1])], ids=["where it is", "moved and mirrored"])
def test_its_box_holds_all_places_and_no_more(model, linear):
    model = replace(model, view_shifts=20 * model.view_shifts)
    params: Any = mi.traverse(shape := mi.load_dict(dog_dict(model)))
    params["to_world"] = mi.Transform4f(placed(linear))
    params.update()
    moved = transformed(model, placed(linear))
    places = np.concatenate([moved.means, places_seen(moved, VIEWS).reshape(-1, 3)])
    low, high = (np.array(corner) for corner in (shape.bbox().min, shape.bbox().max))
    size = np.ptp(places, axis=0)
    assert (np.ptp(moved.means, axis=0) < 0.8 * size).all()
    for slack in (places.min(0) - low, high - places.max(0)):
        assert (slack > -1e-5).all() and (slack < 0.02 * size).all()


@pytest.mark.parametrize("name", NAMES)
def test_places_that_are_not_finite_leave_the_box_finite(model, name):
    values = getattr(model, name).copy()
    values[0] = np.inf
    box = mi.load_dict(dog_dict(replace(model, **{name: values}))).bbox()
    assert np.isfinite(box.min).all() and np.isfinite(box.max).all() and box.valid()
