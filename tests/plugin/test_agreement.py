"""The integrator draws shapes as their files say, unless it is told otherwise."""

from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, Splats, write_model
from mi_dogsplat.scene.cameras import Camera
from splat_scenes import random_splats, rounded, sensor_dict

MODEL = rounded(random_splats(12, seed=1, degree=1, dog_share=0))
MODEL.log_scales -= 2  # small ones, whose opacities change with antialiasing
CAMERA = Camera(np.eye(4), 60, 60, 32, 24, 64, 48)
SAID = [("antialiased", True, {"antialiased": True}), ("near_clip", 4.0, {"near_clip": 4.0}),
        ("linear", True, {"srgb_primitives": False})]  # fmt: skip


def scene(files, integrator: dict | None = None, **shape) -> Any:
    """Of shapes with these files, before a camera at the origin."""
    shapes = {f"shape{i}": {"type": "dog", "filename": str(file), **shape} for i, file in enumerate(files)}
    dogsplat = {"type": "dogsplat", **(integrator or {})}
    return mi.load_dict({"type": "scene", "integrator": dogsplat, "sensor": sensor_dict(CAMERA), **shapes})


def image(*args, **others) -> np.ndarray:
    loaded = scene(*args, **others)
    return np.asarray(loaded.integrator().render(loaded, loaded.sensors()[0]))


@pytest.fixture
def write(tmp_path):
    def write(name: str, **said):
        write_model(tmp_path / name, Model(MODEL, Drawing(**said)))
        return tmp_path / name

    return write


@pytest.mark.parametrize(("name", "value", "properties"), SAID)
def test_what_a_file_says_is_what_the_property_does(write, name, value, properties):
    plain, says = write("plain.ply"), write("says.ply", **{name: value})
    assert np.array_equal(image([says]), image([plain], properties))
    assert not np.array_equal(image([says]), image([plain]))


@pytest.mark.parametrize(("name", "value", "properties"), SAID)
def test_the_property_comes_first(write, name, value, properties):
    usual = {"antialiased": False, "near_clip": 0.2, "srgb_primitives": True}
    told = {key: usual[key] for key in properties}
    assert np.array_equal(image([write("says.ply", **{name: value})], told), image([write("plain.ply")]))


@pytest.mark.parametrize(("name", "value", "properties"), SAID)
def test_files_that_disagree_are_refused_by_name_unless_the_property_decides(write, name, value, properties):
    other = {"antialiased": False, "near_clip": 0.5, "linear": False}[name]
    files = [write("a.ply", **{name: value}), write("b.ply", **{name: other})]
    with pytest.raises(RuntimeError, match=f'set "{next(iter(properties))}"') as caught:
        image(files)
    assert all(words in str(caught.value) for words in ("a.ply", "b.ply", f"{value}", f"{other}", f"with {name}"))
    assert image(files, properties).max() > 0


def test_a_file_that_says_nothing_goes_along(write):
    both = [write("a.ply", antialiased=True), write("b.ply")]
    assert np.array_equal(image(both), image([write("c.ply"), write("b.ply")], {"antialiased": True}))


@pytest.mark.parametrize("first", ["linear", "silent"])
def test_the_colours_of_a_file_that_says_nothing_are_srgb_also_beside_linear_ones(write, first):
    files = {"linear": write("a.ply", linear=True), "silent": write("b.ply")}
    both = [files.pop(first), *files.values()]
    with pytest.raises(RuntimeError, match='linear .* set "srgb_primitives" of the integrator') as caught:
        image(both)
    assert "a.ply" in str(caught.value) and "b.ply" in str(caught.value)
    assert image(both, {"srgb_primitives": False}).max() > 0


def test_a_shape_without_primitives_has_no_colours_to_disagree_in(write):
    says = write("a.ply", linear=True)
    write_model(says.parent / "empty.ply", Model(Splats.empty(0)))
    assert np.array_equal(image([says.parent / "empty.ply", says]), image([says]))


def test_the_near_clip_of_a_file_is_in_its_units(write):
    file = write("a.ply", near_clip=1.25)
    double = mi.ScalarTransform4f().scale(2)
    assert np.array_equal(image([file], to_world=double), image([write("b.ply")], {"near_clip": 2.5}, to_world=double))


def test_a_file_turned_in_one_place_and_not_in_another_agrees_with_itself(write):
    file = str(write("a.ply", near_clip=0.2, antialiased=True))
    shapes = {
        name: {"type": "dog", "filename": file, "to_world": mi.ScalarTransform4f().rotate([0.6, 0, 0.8], angle)}
        for name, angle in (("a", 0), ("b", 40), ("c", 77))
    }
    loaded: Any = mi.load_dict({"type": "scene", "integrator": {"type": "dogsplat"}, **shapes})
    drawn = loaded.integrator().drawn_as(loaded)
    assert drawn.antialiased
    assert drawn.near_clip == pytest.approx(0.2)


def test_other_formats_are_shapes_too(write):
    for suffix in (".spz", ".sog", ".glb", ".splat", ".compressed.ply"):
        shape: Any = scene([write(f"a{suffix}", antialiased=True)]).shapes()[0]
        assert shape.to_splats().n_splats == 12
        assert shape.drawing.antialiased is (None if suffix == ".splat" else True)
    with pytest.raises(RuntimeError, match="dog: .*a.glb: is not glTF 2"):
        broken = write("a.glb")
        broken.write_bytes(broken.read_bytes()[:30])
        scene([broken])
