"""The shape and the integrators with what primitives have along their own axes: slopes of a colour, and cuts."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from film_derivatives import errors_of_adam, film_gradients
from mi_dogsplat import Splats, reference, to_ellipsoids, write_ply
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, ROWS, upload
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.plugin import splat_integrator
from mi_dogsplat.plugin.camera_masks import SplatMasks
from mi_dogsplat.scene.row_groups import CUTS, SLOPES, RowGroup
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.scene.whole import whole
from splat_scenes import (
    assert_gradients_equal,
    axis_rotation,
    dog_dict,
    image_of,
    options,
    random_splats,
    rasterized,
    rounded,
    scalar_transform,
    scene_of,
    square_camera,
    to_linear,
)

CAMERA = square_camera(16, 12, f=14.0)
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3))


@dataclass(frozen=True)
class Kind:
    """A model of which some primitives are in a group, and what that changes."""

    group: RowGroup
    word: str
    share: str  # argument of ``random_splats``
    seed: int  # of a model that looks otherwise without them

    @property
    def name(self) -> str:
        return self.group.names[0]

    def random(self, n=12, seed=None, degree=1) -> Splats:
        shares: dict[str, Any] = {self.share: 0.5}
        return rounded(random_splats(n, self.seed if seed is None else seed, degree, **shares))

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


SLOPED, CUT = Kind(SLOPES, "slopes", "slope_share", seed=1), Kind(CUTS, "cuts", "cut_share", seed=8)


@pytest.fixture(params=[SLOPED, CUT], ids=["slopes", "cuts"])
def kind(request) -> Kind:
    return request.param


def picture(splats: Splats, **others) -> np.ndarray:
    return mi.render(scene_of(splats, CAMERA, **others)).numpy()


def traversed(splats: Splats, **others) -> tuple[Any, Any]:
    scene: Any = scene_of(splats, CAMERA, **others)
    return scene, mi.traverse(scene)


@pytest.mark.parametrize("source", ["tensors", "file"])
def test_they_go_in_are_seen_and_come_out(tmp_path, kind, source):
    model, index, name = kind.model, kind.group.index, kind.name
    write_ply(tmp_path / "model.ply", model)
    file = {"type": "dog", "filename": str(tmp_path / "model.ply")}
    shape: Any = mi.load_dict(file if source == "file" else dog_dict(model))
    params: Any = mi.traverse(shape)
    assert set(params.keys()) == {*RAW, *RAW_DOG, "dog_index", name, index, "to_world"}
    assert params[name].shape == kind.values(model).shape
    assert params.flags(name) == mi.ParamFlags.Differentiable
    assert params.flags(index) == mi.ParamFlags.NonDifferentiable
    for key in (index, name):
        np.testing.assert_array_equal(getattr(shape.to_splats(), key), getattr(model, key))
    assert f"{kind.word} = {len(kind.index(model))}" in str(shape)
    assert kind.word not in str(mi.load_dict(dog_dict(kind.without)))
    given = upload(model)
    assert set(shape.parameters) == set(given)
    np.testing.assert_array_equal(shape.parameters[ROWS[index]].numpy(), given[ROWS[index]].numpy())


def test_pictures_are_those_of_the_engine(kind):
    assert np.isin(kind.model.dog_index, kind.index(kind.model)).any()
    ours = picture(kind.model, srgb_primitives=False)
    np.testing.assert_allclose(ours, image_of(rasterized(kind.model, CAMERA), CAMERA), atol=1e-5)
    assert np.abs(ours - picture(kind.without, srgb_primitives=False)).max() > 0.05


def test_dogpath_shows_them_to_the_camera_as_dogsplat_does(kind):
    np.testing.assert_array_equal(picture(kind.model, type="dogpath"), picture(kind.model))


def test_gradients_through_the_film_equal_differences(monkeypatch, kind):
    """Without cutoffs: no alpha appears at once where a parameter moves."""
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))
    names = {kind.name: 1e-2, "sh_coeffs": 1e-2, "means": 1e-3, "log_scales": 1e-3, "quats": 1e-3}
    model = kind.model
    gradients = film_gradients(scene_of(model, CAMERA), names, ADJOINT)
    rng = np.random.default_rng(1)
    along = {name: rng.choice([-1.0, 1.0], gradient.shape) for name, gradient in gradients.items()}

    def loss(name: str, distance: float) -> float:
        changed = Splats(**vars(model))
        setattr(changed, name, (getattr(model, name) + distance * along[name]).astype(np.float32))
        return float((picture(changed).astype(float) * ADJOINT).sum())

    for name, step in names.items():
        expected = (loss(name, step) - loss(name, -step)) / (2 * step)
        scale = float(np.abs(gradients[name]).max())
        assert scale > 0.01
        assert (gradients[name] * along[name]).sum() == pytest.approx(expected, abs=0.01 * scale, rel=0.01), name

    scene, params = traversed(model)
    for name in names:
        dr.enable_grad(params[f"splats.{name}"])
        dr.set_grad(params[f"splats.{name}"], mi.TensorXf(along[name].astype(np.float32)))
    params.update()
    change = scene.integrator().render_forward(scene, params).numpy()
    expected = sum((gradients[name] * along[name]).sum() for name in names)
    assert (change * ADJOINT).sum() == pytest.approx(expected, rel=2e-3)


def test_gradients_with_cutoffs_equal_differences_in_float64(kind):
    splats, adjoint = kind.random(10, seed=4), ADJOINT.astype(np.float32)
    got = film_gradients(scene_of(splats, CAMERA), (*RAW, *RAW_DOG, kind.name), ADJOINT)
    image, step = reference.render(splats, CAMERA)[0], 1e-6
    curve = (to_linear(image + step) - to_linear(image - step)) / (2 * step)
    assert_gradients_equal(got, reference.loss_gradients(splats, CAMERA, adjoint * curve, smooth=False, eps=1e-7))


def test_adam_finds_them(kind):
    target = mi.render(scene_of(kind.model, CAMERA))
    start = replace(kind.model, **{kind.name: 0.8 * kind.values(kind.model)})
    errors = errors_of_adam(scene_of(start, CAMERA), [kind.name], target)
    assert errors[-1] < 0.1 * errors[0]


def test_updates_change_values_and_rows_and_may_leave_none(kind):
    model, values, index = kind.model, f"splats.{kind.name}", f"splats.{kind.group.index}"
    scene, params = traversed(model)
    params[values] = params[values] * 2
    params.update()
    doubled = replace(model, **{kind.name: 2 * kind.values(model)})
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(doubled), atol=1e-6)

    two = kind.values(model)[:2]
    params[index] = mi.UInt32([2, 9])
    params[values] = mi.TensorXf(two)
    params.update()
    others = replace(model, **{kind.group.index: [2, 9], kind.name: two})
    np.testing.assert_array_equal(mi.render(scene).numpy(), picture(others))

    params[index] = dr.zeros(mi.UInt32, 0)
    params[values] = mi.TensorXf(two[:0])
    params.update()
    np.testing.assert_array_equal(mi.render(scene).numpy(), picture(kind.without))


def test_a_primitive_may_have_them_and_any_sh_degree(kind):
    """A group of slopes or cuts is no group of an SH degree."""
    model, index = kind.model, f"splats.{kind.group.index}"
    scene, params = traversed(model)
    params["splats.sh_coeffs"] = mi.TensorXf(kind.random(degree=2).sh_coeffs)
    params[index] = params[index]
    params.update()
    assert scene.shapes()[0].sh_size == 9

    mixed = model.with_sh_degrees(np.arange(12) % 2)
    assert np.isin(kind.index(mixed), mixed.sh1_index).any()
    scene, params = traversed(mixed)
    params["splats.sh1_coeffs"] = params["splats.sh1_coeffs"] * 1
    params.set_dirty(index)
    params.update()
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(mixed.uniform_sh()), rtol=1e-5, atol=1e-5)


def test_shapes_with_and_without_are_drawn_as_one_model(kind):
    parts = [kind.bare(kind.random(9, seed=3)), kind.model, kind.random(8, seed=5)]
    scene = scene_of(parts[0], CAMERA, extra={f"more_{k}": dog_dict(part) for k, part in enumerate(parts[1:])})
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in (*RAW, *RAW_DOG, kind.name)}
    for name in ("dog_index", kind.group.index):
        joined[name] = np.concatenate([getattr(p, name) + first for p, first in zip(parts, (0, 9, 21), strict=True)])
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(Splats(**joined)), atol=1e-5)


@pytest.mark.parametrize("mirror", [False, True], ids=["turned", "mirrored"])
def test_a_moved_shape_takes_them_along(kind, mirror):
    matrix: Any = np.eye(4)
    matrix[:3, :3] = axis_rotation([1, 2, -1], 0.4)[0] @ np.diag([1, -1 if mirror else 1, 1]) * 1.2
    matrix[:3, 3] = 0.1, 0.2, 0.5
    model, name = kind.model, f"splats.{kind.name}"
    expected = transformed(model, matrix)
    scene, params = traversed(model)
    params["splats.to_world"] = mi.Transform4f(matrix)
    params.update()
    images = mi.render(scene).numpy(), picture(model, shape={"to_world": scalar_transform(matrix)}), picture(expected)
    assert np.abs(images[2] - picture(kind.bare(expected))).max() > 0.05
    for image in images[:2]:
        np.testing.assert_allclose(image, images[2], atol=2e-4)
    np.testing.assert_allclose(kind.values(scene.shapes()[0].to_splats()), kind.values(expected), atol=1e-6)
    dr.enable_grad(params[name])
    params.update()
    image = mi.render(scene, params)
    dr.backward(dr.sum(image * mi.TensorXf(ADJOINT.astype(np.float32))))
    at_rest, of_moved = traversed(expected)
    dr.enable_grad(of_moved[name])
    of_moved.update()
    dr.backward(dr.sum(mi.render(at_rest, of_moved) * mi.TensorXf(ADJOINT.astype(np.float32))))
    gradient = dr.grad(of_moved[name]).numpy() * (-1 if mirror else 1)
    np.testing.assert_allclose(dr.grad(params[name]).numpy(), gradient, atol=1e-3)


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
def test_holdouts_are_black_and_cover_as_much_as_without_slopes(linear):
    model = SLOPED.model
    params, camera, seen = upload(model), DeviceCamera.upload(CAMERA), options(model)
    holdout = np.arange(12) % 3 == 0
    masks = SplatMasks(mi.Bool(np.zeros(12, bool)), mi.Bool(holdout), True)
    shown = masks.shown(params, linear)
    slopes = shown["color_slopes"].numpy().reshape(-1, 9)
    of_holdouts = holdout[model.slope_index]
    assert of_holdouts.any() and not slopes[of_holdouts].any()
    np.testing.assert_array_equal(slopes[~of_holdouts], model.color_slopes.reshape(-1, 9)[~of_holdouts])
    without = masks.shown(upload(model.without_slopes()), linear)
    np.testing.assert_array_equal(masks.hole(shown, camera, seen, None), masks.hole(without, camera, seen, None))


def test_holdouts_that_are_cut_off_cover_what_is_left_of_them():
    model, camera = CUT.model, DeviceCamera.upload(CAMERA)
    everything = mi.Bool(np.ones(12, bool))
    masks = SplatMasks(mi.Bool(np.zeros(12, bool)), everything, True)
    hole, of_whole = (masks.hole(masks.shown(upload(splats), True), camera, options(splats), None).numpy()
                      for splats in (model, CUT.without))
    np.testing.assert_allclose(hole, 1 - rasterized(model, CAMERA).T.numpy(), atol=1e-5)
    assert np.abs(hole - of_whole).max() > 0.05


def test_ellipsoids_are_without_them_and_that_is_said(capfd, kind):
    model = kind.model.plain()
    instead = whole(model) if kind is CUT else kind.bare(model)
    got, expected = to_ellipsoids(model), to_ellipsoids(instead)
    assert f"left out the {kind.word} of {len(kind.index(model))} primitives" in "".join(capfd.readouterr())
    for name in ("centers", "scales", "opacities", "sh_coeffs"):
        np.testing.assert_array_equal(got[name].numpy(), expected[name].numpy())


def test_cut_primitives_with_values_that_are_not_finite_are_no_ellipsoids():
    broken = replace(CUT.model, log_scales=CUT.model.log_scales.copy(), cut_normals=CUT.model.cut_normals.copy())
    broken.cut_normals[0, 1] = np.nan
    broken.log_scales[broken.cut_index[1], 2] = np.inf
    rest = CUT.model.select(np.delete(np.arange(12), broken.cut_index[:2]))
    for name, values in to_ellipsoids(rest).items():
        if name in ("centers", "scales"):
            np.testing.assert_array_equal(to_ellipsoids(broken)[name].numpy(), values.numpy())


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"index": lambda index: np.arange(3)}, r'"NAME" has shape \(\d, 3(, 3)?\), expected \(3, 3(, 3)?\) to match'),
        ({"index": lambda index: index[::-1]}, '"INDEX" is not strictly increasing'),
        ({"index": lambda index: index + 6}, '"INDEX" names primitive'),
        ({"values": lambda values: values[:, :2]}, r'"NAME" has shape \(\d, 2(, 3)?\)'),
    ],
)
def test_updates_that_do_not_fit_are_refused(kind, changes, problem):
    params: Any = mi.traverse(mi.load_dict(dog_dict(kind.model)))
    for part, change in changes.items():
        if part == "index":
            params[kind.group.index] = mi.UInt32(change(kind.index(kind.model)).astype(np.uint32))
        else:
            params[kind.name] = mi.TensorXf(change(kind.values(kind.model)))
    with pytest.raises(RuntimeError, match=problem.replace("NAME", kind.name).replace("INDEX", kind.group.index)):
        params.update()


def test_tensors_that_do_not_fit_are_refused_at_load(kind):
    short = {**dog_dict(kind.model), kind.name: mi.TensorXf(kind.values(kind.model)[:1])}
    problem = f'"{kind.name}" has 1 rows, "{kind.group.index}" has {len(kind.index(kind.model))}'
    with pytest.raises(RuntimeError, match=problem):
        mi.load_dict(short)
