"""glTF of other programs: nodes that move, buffers outside, other types of numbers, primitives compressed as SPZ."""

import base64
import json

import foreign_model
import numpy as np
import pytest
from fuzz_targets import gltf_of_spz
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.formats import gltf_container, limits
from mi_dogsplat.formats.gltf_container import glb, matrix_of
from mi_dogsplat.formats.packing import LUF, turned
from mi_dogsplat.meshing.mesh import Mesh
from mi_dogsplat.meshing.mesh_files import write_gltf
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.errors import DataError
from scipy.spatial.transform import Rotation

NAME = "KHR_gaussian_splatting"


@pytest.fixture
def content(tmp_path):
    """The JSON of a .gltf that holds its buffer, and that buffer."""
    write_model(tmp_path / "a.gltf", Model(foreign_model.model(), Drawing(antialiased=True)))
    found = json.loads((tmp_path / "a.gltf").read_text())
    return found, base64.b64decode(found["buffers"][0]["uri"].partition(",")[2])


def test_nodes_move_what_they_hold(tmp_path, content):
    found, binary = content
    turn = Rotation.from_euler("xyz", [20, -50, 110], degrees=True)
    outer = {"children": [1], "rotation": turn.as_quat().tolist(), "translation": [1, 2, 3], "scale": [2, 2, 2]}
    column_major = [0, 0.5, 0, 0, -0.5, 0, 0, 0, 0, 0, 0.5, 0, 4, 5, 6, 1]
    found["nodes"] = [outer, {"mesh": 0, "matrix": column_major}, {"mesh": 0}]
    found["scenes"] = [{"nodes": [0, 2]}]
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    both = read_model(tmp_path / "b.glb").splats
    first, second = both.select(np.arange(12, 24)), both.select(np.arange(12))  # nodes of a level one after the other
    if not np.allclose(second.means, foreign_model.model().means):
        first, second = second, first
    assert np.array_equal(second.sh_coeffs, foreign_model.model().sh_coeffs)
    matrix = affine(2 * turn.as_matrix(), (1, 2, 3))
    inner = np.array([[0, -0.5, 0, 4], [0.5, 0, 0, 5], [0, 0, 0.5, 6], [0, 0, 0, 1]])
    assert matrix_of(found["nodes"][1]) == pytest.approx(inner)
    expected = turned(transformed(turned(foreign_model.model(), LUF), matrix @ inner), LUF)
    for name in ("means", "log_scales", "sh_coeffs"):
        assert getattr(first, name) == pytest.approx(getattr(expected, name), abs=1e-5), name


def test_the_near_clip_is_scaled_by_the_node_that_scales_the_model(tmp_path):
    write_model(tmp_path / "a.gltf", Model(foreign_model.model(), Drawing(near_clip=0.25)))
    found = json.loads((tmp_path / "a.gltf").read_text())
    found["nodes"][0]["scale"] = [4, 4, 4]
    (tmp_path / "b.gltf").write_text(json.dumps(found))
    read = read_model(tmp_path / "b.gltf")
    assert read.splats.means == pytest.approx(4 * foreign_model.model().means, abs=1e-5)
    assert read.drawing.near_clip == pytest.approx(1.0)


def test_a_buffer_may_lie_beside_the_file(tmp_path, content):
    found, binary = content
    found["buffers"][0]["uri"] = "my%20data.bin"
    (tmp_path / "my data.bin").write_bytes(binary)
    (tmp_path / "b.gltf").write_text(json.dumps(found))
    read = read_model(tmp_path / "b.gltf")
    assert np.array_equal(read.splats.means, foreign_model.model().means) and read.drawing.antialiased
    (tmp_path / "b.gltf").write_text("\ufeff" + json.dumps(found))  # as editors of Windows begin a file
    assert np.array_equal(read_model(tmp_path / "b.gltf").splats.means, read.splats.means)


def test_an_attribute_that_no_gaussian_has_is_not_read(tmp_path, content):
    found, binary = content
    found["accessors"].append({"sparse": {}})
    found["meshes"][0]["primitives"][0]["attributes"]["_MINE"] = len(found["accessors"]) - 1
    found["buffers"] = [{"byteLength": len(binary)}]
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    assert read_model(tmp_path / "b.glb").splats.n_splats == foreign_model.model().n_splats


