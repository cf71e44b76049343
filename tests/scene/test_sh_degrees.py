"""Primitives with SH degrees of their own: in memory, and in a PLY file."""

import numpy as np
import pytest
from mi_dogsplat.scene.ply import read_ply, rows_save, write_ply
from mi_dogsplat.scene.row_groups import SH
from mi_dogsplat.scene.sh_basis import sh_degree_of
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from ply_files import dog_columns, random_splats, to_bytes, vertex_columns, write

DEGREES = np.array([3, 0, 1, 2, 0, 3, 1])
FIELDS = tuple(Splats.__dataclass_fields__)


def mixed(degrees=DEGREES, dog_index=(0, 3, 4)) -> Splats:
    return random_splats(n=len(degrees), dog_index=dog_index).with_sh_degrees(degrees)


def same(a: Splats, b: Splats):
    for name in FIELDS:
        left, right = getattr(a, name), getattr(b, name)
        assert left.shape == right.shape and left.tobytes() == right.tobytes(), name


def test_a_primitive_keeps_the_coefficients_up_to_its_degree_and_no_others():
    whole, model = random_splats(), mixed()
    assert model.mixed_sh and model.sh_degree == 3 and model.sh_degrees.tolist() == DEGREES.tolist()
    np.testing.assert_array_equal(model.sh_coeffs, whole.sh_coeffs[:, :1])
    assert model.sh1_index.tolist() == [2, 6] and model.sh2_index.tolist() == [3] and model.sh3_index.tolist() == [0, 5]
    np.testing.assert_array_equal(model.sh1_coeffs, whole.sh_coeffs[[2, 6], 1:4])
    np.testing.assert_array_equal(model.sh2_coeffs, whole.sh_coeffs[[3], 1:9])
    np.testing.assert_array_equal(model.sh3_coeffs, whole.sh_coeffs[[0, 5], 1:])


def test_padded_with_zeros_it_is_a_model_of_one_degree():
    padded, whole = mixed().uniform_sh(), random_splats()
    assert not padded.mixed_sh and padded.sh_coeffs.shape == (7, 16, 3)
    for row, degree in enumerate(DEGREES):
        k = (degree + 1) ** 2
        np.testing.assert_array_equal(padded.sh_coeffs[row, :k], whole.sh_coeffs[row, :k])
        assert not padded.sh_coeffs[row, k:].any()
    same(mixed().uniform_sh(1), whole.with_sh_degrees(np.minimum(DEGREES, 1)).uniform_sh())
    same(padded.with_sh_degrees(DEGREES), mixed())
    same(padded.uniform_sh(), padded)


@pytest.mark.parametrize("degree", range(4))
def test_equal_degrees_make_a_uniform_model(degree):
    model = mixed().with_sh_degrees(np.full(7, degree))
    assert not model.mixed_sh and model.sh_degree == degree and model.sh_coeffs.shape[1] == (degree + 1) ** 2
    assert set(model.sh_degrees.tolist()) == {degree}


def test_another_degree_drops_coefficients_or_adds_zeros():
    model = mixed().with_sh_degrees([0, 3, 2, 1, 0, 3, 1])
    whole = random_splats().sh_coeffs
    assert model.sh_degrees.tolist() == [0, 3, 2, 1, 0, 3, 1]
    assert not model.sh3_coeffs[0].any()  # of primitive 1
    np.testing.assert_array_equal(model.sh2_coeffs[0, :3], whole[2, 1:4])
    assert not model.sh2_coeffs[0, 3:].any()
    np.testing.assert_array_equal(model.sh1_coeffs[0], whole[3, 1:4])
    assert mixed().with_sh_degrees([1, 0, 0, 1, 0, 0, 1]).sh_degree == 1


def test_a_model_without_primitives_has_no_degrees_to_mix():
    assert mixed().select([]).with_sh_degrees([]).n_splats == 0
    assert Splats.empty(2).with_sh_degrees(np.zeros(0, int)).sh_degree == 2


