"""What a model says of its up axis and unit: glTF stands by it, numbers stay, and turn only where it is asked for."""

import copy
import json

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.formats.gltf_container import matrix_of
from mi_dogsplat.formats.upright import upright
from mi_dogsplat.scene.orientation import up_vector
from mi_dogsplat.scene.transform import transformed

TILTED = "0.36,-0.8,0.48"

LUF = np.diag([-1.0, -1.0, 1.0])  # of glTF, from the axes of PLY


def node_of(path) -> dict:
    return json.loads(path.read_text())["nodes"][0]


@pytest.mark.parametrize(("up", "scale"), [("z", 0.3), (TILTED, None), (None, 2.0), ("-y", 1.5), ("x", 1.0)])
def test_gltf_is_upright_and_in_metres_and_comes_back_as_it_was(tmp_path, up, scale):
    drawing = Drawing(near_clip=0.1, up=up, scale=scale)
    write_model(tmp_path / "a.gltf", Model(foreign_model.model(), drawing))
    matrix, factor = matrix_of(node_of(tmp_path / "a.gltf"))[:3, :3], scale or 1
    np.testing.assert_allclose(matrix @ LUF @ up_vector(up or "-y"), factor * np.array([0, 1, 0]), atol=1e-9)
    np.testing.assert_allclose(matrix @ matrix.T, factor**2 * np.eye(3), atol=1e-9)
    again = read_model(tmp_path / "a.gltf")
    assert again.drawing.said() == drawing.said() | {"linear": False}
    np.testing.assert_array_equal(again.splats.means, foreign_model.model().means)
    np.testing.assert_array_equal(again.splats.sh_coeffs, foreign_model.model().sh_coeffs)


def test_a_model_that_says_nothing_has_no_matrix(tmp_path):
    for drawing in (Drawing(), Drawing(up="-y", scale=1.0)):
        write_model(tmp_path / "a.gltf", Model(foreign_model.model(), drawing))
        assert node_of(tmp_path / "a.gltf") == {"mesh": 0}


def test_a_node_that_was_moved_counts_and_the_axes_of_gltf_hold_then(tmp_path):
    write_model(tmp_path / "a.gltf", Model(foreign_model.model(), Drawing(up="z", scale=2.0)))
    content = json.loads((tmp_path / "a.gltf").read_text())
    moved = matrix_of(content["nodes"][0])
    moved[:3, 3] += (1, 2, 3)
    content["nodes"][0]["matrix"] = moved.T.ravel().tolist()
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    again = read_model(tmp_path / "a.gltf")
    assert (again.drawing.up, again.drawing.scale) == ("-y", 1.0)
    expected = upright(Model(foreign_model.model(), Drawing(up="z", scale=2.0)))[0].splats
    np.testing.assert_allclose(again.splats.means, expected.means + np.array([-1, -2, 3]), atol=1e-4)


def test_models_that_are_placed_differently_meet_in_the_axes_of_gltf(tmp_path):
    """Each node sets its model upright and in metres; one of them in its own numbers would be somewhere else."""
    places = [Drawing(up="z", scale=2.0), Drawing(up="x", scale=0.5)]
    contents = []
    for drawing in places:
        write_model(tmp_path / "a.gltf", Model(foreign_model.model(), drawing))
        contents.append(json.loads((tmp_path / "a.gltf").read_text()))
    content, (node,) = contents[0], contents[1]["nodes"]
    (primitive,) = copy.deepcopy(content["meshes"][0]["primitives"])
    primitive["extras"] = contents[1]["meshes"][0]["primitives"][0]["extras"]
    content["meshes"].append({"primitives": [primitive]})
    content["nodes"].append({**node, "mesh": 1})
    content["scenes"] = [{"nodes": [0, 1]}]
    (tmp_path / "b.gltf").write_text(json.dumps(content))
    both = read_model(tmp_path / "b.gltf")
    assert (both.drawing.up, both.drawing.scale) == ("-y", 1.0)
    expected = [upright(Model(foreign_model.model(), drawing))[0].splats.means for drawing in places]
    np.testing.assert_allclose(both.splats.means, np.concatenate(expected), atol=1e-4)
    assert np.abs(expected[0] - expected[1]).max() > 1

    content["nodes"] = [content["nodes"][0], {**content["nodes"][0], "mesh": 0}]  # placed alike they stay what they are
    (tmp_path / "c.gltf").write_text(json.dumps(content))
    twice = read_model(tmp_path / "c.gltf")
    assert (twice.drawing.up, twice.drawing.scale) == ("z", 2.0)
    np.testing.assert_array_equal(twice.splats.means, np.tile(foreign_model.model().means, (2, 1)))


def test_a_file_of_before_that_has_no_matrix_keeps_what_it_says(tmp_path):
    write_model(tmp_path / "a.gltf", Model(foreign_model.model(), Drawing(up="z")))
    content = json.loads((tmp_path / "a.gltf").read_text())
    del content["nodes"][0]["matrix"]
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    again = read_model(tmp_path / "a.gltf")
    assert again.drawing.up == "z" and np.array_equal(again.splats.means, foreign_model.model().means)


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".sog", ".glb"])
def test_what_is_up_and_a_unit_travel_in_every_format_that_has_room(tmp_path, suffix):
    said = {"up": TILTED, "scale": 0.25}
    assert not write_model(tmp_path / f"a{suffix}", Model(foreign_model.model(), Drawing(**said)))
    again = read_model(tmp_path / f"a{suffix}").drawing
    assert (again.up, again.scale) == (TILTED, 0.25)


@pytest.mark.parametrize("suffix", [".spz", ".splat"])
def test_a_format_without_room_says_so_but_not_of_what_is_usual(tmp_path, suffix):
    model = foreign_model.model()
    plain = model.select(np.arange(3))
    lost = write_model(tmp_path / f"a{suffix}", Model(plain, Drawing(up="z", scale=0.30999999493360519)))
    assert "cannot say how it is drawn: up z, scale 0.31;" in lost[0]
    assert not any("up" in line for line in write_model(tmp_path / f"b{suffix}", Model(plain, Drawing(up="-y"))))


def test_upright_turns_and_scales_numbers_and_near_clip_and_can_be_undone():
    model = Model(foreign_model.model(), Drawing(near_clip=0.2, up=TILTED, scale=0.5))
    turned, matrix = upright(model)
    assert turned.drawing == Drawing(near_clip=0.1, up="-y", scale=1.0)
    np.testing.assert_allclose(matrix[:3, :3] @ up_vector(TILTED), [0, -0.5, 0], atol=1e-9)
    np.testing.assert_allclose(turned.splats.means, model.splats.means @ matrix[:3, :3].T, atol=1e-5)
    back = transformed(turned.splats, np.linalg.inv(matrix))
    for name in ("means", "log_scales", "sh_coeffs"):
        np.testing.assert_allclose(getattr(back, name), getattr(model.splats, name), atol=1e-5)


def test_a_near_clip_that_overflows_is_none():
    model = Model(foreign_model.model(), Drawing(near_clip=1e308, scale=100.0))
    assert upright(model)[0].drawing == Drawing(scale=1.0)
