"""PLY: whatever is not a model is one clear error, and no damage gets through as anything else."""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from ply_files import DOG, dog_columns, random_splats, to_bytes, vertex_columns, write


def complaint(path) -> str:
    """The message of the DataError that reading ``path`` raises: one line that names the file."""
    with pytest.raises(DataError) as error:
        read_ply(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ") and "; " in message and "\n" not in message
    return message


def plain(**changes) -> bytes:
    """A valid file without DoG; a column given as None is left out."""
    columns = vertex_columns(random_splats(sh_degree=1, dog_index=())) | changes
    return to_bytes({"vertex": {name: values for name, values in columns.items() if values is not None}})


def with_dog(rows, types=None, **changes) -> bytes:
    columns = {"index": np.array(rows)} | {name: np.zeros(len(rows)) for name in DOG} | changes
    dog = {name: values for name, values in columns.items() if values is not None}
    elements = {"vertex": vertex_columns(random_splats(sh_degree=0, dog_index=())), "dog": dog}
    return to_bytes(elements, types={"index": "int"} | (types or {}))


def with_sh_rows() -> bytes:
    """A model whose primitives have SH degrees of their own: two of degree 1, one of degree 2."""
    tables = {"vertex": vertex_columns(random_splats(sh_degree=0, dog_index=()))}
    for element, index, columns in (("sh1", [0, 4], 9), ("sh2", [5], 24)):
        rest = {f"f_rest_{i}": np.full(len(index), 0.1 * i) for i in range(columns)}
        tables[element] = {"index": np.array(index)} | rest
    return to_bytes(tables, types={"index": "uint"})


ALL_DOG = random_splats(dog_index=range(7))
NOT_FINITE = np.array([0, 1, np.nan, 2, np.inf, 3, 4])
BAD_FILES = {
    "empty": (b"", "the file is empty"),
    "text": (b"hello\nworld\n", "not a PLY file"),
    "zip": (b"PK\x03\x04" + bytes(100), "not a PLY file"),
    "no end_header": (b"ply\nformat ascii 1.0\n", 'no "end_header" line'),
    "endless header": (b"ply\n" + b"comment x\n" * 200_000, 'no "end_header" line'),
    "no format": (b"ply\nelement vertex 0\nend_header\n", 'no "format" line'),
    "version": (plain().replace(b"endian 1.0", b"endian 2.0"), 'unsupported "format binary_little_endian 2'),
    "format": (plain().replace(b"little", b"middle"), 'unsupported "format binary_middle_endian'),
    "no vertex": (to_bytes({"point": {"x": np.zeros(2)}}), 'there is no element "vertex"'),
    "truncated": (plain()[:-1], 'promises 7 x "vertex" = 644 bytes or more, but only 643 bytes follow'),
    "too long": (plain() + b"x", "1 byte of data left over"),
    "absurd count": (
        plain().replace(b"vertex 7", b"vertex 99999999999999999"),
        "promises 99999999999999999 x",
    ),
    "endless count": (plain().replace(b"vertex 7", b"vertex " + b"9" * 5000), "makes no sense"),
    "negative count": (
        plain().replace(b"vertex 7", b"vertex -7"),
        'header line "element vertex -7" makes no sense',
    ),
    "unknown type": (plain().replace(b"float x", b"half x"), 'header line "property half x" makes no sense'),
    "early property": (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "makes no sense"),
    "binary header": (b"ply\nformat ascii 1.0\n\xff\x00\x1b[31m\nend_header\n", "makes no sense"),
    "two x": (plain().replace(b"float y\n", b"float x\n"), 'property "x" is declared twice'),
    "two vertex": (plain().replace(b"end_header", b"element vertex 0\nend_header"), "is declared twice"),
    "list": (plain().replace(b"end_header", b"property list uchar int a\nend_header"), "has a list property"),
    "list before": (
        plain().replace(b"element vertex", b"element face 0\nproperty list uchar int a\nelement vertex"),
        'element "face" has a list property; write it after all others, or leave it out',
    ),
    "no z": (plain(z=None), 'element "vertex" has no property "z"; give a 3D Gaussian'),
    "no opacity": (plain(opacity=None), 'has no property "opacity"'),
    "no rot_3": (plain(rot_3=None), 'has no property "rot_3"'),
    "no f_rest_8": (
        plain(f_rest_8=None),
        r"8 properties f_rest_*, but SH degree 0, 1, 2, 3 has 0, 9, 24, 45",
    ),
    "gap": (plain().replace(b"f_rest_8", b"f_rest_9"), 'has no property "f_rest_8"'),
    "no columns": (b"ply\nformat ascii 1.0\nelement vertex 99999\nend_header\n", 'has no property "x"'),
    "compressed": (
        to_bytes({"vertex": {"packed_position": np.zeros(2)}}),
        "compressed PLY, export it uncompressed",
    ),
    "not finite": (plain(scale_1=NOT_FINITE), 'has values that are not finite: 2, the first "scale_1" in row 2'),
    "beyond float32": (
        to_bytes(
            {"vertex": vertex_columns(random_splats()) | {"y": np.full(7, 1e300)}}, types={"y": "double"}
        ),
        'has values that are not finite: 7, the first "y" in row 0',
    ),
    "some dog columns": (plain(dog_opacity=np.zeros(7)), 'element "vertex" has no property "dog_scale_0"'),
    "index too high": (
        with_dog([0, 7]),
        'row 1 of the element "dog" has index 7, but the model has 7 primitives',
    ),
    "index negative": (with_dog([-1, 2]), 'row 0 of the element "dog" has index -1'),
    "index broken": (with_dog([0.5], {"index": "float"}), 'row 0 of the element "dog" has index 0.5'),
    "index twice": (with_dog([3, 1, 3]), "names primitive 3 more than once"),
    "no index": (with_dog([1], index=None), 'element "dog" has no property "index"'),
    "no dog_scale_2": (with_dog([1], dog_scale_2=None), 'element "dog" has no property "dog_scale_2"'),
    "dog not finite": (with_dog([1], dog_opacity=[np.nan]), 'first "dog_opacity" in row 0'),
    "both layouts": (
        to_bytes({"vertex": vertex_columns(ALL_DOG) | dog_columns(ALL_DOG), "dog": dog_columns(ALL_DOG)}),
        'both in the element "vertex" and in the element "dog"',
    ),
    "ascii short": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty int y\nend_header\n1222\n",
        "ends after 1 of 2 values",
    ),
    "ascii word": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\none\n",
        "not a number",
    ),
    "ascii long": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1 2\n",
        "left over",
    ),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_a_bad_file_is_one_line_that_says_what_is_wrong(tmp_path, case):
    data, problem = BAD_FILES[case]
    path = write(tmp_path, data)
    assert problem in complaint(path)


