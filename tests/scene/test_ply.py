"""PLY: what is written comes back bit for bit, and other layouts are understood."""

from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat import read_model
from mi_dogsplat.scene.filter_3d import filtered
from mi_dogsplat.scene.ply import read_ply, write_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support import files
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.llvm import choose_llvm
from ply_files import dog_columns, random_splats, to_bytes, vertex_columns, write

MODELS = Path(__file__).parents[2].parent / "shared" / "data" / "models"


def same(a: Splats, b: Splats):
    for name in Splats.__dataclass_fields__:
        left, right = getattr(a, name), getattr(b, name)
        assert left.shape == right.shape and left.tobytes() == right.tobytes(), name


@pytest.mark.parametrize("sh_degree", range(4))
@pytest.mark.parametrize("dog_index", [(), (0, 3, 4), tuple(range(7))])
def test_a_written_model_comes_back_bit_for_bit(tmp_path, sh_degree, dog_index):
    splats = random_splats(sh_degree=sh_degree, dog_index=dog_index)
    write_ply(tmp_path / "a.ply", splats)
    same(read_ply(tmp_path / "a.ply"), splats)


def test_a_model_without_primitives_round_trips(tmp_path):
    write_ply(tmp_path / "a.ply", Splats.empty(2))
    same(read_ply(str(tmp_path / "a.ply")), Splats.empty(2))


def test_the_file_has_the_fixed_layout_byte_for_byte(tmp_path):
    splats = random_splats(n=3, sh_degree=1, dog_index=(1, 2))
    write_ply(tmp_path / "a.ply", splats)
    zero = np.zeros(3, np.float32)
    columns = vertex_columns(splats)
    order = [
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        *(f"f_rest_{i}" for i in range(9)),
    ]
    order += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    vertex = {name: columns.get(name, zero) for name in order}
    dog = {"index": splats.dog_index, **dog_columns(splats)}
    expected = to_bytes({"vertex": vertex, "dog": dog}, types={"index": "uint"})
    assert (tmp_path / "a.ply").read_bytes() == expected.replace(b"comment made by a test\n", b"")


def test_a_model_without_dog_has_no_second_element(tmp_path):
    write_ply(tmp_path / "a.ply", random_splats(dog_index=()))
    assert b"dog" not in (tmp_path / "a.ply").read_bytes()


@pytest.mark.parametrize("file_format", ["binary_little_endian", "binary_big_endian", "ascii"])
@pytest.mark.parametrize("sh_degree", range(4))
def test_every_format_is_read_without_normals(tmp_path, file_format, sh_degree):
    splats = random_splats(sh_degree=sh_degree)
    elements = {"vertex": vertex_columns(splats), "dog": {"index": splats.dog_index, **dog_columns(splats)}}
    same(read_ply(write(tmp_path, to_bytes(elements, file_format, {"index": "uint"}))), splats)


def test_dog_columns_inside_vertex_make_every_primitive_a_dog(tmp_path):
    splats = random_splats(dog_index=range(7))
    path = write(tmp_path, to_bytes({"vertex": vertex_columns(splats) | dog_columns(splats)}))
    same(read_ply(path), splats)


def test_columns_go_by_name_and_extra_ones_are_ignored(tmp_path):
    splats = random_splats()
    columns = vertex_columns(splats) | {"red": np.arange(7), "label": np.arange(7.0)}
    shuffled = dict(sorted(columns.items(), reverse=True))
    elements = {
        "camera": {"focal": np.ones(2)},
        "dog": dict(reversed((dog_columns(splats) | {"index": splats.dog_index}).items())),
        "vertex": shuffled,
        "extra": {"v": np.zeros(5)},
    }
    types = {"red": "uchar", "label": "double", "index": "int", "focal": "double"}
    same(read_ply(write(tmp_path, to_bytes(elements, types=types))), splats)


def test_of_sh_degree_4_the_first_three_bands_are_read_and_that_is_said(tmp_path):
    columns = vertex_columns(random_splats(n=7, sh_degree=0, dog_index=()))
    columns |= {f"f_rest_{i}": np.arange(7) + 10 * i for i in range(72)}
    model = read_model(write(tmp_path, to_bytes({"vertex": columns})))
    assert model.left_out == ("spherical harmonics of degree 4",)
    green = np.stack([columns[f"f_rest_{24 + k}"] for k in range(15)], axis=1)  # each channel has 24
    np.testing.assert_array_equal(model.splats.sh_coeffs[:, 1:, 1], green)


