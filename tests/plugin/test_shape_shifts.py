"""The shape with primitives whose place depends on the view: in, changed, moved, its box and what it becomes."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Splats, to_ellipsoids, write_ply
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, upload
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.row_groups import SHIFTS
from mi_dogsplat.scene.transform import transformed
from own_axes_models import ADJOINT, CAMERA, picture, traversed
from shifted_models import places_seen, with_shifts
from splat_scenes import axis_rotation, dog_dict, random_splats, scalar_transform, scene_of

NAMES = SHIFTS.names
VIEWS = np.random.default_rng(0).normal(size=(1000, 3))
VIEWS /= np.linalg.norm(VIEWS, axis=1, keepdims=True)
TURN = axis_rotation([1, 2, -1], 0.4)[0]


@pytest.fixture
def model() -> Splats:
    return with_shifts(random_splats(12, seed=1, degree=1))


def placed(linear: np.ndarray) -> Any:
    return affine(linear, (0.1, 0.2, 0.5))


@pytest.mark.parametrize("source", ["tensors", "file"])
def test_they_go_in_are_traversed_and_come_out(tmp_path, model, source):
    given: dict = dog_dict(model)
    if source == "file":
        write_ply(tmp_path / "model.ply", model)
        given = {"type": "dog", "filename": str(tmp_path / "model.ply")}
    shape: Any = mi.load_dict(given)
    params: Any = mi.traverse(shape)
    assert set(params.keys()) == {*RAW, *RAW_DOG, "dog_index", "shift_index", *NAMES, "to_world"}
    assert [params[name].shape for name in NAMES] == [(6, 3, 3), (6, 3)]
    assert {params.flags(name) for name in NAMES} == {mi.ParamFlags.Differentiable}
    assert params.flags("shift_index") == mi.ParamFlags.NonDifferentiable
    for name in ("shift_index", *NAMES):
        np.testing.assert_array_equal(getattr(shape.to_splats(), name), getattr(model, name))
    assert "shifts = 6" in str(shape)
    assert set(shape.parameters) == set(upload(model))
    assert "shift" not in str(mi.load_dict(dog_dict(model.without_shifts())))


def test_updates_change_values_and_rows_and_may_leave_none(model):
    scene, params = traversed(model)
    params["splats.view_shifts"] = params["splats.view_shifts"] * 2
    params["splats.mean_views"] = params["splats.mean_views"] - 1
    params.update()
    changed = replace(model, view_shifts=2 * model.view_shifts, mean_views=model.mean_views - 1)
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(changed), atol=1e-5)
    assert np.abs(picture(changed) - picture(model)).max() > 0.05
    for index in ([2, 9], []):
        rows = {"shift_index": index, **{name: getattr(model, name)[: len(index)] for name in NAMES}}
        params["splats.shift_index"] = mi.UInt32(rows["shift_index"])
        for name in NAMES:
            params[f"splats.{name}"] = mi.TensorXf(rows[name])
        params.update()
        np.testing.assert_array_equal(mi.render(scene).numpy(), picture(replace(model, **rows)))


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("shift_index", [0, 1, 2], r'"view_shifts" has shape \(6, 3, 3\), expected \(3, 3, 3\) to match "shift_index"'),
        ("mean_views", np.zeros((5, 3)), r'"mean_views" has shape \(5, 3\), expected \(6, 3\) to match "shift_index"'),
        ("view_shifts", np.zeros((6, 9)), r'"view_shifts" has shape \(6, 9\)'),
        ("shift_index", [0, 2, 4, 4, 6, 8], '"shift_index" is not strictly increasing'),
        ("shift_index", [0, 2, 4, 6, 8, 12], '"shift_index" names primitive 12'),
    ],
)
def test_updates_that_do_not_fit_are_refused(model, name, value, problem):
    params: Any = mi.traverse(mi.load_dict(dog_dict(model)))
    params[name] = mi.UInt32(value) if name == "shift_index" else mi.TensorXf(value)
    with pytest.raises(RuntimeError, match=problem):
        params.update()


def test_tensors_that_are_missing_or_do_not_fit_are_refused_at_load(model):
    given = dog_dict(model)
    with pytest.raises(RuntimeError, match='"mean_views" has 2 rows, "shift_index" has 6'):
        mi.load_dict({**given, "mean_views": mi.TensorXf(model.mean_views[:2])})
    del given["mean_views"]
    with pytest.raises(RuntimeError, match='"mean_views" has 0 rows, "shift_index" has 6'):
        mi.load_dict(given)


def test_shapes_with_and_without_are_drawn_as_one_model(model):
    parts = [random_splats(9, seed=3, degree=1), model, with_shifts(random_splats(8, seed=5, degree=1), every=3)]
    parts[0] = Splats(**vars(parts[0]))
    scene = scene_of(parts[0], CAMERA, extra={f"tail_{k}": dog_dict(part) for k, part in enumerate(parts[1:])})
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(parts[0].joined(*parts[1:])), atol=1e-5)


@pytest.mark.parametrize("mirror", [1, -1], ids=["turned", "mirrored"])
def test_a_moved_shape_takes_them_along(model, mirror):
    matrix = placed(1.2 * TURN @ np.diag([1, mirror, 1]))
    expected = transformed(model, matrix)
    scene, params = traversed(model)
    params["splats.to_world"] = mi.Transform4f(matrix)
    params.update()
    image = picture(expected)
    assert np.abs(image - picture(expected.without_shifts())).max() > 0.03
    np.testing.assert_allclose(mi.render(scene).numpy(), image, atol=2e-4)
    loaded = picture(model, shape={"to_world": scalar_transform(matrix)})
    np.testing.assert_allclose(loaded, image, atol=2e-4)
    found = scene.shapes()[0].to_splats()
    for name in NAMES:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-6)

    gradients = []
    for of_scene, of_params in ((scene, params), traversed(expected)):
        dr.enable_grad([of_params[f"splats.{name}"] for name in NAMES])
        of_params.update()
        dr.backward(dr.sum(mi.render(of_scene, of_params) * mi.TensorXf(ADJOINT.astype(np.float32))))
        gradients.append([dr.grad(of_params[f"splats.{name}"]).numpy() for name in NAMES])
    scale = np.abs(gradients[1][0]).max()
    assert scale > 0.1
    np.testing.assert_allclose(gradients[0][0], gradients[1][0], atol=1e-3 * scale)
    np.testing.assert_allclose(gradients[0][1], mirror * gradients[1][1], atol=1e-3 * scale)


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


def test_ellipsoids_stand_where_they_are_stored_and_that_is_said(capfd, model):
    model = model.plain()
    got, expected = to_ellipsoids(model), to_ellipsoids(model.without_shifts())
    assert "left out the shifts of 6 primitives" in "".join(capfd.readouterr())
    for name in ("centers", "scales", "quaternions", "opacities", "sh_coeffs"):
        np.testing.assert_array_equal(got[name].numpy(), expected[name].numpy())
    values = model.mean_views.copy()
    values[1, 2] = np.nan
    broken = to_ellipsoids(replace(model, mean_views=values))
    np.testing.assert_array_equal(broken["centers"].numpy(), np.delete(got["centers"].numpy(), 2, axis=0))
