"""The shape with what primitives may have, slopes, curvatures, cuts and shifts: in, changed, moved and out."""

from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Splats, to_ellipsoids, write_ply
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, upload
from mi_dogsplat.plugin import splat_integrator
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.row_groups import ALONG_AXES
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.scene.whole import whole
from own_axes_models import (
    ADJOINT,
    AND_SHIFTS,
    CAMERA,
    CUT,
    PLANE_KINDS,
    SECOND_CUT,
    SHIFTED,
    Kind,
    picture,
    traversed,
)
from splat_scenes import axis_rotation, dog_dict, random_splats, scalar_transform, scene_of


@AND_SHIFTS
@pytest.mark.parametrize("source", ["tensors", "file"])
def test_they_go_in_are_seen_and_come_out(tmp_path, kind: Kind, source):
    model, index, names = kind.model, kind.group.index, kind.group.names
    write_ply(tmp_path / "model.ply", model)
    file = {"type": "dog", "filename": str(tmp_path / "model.ply")}
    shape: Any = mi.load_dict(file if source == "file" else dog_dict(model))
    params: Any = mi.traverse(shape)
    assert set(params.keys()) == {*RAW, *RAW_DOG, "dog_index", *names, index, "to_world"}
    for name in names:
        assert params[name].shape == getattr(model, name).shape
        assert params.flags(name) == mi.ParamFlags.Differentiable
    assert params.flags(index) == mi.ParamFlags.NonDifferentiable
    for key in (index, *names):
        np.testing.assert_array_equal(getattr(shape.to_splats(), key), getattr(model, key))
    assert f"{kind.word} = {len(kind.index(model))}" in str(shape)
    assert kind.word not in str(mi.load_dict(dog_dict(kind.without(kind.model))))
    given = upload(model)
    assert set(shape.parameters) == set(given)
    np.testing.assert_array_equal(shape.parameters[kind.group.row].numpy(), given[kind.group.row].numpy())


@AND_SHIFTS
def test_updates_change_values_and_rows_and_may_leave_none(kind: Kind):
    model, index = kind.model, kind.group.index
    values = {name: getattr(model, name) for name in kind.group.names}
    scene, params = traversed(model)
    for name in values:
        params[f"splats.{name}"] = params[f"splats.{name}"] * 2
    params.update()
    doubled = replace(model, **{name: 2 * rows for name, rows in values.items()})
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(doubled), atol=1e-6)
    for rows in ([2, 9], []):
        given = {name: of_model[: len(rows)] for name, of_model in values.items()}
        params[f"splats.{index}"] = mi.UInt32(rows)
        for name, of_rows in given.items():
            params[f"splats.{name}"] = mi.TensorXf(of_rows)
        params.update()
        np.testing.assert_array_equal(mi.render(scene).numpy(), picture(replace(model, **{index: rows}, **given)))


@AND_SHIFTS
def test_a_primitive_may_have_them_and_any_sh_degree(kind: Kind):
    """A group along their own axes is no group of an SH degree."""
    model, index = kind.model, f"splats.{kind.group.index}"
    scene, params = traversed(model)
    params["splats.sh_coeffs"] = mi.TensorXf(kind.random(degree=2).sh_coeffs)
    params[index] = params[index]
    params.update()
    assert scene.shapes()[0].sh_size == 9

    mixed = model.with_sh_degrees(np.arange(12) // 2 % 2)
    assert np.isin(kind.index(mixed), mixed.sh1_index).any()
    scene, params = traversed(mixed)
    params["splats.sh1_coeffs"] = params["splats.sh1_coeffs"] * 1
    params.set_dirty(index)
    params.update()
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(mixed.uniform_sh()), rtol=1e-5, atol=1e-5)


@AND_SHIFTS
def test_shapes_with_and_without_are_drawn_as_one_model(kind: Kind):
    parts = [kind.without(kind.random(9, seed=3)), kind.model, kind.random(8, seed=5)]
    scene = scene_of(parts[0], CAMERA, extra={f"tail_{k}": dog_dict(part) for k, part in enumerate(parts[1:])})
    names = *RAW, *RAW_DOG, *kind.group.names
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    for name in ("dog_index", kind.group.index):
        joined[name] = np.concatenate([getattr(p, name) + first for p, first in zip(parts, (0, 9, 21), strict=True)])
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(Splats(**joined)), atol=1e-5)


@AND_SHIFTS
@pytest.mark.parametrize("mirror", [False, True], ids=["turned", "mirrored"])
def test_a_moved_shape_takes_them_along(kind: Kind, mirror):
    turn = axis_rotation([1, 2, -1], 0.4)[0] @ np.diag([1, -1 if mirror else 1, 1])
    matrix: Any = affine(1.2 * turn, (0.1, 0.2, 0.5))
    model, names = kind.model, kind.group.names
    expected = transformed(model, matrix)
    scene, params = traversed(model)
    params["splats.to_world"] = mi.Transform4f(matrix)
    params.update()
    images = mi.render(scene).numpy(), picture(model, shape={"to_world": scalar_transform(matrix)}), picture(expected)
    tolerance = 2e-4
    assert np.abs(images[2] - picture(kind.without(expected))).max() > 100 * tolerance
    for image in images[:2]:
        np.testing.assert_allclose(image, images[2], atol=tolerance)
    found, gradients = scene.shapes()[0].to_splats(), []
    for of_scene, of_params in ((scene, params), traversed(expected)):
        dr.enable_grad([of_params[f"splats.{name}"] for name in names])
        of_params.update()
        dr.backward(dr.sum(mi.render(of_scene, of_params) * mi.TensorXf(ADJOINT.astype(np.float32))))
        gradients.append([dr.grad(of_params[f"splats.{name}"]).numpy() for name in names])
    assert np.abs(gradients[1][0]).max() > 0.05
    for name, of_moved, at_rest in zip(names, *gradients, strict=True):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-6)
        sign = -1 if mirror and name in (*ALONG_AXES, "mean_views") else 1
        np.testing.assert_allclose(of_moved, sign * at_rest, atol=1e-3)