@pytest.mark.parametrize(
    "which",
    [[5, 0, 2], [2, 2, 3, 1], [-1], [1, 4], [], DEGREES > 0, np.zeros(7, bool)],
)
def test_selected_primitives_keep_their_own_colour(which):
    chosen, expected = mixed().select(which), mixed().uniform_sh().select(which)
    same(chosen.uniform_sh(3), expected)
    assert chosen.sh_degrees.tolist() == (DEGREES[np.asarray(which, bool if len(which) == 7 else int)]).tolist()


def test_the_parts_of_a_mixture_keep_their_colour():
    for part in ("plain", "only_dog", "only_gaussians"):
        same(getattr(mixed(), part)().uniform_sh(3), getattr(mixed().uniform_sh(), part)())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sh1_index": [7]}, '"sh1_index" spans 7 to 7, "means" has 7 rows'),
        ({"sh1_index": [2, 1]}, '"sh1_index" is not strictly increasing'),
        ({"sh1_index": [2]}, '"sh1_coeffs" has 2 rows, "sh1_index" has 1; both need one row'),
        ({"sh3_coeffs": np.zeros((2, 16, 3))}, '"sh3_coeffs" has shape [2, 16, 3], expected [2, 15, 3]'),
        ({"sh3_index": [2, 5]}, "primitive 2 is in more than one of"),
        ({"sh_coeffs": np.zeros((7, 4, 3))}, '"sh_coeffs" has 4 coefficients; beside groups of SH degrees it has 1'),
    ],
)
def test_groups_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(ValueError) as error:
        Splats(**(vars(mixed()) | changes))
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("degrees", [[0, 1], [0, 0, 0, 0, 0, 0, 4], [0, 0, 0, 0, 0, 0, -1], [0.5] * 7])
def test_what_is_no_degree_is_refused(degrees):
    with pytest.raises(ValueError, match=r"Splats.with_sh_degrees: "):
        mixed().with_sh_degrees(degrees)
    with pytest.raises(ValueError, match="uniform_sh: an SH degree is 4, expected 0..3"):
        mixed().uniform_sh(4)


# --- PLY ---


@pytest.mark.parametrize("dog_index", [(), (0, 3, 4)])
@pytest.mark.parametrize("degrees", [DEGREES, [0, 3, 3, 0, 0, 0, 0], [3, 3, 3, 3, 1, 3, 3]], ids=str)
def test_a_file_of_rows_comes_back_bit_for_bit(tmp_path, degrees, dog_index):
    model = mixed(degrees, dog_index)
    write_ply(tmp_path / "a.ply", model, "rows")
    same(read_ply(tmp_path / "a.ply"), model)


def test_the_usual_file_is_plain_3dgs_padded_with_zeros(tmp_path):
    write_ply(tmp_path / "a.ply", mixed())
    write_ply(tmp_path / "b.ply", mixed().uniform_sh())
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    same(read_ply(tmp_path / "a.ply"), mixed().uniform_sh())


@pytest.mark.parametrize("degrees", [[0, 3], [3] * 30 + [2], [0] * 9 + [1], [1, 2, 0, 3, 3], [0, 2] * 20, [2, 2]])
def test_how_many_bytes_the_file_of_rows_saves_is_known_beforehand(tmp_path, degrees):
    splats = random_splats(len(degrees), dog_index=[]).with_sh_degrees(degrees)
    sizes = []
    for layout in ("3dgs", "rows"):
        write_ply(tmp_path / "m.ply", splats, layout=layout)
        sizes.append((tmp_path / "m.ply").stat().st_size)
    assert rows_save(np.array(degrees)) == sizes[0] - sizes[1]


def test_a_uniform_model_is_the_same_file_in_both_layouts(tmp_path):
    write_ply(tmp_path / "a.ply", random_splats())
    write_ply(tmp_path / "b.ply", random_splats(), "rows")
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def elements(model: Splats) -> dict[str, dict[str, np.ndarray]]:
    """The file of rows as tables of columns."""
    tables = {"vertex": vertex_columns(model), "dog": {"index": model.dog_index, **dog_columns(model)}}
    for degree, group in SH.items():
        rest = getattr(model, group.names[0]).transpose(0, 2, 1).reshape(len(getattr(model, group.index)), -1)
        columns = {f"f_rest_{i}": values for i, values in enumerate(rest.T)}
        tables[f"sh{degree}"] = {"index": getattr(model, group.index), **columns}
    return tables


