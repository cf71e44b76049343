"""The shape plugin: what it loads, what it shows to ``mi.traverse``, and how it refuses."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Splats, read_ply, reference, write_ply
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, upload
from mi_dogsplat.engine.rows import NO_ROW
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.transform import transformed
from splat_scenes import (
    axis_rotation,
    dog_dict,
    make_splats,
    random_splats,
    rounded,
    scalar_transform,
    scene_of,
    square_camera,
)

MODEL = rounded(random_splats(12, seed=1, degree=2))
PLAIN = rounded(random_splats(7, seed=2, degree=1, dog_share=0))
REPOSITORY = Path(__file__).parents[2]


def load(splats: Splats = MODEL, **others) -> Any:
    return mi.load_dict(dog_dict(splats, **others))


def assert_equal(ours: Splats, theirs: Splats, **tolerance):
    for name in (*RAW, *RAW_DOG, "dog_index"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), err_msg=name, **tolerance)


def python(code: str) -> str:
    """Output of a fresh process; raises with its error output."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=REPOSITORY, capture_output=True,
                          text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


# Loading

@pytest.mark.parametrize("model", [MODEL, PLAIN], ids=["dog", "plain"])
def test_a_file_gives_the_same_model_from_a_dict_and_from_xml(tmp_path, model):
    write_ply(tmp_path / "model.ply", model)
    from_dict: Any = mi.load_dict({"type": "dog", "filename": str(tmp_path / "model.ply")})
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><shape type="dog"><string name="filename" value="model.ply"/></shape></scene>')
    scene: Any = mi.load_file(str(tmp_path / "scene.xml"))
    expected = read_ply(tmp_path / "model.ply")
    for shape in (from_dict, scene.shapes()[0]):
        assert_equal(shape.to_splats(), expected)


def test_two_shapes_of_equal_parameters_are_both_drawn(tmp_path):
    """Mitsuba's loader makes one object of them, and would merge meshes of one object."""
    write_ply(tmp_path / "model.ply", PLAIN)
    shape = {"type": "dog", "filename": str(tmp_path / "model.ply")}
    both, joined = (
        scene_of(PLAIN, square_camera(16, 12, f=14.0), extra=shapes)
        for shapes in ({"splats": shape, "again": shape}, {"splats": dog_dict(PLAIN.joined(PLAIN))})
    )
    assert len(both.shapes()) == 2
    np.testing.assert_allclose(np.array(mi.render(both)), np.array(mi.render(joined)), atol=1e-6)
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><shape type="dog" id="a"><string name="filename" value="model.ply"/></shape>'
        '<ref id="a"/></scene>')
    scene: Any = mi.load_file(str(tmp_path / "scene.xml"))
    assert [shape.to_splats().n_splats for shape in scene.shapes()] == [7, 7]


def test_tensors_give_the_model():
    assert_equal(load().to_splats(), MODEL)
    assert_equal(load(PLAIN).to_splats(), PLAIN)


def test_to_world_moves_the_model_once_at_load():
    matrix = affine(2 * axis_rotation([1, 2, 3], 0.9)[0], (1, -2, 3))
    moved = load(to_world=scalar_transform(matrix)).to_splats()
    expected = transformed(MODEL, matrix)
    np.testing.assert_allclose(reference.rotations(moved.quats), reference.rotations(expected.quats), atol=1e-5)
    moved.quats = expected.quats  # of either sign
    assert_equal(moved, expected, atol=1e-5)


def test_a_change_without_names_is_one_of_everything():
    shape, named = load(), load()
    for one in (shape, named):
        one.to_world = mi.Transform4f().translate([1, 2, 3])
    shape.parameters_changed()
    named.parameters_changed(["to_world"])
    assert_equal(shape.to_splats(), named.to_splats())
    assert abs(shape.to_splats().means - MODEL.means).max() > 2


