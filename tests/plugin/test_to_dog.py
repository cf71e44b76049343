"""A model in memory as a shape: the same scene as that of its file."""

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from film_derivatives import film_gradients
from mi_dogsplat import Drawing, Model, Splats, read_model, to_dog, write_model, write_ply
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.support.errors import DataError
from splat_scenes import axis_rotation, random_splats, rounded, scalar_transform, sensor_dict, square_camera

CAMERA = square_camera(24, 16, f=20.0)
WHOLE = rounded(random_splats(24, seed=3, slope_share=0.5, cut_share=0.6, second_cut_share=0.5, curvature_share=0.5))
EVERYTHING = Model(
    replace(WHOLE, log_scales=WHOLE.log_scales - 0.7).with_sh_degrees(np.arange(24) % 4),
    Drawing(antialiased=True, near_clip=3.0, linear=True, up="z", scale=0.3, white=2.5),
)
PLAIN = rounded(random_splats(9, seed=4, degree=1, dog_share=0))
MODELS = pytest.mark.parametrize("model", [EVERYTHING, Model(PLAIN)], ids=["everything", "plain"])
STRETCH: Any = affine(axis_rotation([1, 2, -1], 0.4)[0] @ np.diag([1.1, -0.9, 1.3]), (0.1, -0.2, 0.5))
TO_WORLD = pytest.mark.parametrize("to_world", [None, STRETCH], ids=["in place", "moved"])


def scene_of_shapes(*shapes: dict, **integrator) -> Any:
    names = {f"splats{k or ''}": shape for k, shape in enumerate(shapes)}
    integrator = {"type": "dogsplat", **integrator}
    return mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor_dict(CAMERA), **names})


def picture(*shapes: dict, **integrator) -> np.ndarray:
    return mi.render(scene_of_shapes(*shapes, **integrator)).numpy()


def of_file(path: Any, model: Model, to_world: Any = None) -> dict:
    """The shape as it was loaded before there was another way."""
    write_model(path, model, sh_rows=True)
    moved = {} if to_world is None else {"to_world": scalar_transform(to_world)}
    return {"type": "dog", "filename": str(path), **moved}


@MODELS
@TO_WORLD
@pytest.mark.parametrize("integrator", ["dogsplat", "dogpath"])
def test_the_picture_is_that_of_the_file_to_the_bit(tmp_path, model, to_world, integrator):
    others = {"type": integrator, "aovs": "depth,normal,count,dog_share"}
    expected = picture(of_file(tmp_path / "a.ply", model, to_world), **others)
    assert np.abs(expected[..., :3]).max() > 0.1
    for given in (model, tmp_path / "a.ply", str(tmp_path / "a.ply")):
        np.testing.assert_array_equal(picture(to_dog(given, to_world=to_world), **others), expected)


@MODELS
@TO_WORLD
def test_gradients_are_those_of_the_file(tmp_path, model, to_world):
    adjoint = np.random.default_rng(0).normal(size=(16, 24, 3))
    scenes = [scene_of_shapes(of_file(tmp_path / "a.ply", model, to_world)),
              scene_of_shapes(to_dog(model, to_world=to_world))]  # fmt: skip
    names = [name for name in vars(model.splats) if not name.endswith("_index") and len(getattr(model.splats, name))]
    expected, got = (film_gradients(scene, names, adjoint) for scene in scenes)
    for name in names:
        assert np.abs(expected[name]).max() > 1e-4, name
        np.testing.assert_allclose(got[name], expected[name], rtol=1e-4, atol=1e-5, err_msg=name)


@pytest.mark.parametrize(
    ("name", "other"), [("antialiased", False), ("near_clip", 0.2), ("linear", False), ("white", 1.0)]
)
def test_what_a_model_says_on_its_drawing_the_shape_says(name, other):
    drawing = EVERYTHING.drawing
    shape: Any = mi.load_dict(to_dog(EVERYTHING))
    assert getattr(shape.drawing, name) == getattr(drawing, name)
    assert shape.drawing == replace(drawing, up=None, scale=None)
    changed = {**to_dog(EVERYTHING), name: other}
    assert getattr(scene_of_shapes(changed).shapes()[0].drawing, name) == other
    if name != "white":  # of which pictures in files know
        assert not np.array_equal(picture(changed), picture(to_dog(EVERYTHING)))


def test_primitives_alone_say_nothing(tmp_path):
    splats = EVERYTHING.splats
    assert set(to_dog(PLAIN)) == {"type", "means", "log_scales", "quats", "logit_opacities", "sh_coeffs"}
    expected = picture(of_file(tmp_path / "a.ply", Model(splats)))
    np.testing.assert_array_equal(picture(to_dog(splats)), expected)
    assert not np.array_equal(expected, picture(to_dog(EVERYTHING)))