def test_the_file_of_rows_has_the_fixed_layout_and_no_byte_more(tmp_path):
    model = mixed(dog_index=(1, 2))
    write_ply(tmp_path / "a.ply", model, "rows")
    expected = elements(model)
    zero = np.zeros(7, np.float32)
    expected["vertex"] = {}
    order = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
    expected["vertex"] = {name: vertex_columns(model).get(name, zero) for name in order}
    data = to_bytes(expected, types={"index": "uint"}).replace(b"comment made by a test\n", b"")
    assert (tmp_path / "a.ply").read_bytes() == data
    body = data.split(b"end_header\n", 1)[1]
    assert len(body) == 4 * (7 * 17 + 2 * 5 + 2 * (1 + 9) + 1 * (1 + 24) + 2 * (1 + 45))


@pytest.mark.parametrize("file_format", ["binary_big_endian", "ascii"])
def test_rows_in_any_order_are_read_in_every_format(tmp_path, file_format):
    tables = elements(mixed())
    tables["sh3"] = {name: values[::-1] for name, values in tables["sh3"].items()}
    tables = dict(reversed(tables.items()))
    same(read_ply(write(tmp_path, to_bytes(tables, file_format, {"index": "uint"}))), mixed())


def damaged(name: str, column: str, values) -> bytes:
    tables = elements(mixed())
    tables[name][column] = np.asarray(values)
    return to_bytes(tables, types={"index": "int"})


def with_rest_in_vertex() -> bytes:
    tables = elements(mixed())
    tables["vertex"] |= {f"f_rest_{i}": np.zeros(7) for i in range(9)}
    return to_bytes(tables, types={"index": "int"})


def without(column: str) -> bytes:
    tables = elements(mixed())
    del tables["sh2"][column]
    return to_bytes(tables, types={"index": "int"})


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (damaged("sh1", "index", [2, 7]), 'row 1 of the element "sh1" has index 7, but the model has 7 primitives'),
        (damaged("sh1", "index", [2, 2]), 'the element "sh1" names primitive 2 more than once'),
        (damaged("sh3", "index", [2, 5]), "more than one of the elements sh1, sh2, sh3 names primitive 2"),
        (damaged("sh3", "f_rest_44", [0, np.nan]), 'first "f_rest_44" in row 1'),
        (with_rest_in_vertex(), 'view-dependent colour both in the element "vertex" and in the element "sh1"'),
        (without("f_rest_23"), 'element "sh2" has no property "f_rest_23"'),
        (without("index"), 'element "sh2" has no property "index"'),
        (to_bytes(elements(mixed()), types={"index": "int"})[:-1], "bytes follow"),
    ],
    ids=["out of range", "twice", "two degrees", "not finite", "both layouts", "a column", "no index", "truncated"],
)
def test_damage_is_one_clear_line(tmp_path, data, message):
    path = write(tmp_path, data)
    with pytest.raises(DataError) as error:
        read_ply(path)
    text = str(error.value)
    assert text.startswith(f"{path}: ") and message in text and "; " in text and "\n" not in text


def test_values_of_a_group_that_are_not_finite_are_not_written(tmp_path):
    model = mixed()
    model.sh2_coeffs[0, 3, 1] = np.inf
    with pytest.raises(DataError, match='"f_rest_11" in row 0 of the element "sh2"; nothing was written'):
        write_ply(tmp_path / "a.ply", model, "rows")
    assert list(tmp_path.iterdir()) == []


def test_a_degree_is_told_by_its_coefficients():
    assert [sh_degree_of((degree + 1) ** 2) for degree in range(4)] == [0, 1, 2, 3]
    with pytest.raises(ValueError):
        sh_degree_of(5)