def test_other_scalar_types_are_converted(tmp_path):
    splats = random_splats(n=4, sh_degree=0, dog_index=())
    columns = vertex_columns(splats)
    columns["opacity"] = np.array([0, 1, 2, 255])
    types = dict.fromkeys(columns, "double") | {"opacity": "uchar", "x": "float32"}
    read = read_ply(write(tmp_path, to_bytes({"vertex": columns}, types=types)))
    assert read.logit_opacities.tolist() == [0, 1, 2, 255]
    assert read.means.tobytes() == splats.means.tobytes()


def test_windows_line_ends_in_the_header_are_fine(tmp_path):
    splats = random_splats(dog_index=())
    header, body = to_bytes({"vertex": vertex_columns(splats)}).split(b"end_header\n", 1)
    path = write(tmp_path, header.replace(b"\n", b"\r\n") + b"end_header\r\n" + body)
    same(read_ply(path), splats)


def test_unsorted_dog_rows_are_sorted_with_their_values(tmp_path):
    splats = random_splats()
    dog = {name: values[::-1] for name, values in ({"index": splats.dog_index} | dog_columns(splats)).items()}
    path = write(tmp_path, to_bytes({"vertex": vertex_columns(splats), "dog": dog}, types={"index": "uint"}))
    same(read_ply(path), splats)


def test_faces_after_the_vertices_are_ignored(tmp_path):
    splats = random_splats(dog_index=())
    data = to_bytes({"vertex": vertex_columns(splats)})
    face = b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    path = write(tmp_path, data.replace(b"end_header\n", face) + bytes([3]) + bytes(12))
    same(read_ply(path), splats)


@pytest.mark.parametrize("name", ["kacytran_try_iter7000_9k_sh3.ply", "playbot_lod2_sh2.ply"])
def test_real_models_are_read_and_written_back_unchanged(tmp_path, name):
    path = MODELS / name
    if not path.exists():
        pytest.skip(f"needs {path}")
    splats = read_ply(path)
    assert splats.n_dog == 0 and splats.n_splats > 9000
    assert splats.sh_degree == int(path.stem[-1])
    write_ply(tmp_path / "copy.ply", splats)
    rows, copied = (p.read_bytes().split(b"end_header\n", 1)[1] for p in (path, tmp_path / "copy.ply"))
    assert rows == copied


def test_mitsubas_own_loader_opens_the_file(tmp_path):
    mi = pytest.importorskip("mitsuba")
    variant = "llvm_ad_rgb" if "llvm_ad_rgb" in mi.variants() else mi.variants()[0]
    choose_llvm()
    mi.set_variant(variant)
    splats = random_splats(sh_degree=1)
    write_ply(tmp_path / "a.ply", splats)
    shape = mi.load_dict({"type": "ellipsoids", "filename": str(tmp_path / "a.ply")})
    data = np.array(mi.traverse(shape)["data"]).reshape(-1, 10)  # [N, 10] centre, scale, quaternion
    np.testing.assert_array_equal(data[:, :3], splats.means)
    np.testing.assert_allclose(data[:, 3:6], splats.scales, rtol=1e-6)