def test_nodes_that_repeat_a_model_claim_all_of_its_memory(tmp_path, content, monkeypatch):
    """Not that of its positions alone: 4 nodes are 4 times 56 bytes a primitive."""
    found, binary = content
    found["buffers"] = [{"byteLength": len(binary)}]
    found["nodes"], found["scenes"] = [{"mesh": 0}] * 4, [{"nodes": [0, 1, 2, 3]}]
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    splats = foreign_model.model()
    one = sum(getattr(splats, name).nbytes for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs"))
    monkeypatch.setattr(limits, "RATIO", 0)
    monkeypatch.setattr(limits, "FREE", 4 * one)
    assert read_model(tmp_path / "b.glb").splats.n_splats == 4 * splats.n_splats
    monkeypatch.setattr(limits, "FREE", 4 * one - 1)
    with pytest.raises(DataError, match="repeat more primitives"):
        read_model(tmp_path / "b.glb")


def test_integers_and_rows_with_gaps_are_read(tmp_path, content):
    found, binary = content
    opacity = found["meshes"][0]["primitives"][0]["attributes"][f"{NAME}:OPACITY"]
    bytes_of = np.round(foreign_model.model().opacities * 255).astype(np.uint8)
    gaps = np.zeros((12, 4), np.uint8)
    gaps[:, 0] = bytes_of
    found["accessors"][opacity] |= {"componentType": 5121, "normalized": True}
    view = found["bufferViews"][found["accessors"][opacity]["bufferView"]]
    view |= {"byteOffset": len(binary), "byteLength": 48, "byteStride": 4}
    found["buffers"] = [{"byteLength": len(binary) + 48}]
    (tmp_path / "b.glb").write_bytes(glb(found, binary + gaps.tobytes()))
    assert read_model(tmp_path / "b.glb").splats.opacities == pytest.approx(bytes_of / 255, abs=1e-6)


def test_a_primitive_compressed_as_spz_is_moved_by_its_node(tmp_path):
    write_model(tmp_path / "a.spz", Model(foreign_model.model(), Drawing(antialiased=True)))
    alone = read_model(tmp_path / "a.spz")
    (tmp_path / "b.glb").write_bytes(gltf_of_spz((tmp_path / "a.spz").read_bytes()))
    read = read_model(tmp_path / "b.glb")
    assert read.drawing.antialiased is True
    assert read.splats.means == pytest.approx(alone.splats.means * [-2, -2, 2], abs=1e-5)  # half a turn about z, twice
    assert read.splats.log_scales == pytest.approx(alone.splats.log_scales + np.log(2), abs=1e-5)


def test_linear_colours_are_said_in_the_color_space(tmp_path, content):
    found, binary = content
    primitive = found["meshes"][0]["primitives"][0]
    assert primitive["extensions"][NAME]["colorSpace"] == "srgb_rec709_display"
    del primitive["extras"]
    primitive["extensions"][NAME] |= {"colorSpace": "lin_rec709_display", "kernel": "cone"}
    (tmp_path / "b.glb").write_bytes(glb(found | {"buffers": [{"byteLength": len(binary)}]}, binary))
    read = read_model(tmp_path / "b.glb")
    assert read.drawing == Drawing(linear=True) and read.left_out == ("its kernel cone",)
    primitive["extensions"][NAME]["kernel"] = "a\n\x1b[31m"  # no terminal is to obey
    (tmp_path / "b.glb").write_bytes(glb(found | {"buffers": [{"byteLength": len(binary)}]}, binary))
    assert read_model(tmp_path / "b.glb").left_out == (r"its kernel a\n\x1b[31m",)


def test_a_colour_space_that_is_not_known_is_told(tmp_path, content):
    found, binary = content
    how = found["meshes"][0]["primitives"][0]["extensions"][NAME]
    how["colorSpace"] = "lin_rec2020_scene"
    (tmp_path / "b.glb").write_bytes(glb(found | {"buffers": [{"byteLength": len(binary)}]}, binary))
    assert read_model(tmp_path / "b.glb").left_out == ("its colour space lin_rec2020_scene",)


@pytest.mark.parametrize("kind", [(5121, "<u1"), (5123, "<u2"), (5125, "<u4")])
def test_of_a_primitive_with_indices_those_rows_are_read(tmp_path, content, kind):
    found, binary = content
    rows = [7, 2, 11]
    data = np.array(rows, kind[1]).tobytes()
    found["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
    where = {"bufferView": len(found["bufferViews"]) - 1, "componentType": kind[0], "count": 3, "type": "SCALAR"}
    found["accessors"].append(where)
    found["meshes"][0]["primitives"][0]["indices"] = len(found["accessors"]) - 1
    found["buffers"] = [{"byteLength": len(binary + data)}]
    (tmp_path / "b.glb").write_bytes(glb(found, binary + data))
    read, expected = read_model(tmp_path / "b.glb").splats, foreign_model.model().select(rows)
    assert read.n_splats == 3 and np.array_equal(read.means, expected.means)
    assert np.array_equal(read.sh_coeffs, expected.sh_coeffs)


def test_primitives_keep_their_degrees_of_colour(tmp_path, content):
    found, binary = content
    (whole,) = found["meshes"][0]["primitives"]
    kept = {name: k for name, k in whole["attributes"].items() if "SH_DEGREE" not in name or "DEGREE_0" in name}
    found["meshes"][0]["primitives"] = [{**whole, "attributes": kept}, whole]
    found["buffers"] = [{"byteLength": len(binary)}]
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    read, coefficients = read_model(tmp_path / "b.glb").splats, foreign_model.model().sh_coeffs
    assert read.sh_degrees.tolist() == [0] * 12 + [2] * 12
    padded = read.uniform_sh().sh_coeffs
    assert np.array_equal(padded[12:], coefficients) and np.array_equal(padded[:12, :1], coefficients[:, :1])
    assert not padded[:12, 1:].any()


def test_linear_and_display_referred_primitives_are_not_one_model(tmp_path, content):
    found, binary = content
    plain = found["meshes"][0]["primitives"][0]
    del plain["extras"]
    linear = {**plain, "extensions": {NAME: plain["extensions"][NAME] | {"colorSpace": "lin_rec709_display"}}}
    found["meshes"][0]["primitives"] = [plain, linear]
    found["buffers"] = [{"byteLength": len(binary)}]
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    with pytest.raises(DataError, match="b.glb: mixes linear and display-referred primitives; export"):
        read_model(tmp_path / "b.glb")


@pytest.mark.parametrize(("change", "words"), [
    (lambda c: c["accessors"][0].update(count=13), "does not fit"),
    (lambda c: c["accessors"][0].update(count=-1), "whole number"),
    (lambda c: c["accessors"][0].update(sparse={}), "accessor 0 is sparse, which is not read; export it without"),
    (lambda c: c.update(scenes=[{}]), "holds no primitive with KHR_gaussian_splatting"),
    (lambda c: c["bufferViews"][0].update(byteLength=10**6), "ends at"),
    (lambda c: (c["buffers"].append({"byteLength": 10**6}), c["bufferViews"][0].update(buffer=1)),
     "buffer 1 has no bytes that are not compressed"),  # as EXT_meshopt_compression has it
    (lambda c: c["nodes"][0].update(children=[0]), "do not form trees"),
    (lambda c: c["nodes"][0].update(scale=[1, 0, 1]), "cannot be flattened"),
    (lambda c: c["nodes"][0].update(rotation=[0, 0, 0, 0]), "rotation of a node is zero"),
    (lambda c: c.update(scenes=[{"nodes": [7]}]), "IndexError"),
    (lambda c: c.update(scenes=[{"nodes": [-1]}]), "whole number"),
    (lambda c: c["nodes"][0].update(mesh=-1), "whole number"),
])  # fmt: skip
def test_what_does_not_fit_together_is_refused(tmp_path, content, change, words):
    found, binary = content
    found["buffers"] = [{"byteLength": len(binary)}]
    change(found)
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    with pytest.raises(DataError, match=words):
        read_model(tmp_path / "b.glb")


def test_an_extension_that_a_file_cannot_be_read_without_is_named(tmp_path, content):
    found, binary = content
    found["buffers"] = [{"byteLength": len(binary)}]
    found["extensionsRequired"] = ["KHR_mesh_quantization", "EXT_meshopt_compression", "KHR_texture_transform"]
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    assert read_model(tmp_path / "b.glb").splats.n_splats == foreign_model.model().n_splats  # it does well without them
    del found["accessors"][0]["bufferView"]  # which the extension has elsewhere
    (tmp_path / "b.glb").write_bytes(glb(found, binary))
    with pytest.raises(DataError, match="b.glb: needs EXT_meshopt_compression, KHR_texture_transform, which is not "):
        read_model(tmp_path / "b.glb")


@pytest.mark.parametrize("what", ["model", "mesh"])
def test_a_glb_of_more_bytes_than_its_header_can_say_is_told_in_one_line_and_leaves_the_old_one(
    tmp_path, monkeypatch, what
):
    path = tmp_path / "a.glb"
    corners = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]), np.ones((3, 3), np.float32))

    def write(file):
        if what == "mesh":
            write_gltf(file, corners, Drawing())
        else:
            write_model(file, foreign_model.model())

    write(path)
    before = path.read_bytes()
    monkeypatch.setattr(gltf_container, "LARGEST", len(before))
    write(path)
    monkeypatch.setattr(gltf_container, "LARGEST", len(before) - 1)
    with pytest.raises(DataError, match=r"a\.glb: would have .* GB, and a \.glb has at most .*; name a \.gltf, or"):
        write(path)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 1
    write(tmp_path / "a.gltf")