def test_to_world_may_be_a_transform_of_mitsubas_arrays():
    turned, plain = (kind().rotate([0.6, 0, 0.8], 40).scale(2) for kind in (mi.Transform4f, mi.ScalarTransform4f))
    assert_equal(load(to_world=turned).to_splats(), load(to_world=plain).to_splats(), atol=1e-5)


def test_a_model_without_primitives_loads(tmp_path):
    write_ply(tmp_path / "empty.ply", Splats.empty(3))
    shape: Any = mi.load_dict({"type": "dog", "filename": str(tmp_path / "empty.ply")})
    assert shape.to_splats().n_splats == 0
    assert not shape.bbox().valid()


def test_the_bounding_box_holds_the_centres_and_the_text_the_counts():
    box = load().bbox()
    np.testing.assert_allclose(np.array(box.min), MODEL.means.min(0))
    np.testing.assert_allclose(np.array(box.max), MODEL.means.max(0))
    scene: Any = mi.load_dict({"type": "scene", "shape": load(), "ball": {"type": "sphere"}})
    assert scene.bbox() == mi.load_dict({"type": "sphere"}).bbox()  # as docs/mitsuba.md says
    assert "primitives = 12" in str(load()) and f"dog = {MODEL.n_dog}" in str(load())


# Parameters

def test_traverse_shows_the_raw_parameters_under_their_fixed_names():
    params: Any = mi.traverse(load())
    assert set(params.keys()) == {*RAW, *RAW_DOG, "dog_index", "to_world"}
    assert set(mi.traverse(load(PLAIN)).keys()) == {*RAW, "to_world"}
    for name in (*RAW, *RAW_DOG):
        assert isinstance(params[name], mi.TensorXf)
        assert tuple(params[name].shape) == getattr(MODEL, name).shape
        assert params.flags(name) == mi.ParamFlags.Differentiable, name
    assert params.flags("dog_index") == mi.ParamFlags.NonDifferentiable


def test_the_number_of_primitives_may_change_through_update():
    shape = load()
    params: Any = mi.traverse(shape)
    other = rounded(random_splats(30, seed=4, degree=3, dog_share=0.3))
    for name in RAW + RAW_DOG:
        params[name] = mi.TensorXf(getattr(other, name))
    params["dog_index"] = mi.UInt32(other.dog_index)
    params.update()
    assert_equal(shape.to_splats(), other)
    assert shape.sh_size == 16


def test_an_index_is_read_again_only_if_it_is_another_or_the_number_of_primitives_is():
    shape: Any = load()
    params: Any = mi.traverse(shape)
    rows = shape.parameters["dog_row"]
    for name in RAW + RAW_DOG:
        params[name] = 1.5 * params[name]
    params.update()
    assert shape.parameters["dog_row"].index == rows.index

    more = np.concatenate([np.arange(MODEL.n_splats), [0, 1]])
    for name in RAW:
        params[name] = mi.TensorXf(getattr(MODEL, name)[more])
    params.update()
    expected = np.concatenate([rows.numpy(), np.full(2, NO_ROW)])
    np.testing.assert_array_equal(shape.parameters["dog_row"].numpy(), expected)

    for name in RAW:
        params[name] = mi.TensorXf(getattr(MODEL, name)[: MODEL.dog_index.max()])
    with pytest.raises(RuntimeError, match=f"names primitive {MODEL.dog_index.max()}"):
        params.update()


@pytest.mark.parametrize("name", RAW + RAW_DOG)
def test_an_update_that_leaves_rows_unmatched_is_an_error_that_names_the_tensor(name):
    params: Any = mi.traverse(load())
    params[name] = mi.TensorXf(getattr(MODEL, name)[:-1])
    other = "log_scales" if name == "means" else name
    with pytest.raises(RuntimeError, match=f'dog: "{other}" has shape'):
        params.update()


