"""Files: the add-on reads what the package reads, as the same numbers, and refuses what the package refuses."""

import gzip
import struct

import numpy as np
import ply_files
import pytest
from addon_models import as_model
from mi_dogsplat import read_model
from mi_dogsplat.support.errors import DataError
from ply_files import random_splats, to_bytes, vertex_columns

N, COMMENT = 7, b"comment made by a test"
SPLATS = random_splats(N)
VERTEX, DOG = vertex_columns(SPLATS), {"index": SPLATS.dog_index} | ply_files.dog_columns(SPLATS)
BARE = {name: values for name, values in VERTEX.items() if not name.startswith("f_rest_")}
ALL_DOG = VERTEX | ply_files.dog_columns(random_splats(N, dog_index=range(N)))
FLAT = VERTEX | {"scale_1": np.array([-np.inf, *SPLATS.log_scales[1:, 1]])}
WIDTHS = {"filter_3D": np.array([0, 1e-3, 0.1, 0.5, 1, 3, 1e-30])}
SPZ = struct.Struct("<IIIBBBB")


def ply(vertex=VERTEX, dog=DOG, file_format="binary_little_endian", index="uint", **more) -> bytes:
    return to_bytes({"vertex": vertex, "dog": dog, **more}, file_format, {"index": index})


def saying(*lines: str) -> bytes:
    """A PLY with these lines in its header."""
    return ply().replace(COMMENT, "\n".join(lines).encode())


def bands(degree: int, *index: int) -> dict[str, np.ndarray]:
    """The element of an SH degree, for these primitives."""
    names = [f"f_rest_{i}" for i in range(3 * ((degree + 1) ** 2 - 1))]
    return {"index": np.array(index)} | {name: np.arange(len(index)) + i for i, name in enumerate(names)}


def spz(version=3, n=50, degree=3, magic=0x5053474E, position=0.5) -> bytes:
    """Random bytes as a file of versions up to 3; the first ``position`` of version 1."""
    rng = np.random.default_rng(degree)
    others = 3 + 1 + 3 + (3 if version < 3 else 4) + 3 * ((degree + 1) ** 2 - 1)
    means = rng.integers(0, 256, 9 * n, np.uint8)
    if version == 1:
        means = np.array([position, *rng.normal(size=3 * n - 1)], "<f2")
    header = SPZ.pack(magic, version, n, degree, 12, 1, 0)
    return gzip.compress(header + means.tobytes() + rng.integers(0, 256, others * n, np.uint8).tobytes())


def commented(data: bytes, comment: bytes) -> bytes:
    """A gzip stream with a comment in its header."""
    return data[:3] + bytes([16]) + data[4:10] + comment + b"\0" + data[10:]