def test_the_old_file_survives_a_failed_write(tmp_path, monkeypatch):
    path = tmp_path / "a.ply"
    write_ply(path, random_splats())
    before = path.read_bytes()

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(DataError, match="No space left on device"):
        write_ply(path, random_splats(seed=1))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_write_leaves_nothing_behind(tmp_path, monkeypatch):
    def interrupt(_descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(files.os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_ply(tmp_path / "a.ply", random_splats())
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_one_clear_line(tmp_path):
    with pytest.raises(DataError, match="cannot be written .*No such file or directory.*folder exists"):
        write_ply(tmp_path / "no" / "a.ply", random_splats())
    with pytest.raises(DataError, match="cannot be written"):
        write_ply(tmp_path, random_splats())
    assert list(tmp_path.parent.glob(".*.part")) == []


def test_the_3d_filter_of_mip_splatting_widens_primitives_and_makes_them_fainter(tmp_path):
    splats = random_splats(dog_index=())
    widths = np.array([0, 1e-3, 0.1, 0.5, 1, 3, 1e-30], np.float32)
    read = read_ply(write(tmp_path, to_bytes({"vertex": vertex_columns(splats) | {"filter_3D": widths}})))
    wider = np.sqrt(np.square(splats.scales.astype(np.float64)) + np.square(widths[:, None].astype(np.float64)))
    fainter = splats.opacities * (splats.scales / wider).prod(axis=1)
    assert read.scales == pytest.approx(wider, rel=1e-6) and read.opacities == pytest.approx(fainter, rel=1e-5)
    same(read.select([0]), splats.select([0]))
    write_ply(tmp_path / "b.ply", read)
    same(read_ply(tmp_path / "b.ply"), read)


def test_a_width_of_the_3d_filter_has_no_sign_and_leaves_what_is_opaque_finite():
    scales, logits, widths = np.zeros((3, 3)), np.array([0.0, 2.0, 800.0]), np.full(3, 0.5)
    for found, wanted in zip(filtered(scales, logits, -widths), filtered(scales, logits, widths), strict=True):
        assert np.array_equal(found, wanted)
    after, faded = filtered(scales, logits, np.full(3, 1e-30))
    assert np.abs(after).max() < 1e-30 and faded[:2] == pytest.approx(logits[:2]) and 13 < faded[2] <= 800


@pytest.mark.parametrize(("code", "full"), [("uchar", 255), ("ushort", 65535), ("float", 1)])
def test_colours_in_place_of_coefficients_are_read(tmp_path, code, full):
    """As nerfstudio writes a model without view-dependent colour; where both are there, coefficients count."""
    splats = random_splats(sh_degree=0, dog_index=())
    shares = np.linspace(0, 1, 21).reshape(7, 3)
    levels = shares if full == 1 else np.round(shares * full)
    columns = {name: values for name, values in vertex_columns(splats).items() if not name.startswith("f_dc")}
    columns |= dict(zip(("red", "green", "blue"), levels.T, strict=True))
    types = dict.fromkeys(("red", "green", "blue"), code)
    for file_format in ("binary_little_endian", "binary_big_endian", "ascii"):
        read = read_ply(write(tmp_path, to_bytes({"vertex": columns}, file_format, types)))
        colors = 0.5 + 0.28209479177387814 * read.sh_coeffs[:, 0]
        assert colors == pytest.approx(levels / full, abs=1e-6) and read.sh_degree == 0
    both = {"vertex": vertex_columns(splats) | columns}
    same(read_ply(write(tmp_path, to_bytes(both, types=types))), splats)


def test_opacities_of_zero_and_one_are_read_as_almost_that(tmp_path):
    """Logits of ±∞, in either layout of DoG."""
    splats = random_splats(dog_index=range(7))
    splats.logit_opacities[:2] = splats.dog_logit_opacities[:2] = np.inf, -np.inf
    rows = {"vertex": vertex_columns(splats), "dog": {"index": np.arange(7)} | dog_columns(splats)}
    columns = {"vertex": vertex_columns(splats) | dog_columns(splats)}
    for data in (to_bytes(rows, types={"index": "uint"}), to_bytes(columns)):
        read = read_ply(write(tmp_path, data))
        for opacities in (read.opacities, read.dog_opacities):
            assert opacities[:2] == pytest.approx([1 - 1e-6, 1e-6], rel=0.1)
        np.testing.assert_array_equal(read.logit_opacities[2:], splats.logit_opacities[2:])


def test_a_scale_of_zero_is_read_as_almost_that(tmp_path):
    """A logarithm of -∞, as of files made of flat primitives; one of ∞ is still an error."""
    splats = random_splats()
    splats.log_scales[2, 1] = -np.inf
    path = write(tmp_path, to_bytes({"vertex": vertex_columns(splats)}))
    read = read_ply(path)
    assert read.scales[2, 1] == pytest.approx(1e-30) and np.isfinite(read.log_scales).all()
    splats.log_scales[2, 1] = read.log_scales[2, 1]
    np.testing.assert_array_equal(read.log_scales, splats.log_scales)
    splats.log_scales[2, 1] = np.inf
    with pytest.raises(DataError, match='not finite: 1, the first "scale_1" in row 2'):
        read_ply(write(tmp_path, to_bytes({"vertex": vertex_columns(splats)})))


def test_values_that_are_not_finite_are_not_written(tmp_path):
    splats = random_splats()
    splats.log_scales[2, 1] = np.nan
    splats.log_scales[4, 0] = np.inf
    with pytest.raises(DataError, match='not finite: 2, the first "scale_1" in row 2 of the element "vertex"; nothing'):
        write_ply(tmp_path / "a.ply", splats)
    assert list(tmp_path.iterdir()) == []


def test_a_layout_of_another_name_is_refused_and_writes_nothing(tmp_path):
    with pytest.raises(ValueError, match='layout "row" is unknown; use 3dgs or rows'):
        write_ply(tmp_path / "a.ply", random_splats(), layout="row")  # pyright: ignore[reportArgumentType]
    assert not any(tmp_path.iterdir())