@pytest.mark.parametrize("means", [MODEL.means.ravel(), MODEL.means.T, MODEL.means[0, 0]])
def test_means_of_another_layout_are_an_error_that_says_the_right_one(means):
    params: Any = mi.traverse(load())
    params["means"] = mi.TensorXf(np.ascontiguousarray(means))
    with pytest.raises(RuntimeError, match=r'dog: "means" has shape .*, expected \(N, 3\)$'):
        params.update()


def test_another_number_of_primitives_that_nobody_has_updated_is_checked_when_it_is_drawn():
    shape: Any = load()
    params: Any = mi.traverse(shape)
    fewer = MODEL.select(np.arange(MODEL.n_splats - 1))
    params["means"] = mi.TensorXf(fewer.means)
    with pytest.raises(RuntimeError, match='dog: "log_scales" has shape'):
        shape.parameters  # noqa: B018
    for name in (*RAW, *RAW_DOG):
        params[name] = mi.TensorXf(getattr(fewer, name))
    params["dog_index"] = mi.UInt32(fewer.dog_index)
    np.testing.assert_array_equal(shape.parameters["dog_row"].numpy(), upload(fewer)["dog_row"].numpy())


def test_an_update_to_an_impossible_index_is_an_error():
    m = MODEL.n_dog
    for index, problem in ((np.arange(m) + 20, "names primitive"), (np.zeros(m), "increas"),
                           (np.arange(m)[::-1], "increas"), (np.arange(m + 1), "has shape")):
        params: Any = mi.traverse(load())
        params["dog_index"] = mi.UInt32(index.astype(np.uint32))
        with pytest.raises(RuntimeError, match=problem):
            params.update()


def test_after_an_update_that_does_not_fit_nothing_is_drawn_until_one_fits():
    """Kernels would read beyond the ends of arrays, and take old rows for those of the new index."""
    shape: Any = load()
    params: Any = mi.traverse(shape)
    params["dog_index"] = mi.UInt32(MODEL.dog_index[1:])
    for attempt in (params.update, lambda: shape.parameters):
        with pytest.raises(RuntimeError, match='dog: "dog_logit_opacities" has shape'):
            attempt()

    params = mi.traverse(shape)  # knows nothing of the index that was changed before
    for name in RAW_DOG:
        params[name] = mi.TensorXf(getattr(MODEL, name)[1:])
    params.update()
    given = upload(replace(MODEL, **{name: getattr(MODEL, name)[1:] for name in ("dog_index", *RAW_DOG)}))
    np.testing.assert_array_equal(shape.parameters["dog_row"].numpy(), given["dog_row"].numpy())


@pytest.mark.parametrize(("to_world", "problem"), [
    (lambda: mi.Transform4f(np.diag([1.0, 1.0, 1.0, 2.0])), "the last row of this matrix is 0, 0, 0, 2, not 0"),
    (lambda: mi.Transform4f().translate(mi.Point3f([1, 2, 3], 0, 0)), "this transform is 3 lanes wide"),
], ids=["projective", "wide"])
def test_to_world_is_one_affine_map_at_load_and_later(to_world, problem):
    shape: Any = load()
    params: Any = mi.traverse(shape)
    params["to_world"] = to_world()
    for refused in (params.update, lambda: shape.parameters):
        with pytest.raises(RuntimeError, match=f'dog: "to_world": a model .*{problem}'):
            refused()
    params["to_world"] = mi.Transform4f().translate([0, 0, 1])
    params.update()
    np.testing.assert_allclose(shape.to_splats().means, MODEL.means + [0, 0, 1], atol=1e-6)
    with pytest.raises(RuntimeError, match=f'dog: "to_world": a model .*{problem}'):
        load(to_world=to_world())