READ = {
    "scales of 0.ply": ply(FLAT),
    "scales of 0 as text.ply": ply(FLAT, file_format="ascii"),
    "scales of 0 that a filter widens.ply": ply(FLAT | WIDTHS),
    "all DoG.ply": to_bytes({"vertex": ALL_DOG}),
    "DoG in any order.ply": ply(dog=DOG | {"index": np.array([5, 0, 2])}),
    "other elements.ply": ply(after={"a": np.arange(3)}),
    "a list at the end.ply": ply().replace(
        b"end_header", b"element face 1\nproperty list uchar int vertex_indices\nend_header"
    ) + bytes([1, 0, 0, 0, 0]),
    "SH by degrees.ply": to_bytes({"vertex": BARE, "sh1": bands(1, 0, 4), "sh2": bands(2, 5)}, types={"index": "uint"}),
    "SH of degree 4.ply": to_bytes({"vertex": BARE | {f"f_rest_{i}": np.arange(N) + i for i in range(72)}}),
    "a long comment.ply": saying(f"comment {'x' * 70_000}"),
    "an empty line.ply": saying("comment a", "", "comment dogsplat scale 2"),
    "Postshot.ply": saying("comment antialiased 1"),
    "Brush.ply": saying("comment Vertical axis: X", "comment SplatRenderMode: mip"),
    "flags.ply": saying("comment dogsplat antialiased True", "comment dogsplat linear 0"),
    "a long comment.spz": commented(spz(), b"x" * 5000 + b"\ndogsplat linear true\ndogsplat white 4.0"),
    **{f"version {v}, degree {k}.spz": spz(v, degree=k) for v in (1, 2, 3) for k in range(5)},
}  # fmt: skip
REFUSED = {
    "a scale of infinity.ply": ply(VERTEX | {"scale_1": np.full(N, np.inf)}),
    "DoG twice.ply": ply(ALL_DOG),
    "DoG in part.ply": to_bytes({"vertex": VERTEX | {"dog_scale_0": np.zeros(N)}}),
    "half an index.ply": ply(dog=DOG | {"index": np.array([0, 1.5, 3])}, index="float"),
    "an index below 0.ply": ply(dog=DOG | {"index": np.array([0, -1, 3])}, index="int"),
    "an index twice.ply": ply(dog=DOG | {"index": np.array([0, 3, 3])}),
    "SH of none.ply": to_bytes({"vertex": BARE, "sh1": bands(1, 0, N)}, types={"index": "uint"}),
    "SH twice.ply": to_bytes({"vertex": BARE, "sh1": bands(1, 0, 4), "sh2": bands(2, 4)}, types={"index": "uint"}),
    "a byte too many.ply": ply() + b"x",
    "a number too many.ply": ply(file_format="ascii") + b" 3\n",
    "a header without end.ply": saying(*["comment " + "x" * 100] * 20_000),
    "version 0.spz": spz(0),
    "version 4 in gzip.spz": spz(4),
    "another magic.spz": spz(magic=7),
    "degree 5.spz": spz(degree=5),
    "a position of infinity.spz": spz(1, position=np.inf),
}


def no_package(path, out):
    raise AssertionError(f"{path} needs no package")


@pytest.mark.parametrize("name", READ)
def test_both_read_the_same(addon, tmp_path, name):
    (tmp_path / name).write_bytes(READ[name])
    expected = read_model(tmp_path / name)
    model, said = addon("files.read").read_model(tmp_path / name, no_package)
    assert (said.antialiased, said.linear, said.scale, said.white) == tuple(
        getattr(expected.drawing, field) for field in ("antialiased", "linear", "scale", "white")
    )
    assert said.up == (None if expected.drawing.up is None else addon("files.said").direction(expected.drawing.up))
    wanted = as_model(addon, expected.splats.uniform_sh())
    for field, values in vars(wanted).items():
        found = getattr(model, field)
        if field == "quats":
            values, found = (quats / np.linalg.norm(quats, axis=1, keepdims=True) for quats in (values, found))
        np.testing.assert_allclose(found, values, rtol=1e-5, atol=2e-6, err_msg=field)


@pytest.mark.parametrize("name", REFUSED)
def test_both_refuse_the_same(addon, tmp_path, name):
    (tmp_path / name).write_bytes(REFUSED[name])
    with pytest.raises(DataError):
        read_model(tmp_path / name)
    with pytest.raises(addon("files.errors").FileError) as caught:
        addon("files.read").read_model(tmp_path / name, no_package)
    line = str(caught.value)
    assert line.startswith(f"{tmp_path / name}: ") and "; " in line and "\n" not in line


def test_a_compressed_ply_is_known_behind_long_comments(addon, tmp_path):
    """It goes to the package, which makes a plain one of it."""
    packed = to_bytes({"chunk": {"min_x": np.zeros(1)}, "vertex": {"packed_position": np.zeros(1)}})
    (tmp_path / "packed.ply").write_bytes(packed.replace(COMMENT, b"comment " + b"x" * 5000))
    model, _ = addon("files.read").read_model(tmp_path / "packed.ply", lambda path, out: out.write_bytes(ply()))
    assert model.n_splats == N