def test_folders_missing_files_and_pipes_are_refused(tmp_path):
    assert "this is a folder" in complaint(tmp_path)
    assert "No such file" in complaint(tmp_path / "no.ply")
    os.mkfifo(tmp_path / "pipe")
    assert "not a regular file" in complaint(tmp_path / "pipe")


SEEDS = [
    plain(),
    with_dog([0, 2, 6]),
    to_bytes({"vertex": vertex_columns(random_splats(n=2, sh_degree=0, dog_index=()))}, "ascii"),
    with_sh_rows(),
]


@st.composite
def damaged(draw) -> bytes:
    """A valid file with bits flipped (mostly in the header), pieces cut out or put in, or the end cut off."""
    data = bytearray(draw(st.sampled_from(SEEDS)))
    header = data.index(b"end_header") + 11
    for _ in range(draw(st.integers(1, 4))):
        limit = min(len(data), draw(st.sampled_from([header, len(data)])))
        at = draw(st.integers(0, max(0, limit - 1)))
        match draw(st.sampled_from(["flip", "cut", "end", "insert", "digit"])):
            case "flip" if data:
                data[at] ^= 1 << draw(st.integers(0, 7))
            case "cut":
                del data[at : at + draw(st.integers(1, 40))]
            case "end":
                del data[at:]
            case "insert":
                data[at:at] = draw(st.binary(min_size=1, max_size=20))
            case "digit":
                data[at:at] = draw(st.sampled_from([b"0", b"9", b" ", b"\n", b"-"]))
    return bytes(data)


@settings(
    max_examples=400,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=damaged())
@example(data=SEEDS[0])
@example(data=SEEDS[1])
@example(data=SEEDS[2])
@example(data=SEEDS[3])
def test_a_damaged_file_gives_a_valid_model_or_one_clear_error(tmp_path, data):
    path = write(tmp_path, data)
    try:
        splats = read_ply(path)
    except DataError as error:
        assert "\n" not in str(error)
        return
    arrays = [getattr(splats, name) for name in Splats.__dataclass_fields__]
    assert all(np.isfinite(a).all() for a in arrays)
    assert sum(a.nbytes for a in arrays) <= 8 * len(data)
    assert all(a.dtype in (np.float32, np.uint32) for a in arrays)