@AND_SHIFTS
@pytest.mark.parametrize("mirror", [False, True], ids=["turned", "mirrored"])
def test_derivatives_by_to_world_are_those_of_differences(monkeypatch, kind: Kind, mirror):
    """Without cutoffs: no alpha appears at once where the shape moves."""
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))
    scene, params = traversed(kind.model)
    adjoint, step = mi.TensorXf(ADJOINT.astype(np.float32)), 2e-3

    def loss(θ: mi.Float) -> Any:
        T4: Any = mi.Transform4f()
        flip = T4.scale(mi.Point3f(-1 if mirror else 1, 1, 1))
        params["splats.to_world"] = T4.scale(mi.Point3f(1.1 + θ)) @ T4.rotate(mi.Vector3f(0.6, 0, 0.8), 50 * θ) @ flip
        params.update()
        return dr.sum(mi.render(scene, params) * adjoint)

    θ = mi.Float(0)
    dr.enable_grad(θ)
    dr.backward(loss(θ))
    sides = [float(loss(mi.Float(sign * step)).array[0]) for sign in (1, -1)]
    expected = (sides[0] - sides[1]) / (2 * step)
    assert abs(expected) > 1
    assert dr.grad(θ)[0] == pytest.approx(expected, rel=0.01)


@AND_SHIFTS
def test_ellipsoids_are_without_them_and_that_is_said(capfd, kind: Kind):
    model = kind.model.plain()
    instead = whole(model) if kind in PLANE_KINDS else kind.without(model)
    got, expected = to_ellipsoids(model), to_ellipsoids(instead)
    word = "cuts" if kind in PLANE_KINDS else kind.word
    assert f"left out the {word} of {len(kind.index(model))} primitives" in "".join(capfd.readouterr())
    for name in ("centers", "scales", "quaternions", "opacities", "sh_coeffs"):
        np.testing.assert_array_equal(got[name].numpy(), expected[name].numpy())


def test_ellipsoids_say_once_of_a_primitive_that_both_planes_cut_it_off(capfd):
    model = SECOND_CUT.having(CUT.having(random_splats(12), every=2), every=3)
    assert (model.n_cuts, model.n_second_cuts) == (6, 4)
    to_ellipsoids(model)
    assert "the cuts of 8 primitives" in "".join(capfd.readouterr())


@AND_SHIFTS
def test_primitives_with_values_that_are_not_finite_are_no_ellipsoids(kind: Kind):
    model, index = kind.model, kind.index(kind.model)
    broken = replace(model, **{"log_scales": model.log_scales.copy(), kind.name: kind.values(model).copy()})
    kind.values(broken)[0, 1] = np.nan
    broken.log_scales[index[1], 2] = np.inf
    rest = model.select(np.delete(np.arange(12), index[:2]))
    for name, values in to_ellipsoids(rest).items():
        if name in ("centers", "scales"):
            np.testing.assert_array_equal(to_ellipsoids(broken)[name].numpy(), values.numpy())


@AND_SHIFTS
@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"index": lambda index: np.arange(3)}, r'"NAME" has shape \(\d, [36](, 3)?\), expected \(3, [36](, 3)?\) to'),
        ({"index": lambda index: index[::-1]}, '"INDEX" is not strictly increasing'),
        ({"index": lambda index: index + 6}, '"INDEX" names primitive'),
        ({"values": lambda values: values[:, :2]}, r'"NAME" has shape \(\d, 2(, 3)?\)'),
    ],
)
def test_updates_that_do_not_fit_are_refused(kind: Kind, changes, problem):
    params: Any = mi.traverse(mi.load_dict(dog_dict(kind.model)))
    for part, change in changes.items():
        if part == "index":
            params[kind.group.index] = mi.UInt32(change(kind.index(kind.model)).astype(np.uint32))
        else:
            params[kind.name] = mi.TensorXf(change(kind.values(kind.model)))
    with pytest.raises(RuntimeError, match=problem.replace("NAME", kind.name).replace("INDEX", kind.group.index)):
        params.update()


@AND_SHIFTS
def test_tensors_that_are_missing_or_do_not_fit_are_refused_at_load(kind: Kind):
    given, index = dog_dict(kind.model), kind.group.index
    for name in kind.group.names:
        short = given | {name: mi.TensorXf(getattr(kind.model, name)[:1])}
        missing = {other: values for other, values in given.items() if other != name}
        for wrong, rows in ((short, "1 row"), (missing, "0 rows")):
            with pytest.raises(RuntimeError, match=f'"{name}" has {rows}, "{index}" has {len(kind.index(kind.model))}'):
                mi.load_dict(wrong)


def test_an_update_of_the_second_array_of_shifts_that_does_not_fit_is_refused():
    params: Any = mi.traverse(mi.load_dict(dog_dict(SHIFTED.model)))
    params["mean_views"] = mi.TensorXf(np.zeros((5, 3), np.float32))
    with pytest.raises(RuntimeError, match=r'"mean_views" has shape \(5, 3\), expected \(6, 3\) to match'):
        params.update()