def test_a_to_world_that_flattens_is_told_with_the_name_of_the_shape_at_load_and_later():
    flat, line = mi.ScalarTransform4f().scale([1, 0, 1]), 'dog: "to_world" of "cloud": a model cannot be flattened'
    with pytest.raises(RuntimeError, match=line):
        mi.load_dict({"type": "scene", "cloud": {**dog_dict(MODEL), "to_world": flat}})
    params: Any = mi.traverse(mi.load_dict({"type": "scene", "cloud": dog_dict(MODEL)}))
    params["cloud.to_world"] = mi.Transform4f(flat)
    with pytest.raises(RuntimeError, match=line):
        params.update()


def test_an_update_to_coefficients_of_no_sh_degree_is_an_error():
    params: Any = mi.traverse(load())
    params["sh_coeffs"] = dr.zeros(mi.TensorXf, (12, 5, 3))
    with pytest.raises(RuntimeError, match='"sh_coeffs" has shape'):
        params.update()


def test_a_model_taken_from_the_shape_may_be_changed_without_changing_the_shape():
    shape = load()
    taken = shape.to_splats()
    for name in (*RAW, *RAW_DOG, "dog_index"):
        getattr(taken, name)[:] = 1
    assert_equal(shape.to_splats(), MODEL)


# Errors

def test_wrong_parameters_are_refused_with_one_line_that_says_why(tmp_path):
    write_ply(tmp_path / "model.ply", PLAIN)
    file = str(tmp_path / "model.ply")
    short = mi.TensorXf(MODEL.means[:-1])
    cases = [
        ({"type": "dog"}, 'specify either "filename" or the tensors'),
        ({**dog_dict(MODEL), "filename": file}, 'found both'),
        ({"type": "dog", "filename": str(tmp_path / "no.ply")}, "no.ply"),
        ({**dog_dict(MODEL), "means": short}, '"log_scales" has 12 rows, "means" has 11'),
        ({"type": "dog", "means": short}, "missing tensors log_scales, quats, logit_opacities, sh_coeffs"),
        ({**dog_dict(MODEL), "to_world": mi.ScalarTransform4f().scale([1, 1, 1e-9])}, "cannot be flattened"),
        ({**dog_dict(MODEL), "to_world": mi.ScalarTransform4f().translate([0, np.nan, 0])}, "is not finite"),
        ({"type": "dog", "filename": 5}, '"filename" is 5, it must be a string'),
        ({"type": "dog", "filename": file, "radius": 3.0}, "radius"),
        ({**dog_dict(MODEL), "colour": mi.TensorXf(MODEL.means)}, "colour"),
        ({**dog_dict(MODEL), "near_clip": -0.5}, 'dog: "near_clip" is -0.5, it must be zero or more and finite'),
        ({**dog_dict(MODEL), "white": 0}, 'dog: "white" is 0, it must be above zero and finite'),
        ({**dog_dict(MODEL), "linear": "yes"}, "\"linear\" is 'yes', it must be true or false"),
        ({"type": "dog", "filename": file, "antialiased": 1}, '"antialiased" is 1, it must be true or false'),
    ]
    for given, problem in cases:
        with pytest.raises(RuntimeError, match=problem):
            mi.load_dict(given)