def test_what_the_shape_is_told_comes_before_its_file_and_after_the_integrator(tmp_path):
    shape = of_file(tmp_path / "a.ply", Model(PLAIN, Drawing(linear=True, near_clip=2.5)))
    told = {**shape, "linear": False, "near_clip": 0.5}
    np.testing.assert_array_equal(picture(told), picture(to_dog(Model(PLAIN, Drawing(near_clip=0.5)))))
    np.testing.assert_array_equal(picture(told, srgb_primitives=False, near_clip=2.5), picture(shape))
    (tmp_path / "scene.xml").write_text(
        f'<scene version="3.0.0"><shape type="dog"><string name="filename" value="{tmp_path}/a.ply"/>'
        '<boolean name="antialiased" value="true"/><float name="near_clip" value="1"/></shape></scene>')  # fmt: skip
    loaded: Any = mi.load_file(str(tmp_path / "scene.xml"))
    assert loaded.shapes()[0].drawing == Drawing(antialiased=True, near_clip=1, linear=True)


def test_the_near_clip_is_in_units_of_the_model():
    double = mi.ScalarTransform4f().scale(2)
    shape: Any = mi.load_dict(to_dog(Model(PLAIN, Drawing(near_clip=1.25)), to_world=double))
    assert shape.drawing.near_clip == pytest.approx(2.5)


def test_shapes_of_tensors_that_disagree_are_told_by_their_names():
    shapes = [to_dog(Model(PLAIN, Drawing(antialiased=on))) for on in (True, False)]
    with pytest.raises(RuntimeError, match='shape "splats" of tensors is to be .* True, shape "splats1" of tensors'):
        loaded = scene_of_shapes(*shapes)
        loaded.integrator().drawn_as(loaded)


def test_a_loaded_shape_becomes_a_dict_as_it_is_now():
    shape: Any = mi.load_dict(to_dog(EVERYTHING))
    params: Any = mi.traverse(shape)
    params["means"] = params["means"] + 0.25
    params.update()
    again: Any = mi.load_dict(to_dog(shape))
    np.testing.assert_allclose(again.to_splats().means, EVERYTHING.splats.means + 0.25)
    assert again.drawing == shape.drawing and set(mi.traverse(again).keys()) == set(params.keys())


def test_a_model_that_is_changed_later_does_not_change_the_dict():
    splats = EVERYTHING.splats.select(np.arange(24))
    given = to_dog(splats)
    for values in vars(splats).values():
        values[...] = 0
    for name, values in vars(mi.load_dict(given).to_splats()).items():  # pyright: ignore[reportAttributeAccessIssue]
        np.testing.assert_array_equal(values, getattr(EVERYTHING.splats, name), err_msg=name)


def test_a_joined_model_is_drawn_as_its_parts_are_beside_each_other(tmp_path):
    parts = [EVERYTHING.splats, PLAIN, Splats.empty(0), rounded(random_splats(8, seed=5, degree=2, cut_share=0.5))]
    expected = picture(*(of_file(tmp_path / f"{k}.ply", Model(part)) for k, part in enumerate(parts)))
    np.testing.assert_allclose(picture(to_dog(parts[0].joined(*parts[1:]))), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("to_world", "problem"),
    [
        (np.eye(3), r"one matrix \[4, 4\]; this transform is of shape \[3, 3\]"),
        (np.zeros((4, 4, 2)), "this transform is 2 lanes wide"),
        (np.zeros((2, 4, 4)), r"of shape \[2, 4, 4\]"),
    ],
)
def test_what_is_no_matrix_or_no_model_is_refused(tmp_path, to_world, problem):
    with pytest.raises(ValueError, match=problem):
        to_dog(PLAIN, to_world=to_world)
    with pytest.raises(ValueError, match='to_dog: a model is Splats, Model, a path or a shape "dog", this is dict'):
        to_dog({})  # pyright: ignore[reportArgumentType]
    with pytest.raises(DataError, match=r"no\.ply"):
        to_dog(tmp_path / "no.ply")


@pytest.mark.parametrize("kind", ["array", "plain numbers", "arrays"])
def test_to_world_may_be_of_any_kind(kind):
    kinds = {"array": STRETCH, "plain numbers": scalar_transform(STRETCH), "arrays": mi.Transform4f(STRETCH)}
    shape: Any = mi.load_dict(to_dog(PLAIN, to_world=kinds[kind]))
    np.testing.assert_allclose(shape.to_splats().means, PLAIN.means @ STRETCH[:3, :3].T + STRETCH[:3, 3], atol=1e-5)


def test_a_model_read_from_a_file_is_one(tmp_path):
    write_model(tmp_path / "a.glb", Model(PLAIN, Drawing(antialiased=True)))
    shape: Any = mi.load_dict(to_dog(read_model(tmp_path / "a.glb")))
    assert shape.drawing.antialiased and shape.to_splats().n_splats == 9


def test_what_is_no_model_is_not_written_and_a_shape_is_told_how_it_becomes_one(tmp_path):
    shape: Any = mi.load_dict(to_dog(EVERYTHING))
    path = tmp_path / "a.ply"
    others: list[Any] = [shape, Model]
    for model in others:
        with pytest.raises(ValueError, match=r"not \w+; that of a .* Model\(shape.to_splats\(\), shape.drawing\)"):
            write_model(path, model)
    swapped: Any = EVERYTHING
    with pytest.raises(ValueError, match="the path comes first, then the model; Model is not a path"):
        write_model(swapped, path)
    with pytest.raises(ValueError, match="not Model; write_model writes a Model"):
        write_ply(path, swapped)
    assert not list(tmp_path.iterdir())