def test_a_file_that_is_no_model_is_refused_with_its_name(tmp_path):
    (tmp_path / "bad.ply").write_text("ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(RuntimeError, match="bad.ply"):
        mi.load_dict({"type": "dog", "filename": str(tmp_path / "bad.ply")})


# Neighbours and variants

def assert_undisturbed(image: np.ndarray, alone: np.ndarray):
    """Equal but for the order in which threads add samples to a pixel.

    A pixel is a quotient of two float32 sums of 100 positive terms (4 samples in each of 25 pixels below the filter),
    which in another order differ by 2e-5 at most, and by 6e-7 in 300 renders. An empty buffer is an error, and a
    triangle that a ray meets takes percents.
    """
    assert alone.max() > 0.1
    np.testing.assert_allclose(image, alone, rtol=2e-5)


def test_a_dog_shape_that_is_alive_or_in_the_scene_does_not_disturb_a_path_render():
    scene = {"type": "scene", "integrator": {"type": "path", "max_depth": 3}, "light": {"type": "constant"},
             "ball": {"type": "sphere"},
             "sensor": {"type": "perspective", "to_world": mi.ScalarTransform4f().look_at([0, -4, 0], [0, 0, 0],
                                                                                          [0, 0, 1]),
                        "film": {"type": "hdrfilm", "width": 24, "height": 16}}}
    alone = mi.render(mi.load_dict(scene), spp=4).numpy()
    shape = load()
    assert_undisturbed(mi.render(mi.load_dict(scene), spp=4).numpy(), alone)
    inside = mi.render(mi.load_dict({**scene, "splats": shape}), spp=4).numpy()
    assert_undisturbed(inside, alone)


def test_a_dog_shape_that_is_alive_does_not_disturb_mitsubas_own_volumetric_splats():
    splats = make_splats([[0, 0, 0], [0.5, 0, 0]], 0.3, 0.8)
    scene = {"type": "scene", "integrator": {"type": "volprim_rf_basic"},
             "splats": {"type": "ellipsoids", "centers": mi.TensorXf(splats.means), "scales": mi.TensorXf(
                 np.exp(splats.log_scales)), "quaternions": mi.TensorXf(splats.quats),
                 "opacities": mi.TensorXf(np.full((2, 1), 0.8)),
                 "sh_coeffs": mi.TensorXf(np.tile([1.0, 0.5, 0.2], (2, 1)))},
             "sensor": {"type": "perspective", "to_world": mi.ScalarTransform4f().look_at([0, -4, 0], [0, 0, 0],
                                                                                          [0, 0, 1]),
                        "film": {"type": "hdrfilm", "width": 24, "height": 16}}}
    alone = mi.render(mi.load_dict(scene), spp=4).numpy()
    shape = load()
    with_neighbour = mi.render(mi.load_dict(scene), spp=4).numpy()
    assert shape is not None
    assert_undisturbed(with_neighbour, alone)


def test_plugins_work_after_the_variant_changes_there_and_back():
    if "llvm_ad_mono" not in mi.variants():
        pytest.skip("llvm_ad_mono is not built into this Mitsuba")
    before = str(mi.variant())
    for variant in ("llvm_ad_mono", before, "scalar_rgb", before):
        mi.set_variant(variant)
        if not variant.startswith("scalar"):
            assert load(PLAIN).to_splats().n_splats == 7


RENDER = """
scene = mi.load_dict({'type': 'scene', 'integrator': {'type': 'dogsplat'},
    'sensor': {'type': 'perspective', 'film': {'type': 'hdrfilm', 'width': 8, 'height': 8}},
    'splats': {'type': 'dog', 'means': mi.TensorXf([[0., 0., 2.]]), 'log_scales': mi.TensorXf([[0., 0., 0.]]),
        'quats': mi.TensorXf([[0., 0., 0., 1.]]), 'logit_opacities': mi.TensorXf([0.]),
        'sh_coeffs': mi.TensorXf([[[1., 1., 1.]]])}})
print(round(float(mi.render(scene).numpy()[4, 4, 0]), 3))
"""


@pytest.mark.parametrize("start", [
    "import mi_dogsplat; import mitsuba as mi; mi.set_variant('llvm_ad_rgb')",
    "import mitsuba as mi; import mi_dogsplat; mi.set_variant('llvm_ad_rgb')",
    "import mi_dogsplat; import mitsuba as mi; mi.set_variant('scalar_rgb'); mi.set_variant('llvm_ad_rgb')",
    "import mitsuba as mi; mi.set_variant('scalar_rgb'); import mi_dogsplat; mi.set_variant('llvm_ad_rgb')",
], ids=["mi_dogsplat first", "mitsuba first", "scalar in between", "scalar before"])
def test_plugins_are_there_in_any_order_of_imports_and_variants(start):
    assert float(python(start + "\n" + RENDER)) > 0.05
