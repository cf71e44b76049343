"""Readers of foreign files: a valid object or one line that names the file, whatever the file holds.

``python -m tests.fuzz`` does by the ten thousands what this file does by the hundreds.
"""

import ast
import io
import json
import random
import re
import resource
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import psutil
import pytest
from fuzz_targets import BY_A_LIBRARY, RUN, Target, array_seeds, image_seeds, make_targets
from hypothesis import given, settings
from hypothesis import strategies as st
from mi_dogsplat.support.errors import DataError
from mutations import mutate
from PIL import Image

pytestmark = pytest.mark.filterwarnings("ignore:::PIL")  # it says what is wrong with a file, and reads it or not

PACKAGE = Path(__file__).parents[2] / "mi_dogsplat"
TARGETS = make_targets()
READ_BY_US = [name for name in TARGETS if f".{name}" not in BY_A_LIBRARY]
QUICK = sorted(set(READ_BY_US) - {"transforms", "colmap_dataset", "run_history"})


def refusal(target: Target, data: bytes) -> str:
    """The one line that the reader answers to a file."""
    assert target.check(data) == "refused"
    with pytest.raises(DataError) as caught:
        target.read(target.folder / target.name)
    return str(caught.value)


@pytest.mark.parametrize("name", TARGETS)
def test_the_files_that_are_damaged_here_are_good_ones(name):
    target = TARGETS[name]
    assert [target.check(seed) for seed in target.seeds] == ["read"] * len(target.seeds)


@pytest.mark.parametrize("name", READ_BY_US)
def test_a_damaged_file_is_read_or_refused_in_one_line(name):
    target, chance = TARGETS[name], random.Random(0)
    outcomes = {target.check(mutate(target.seeds, chance)) for _ in range(300 if name in QUICK else 60)}
    assert "refused" in outcomes or name == "run_history"  # what is torn there is left out


@pytest.mark.parametrize("name", QUICK)
@settings(max_examples=50, deadline=None)
@given(
    which=st.integers(0, 99),
    cut=st.none() | st.floats(0, 1),
    edits=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 8), st.binary(max_size=9)), max_size=4),
)
def test_bytes_that_are_changed_anywhere_are_read_or_refused_in_one_line(name, which, cut, edits):
    """As above, but what fails is shrunk to the least damage that does it."""
    target = TARGETS[name]
    data = target.seeds[which % len(target.seeds)]
    for place, removed, new in edits:
        at = int(place * len(data))
        data = data[:at] + new + data[at + removed :]
    target.check(data if cut is None else data[: int(cut * len(data))])


@settings(max_examples=100, deadline=None)
@given(st.text(), st.text(), st.text())
def test_what_an_error_quotes_cannot_break_the_line_or_reach_the_terminal(path, problem, remedy):
    message = str(DataError(path.replace("\0", ""), problem, remedy))
    assert message.isprintable() and message.encode() and len(message) < 1300 + 10 * len(remedy)


# --- what fuzzing found, each once ---

CAMERA = {"w2c": np.eye(4).tolist(), "fx": 500, "width": 640, "height": 480}
HUGE = [[1e308, 0, 0, 0], [0, 1e308, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
POINT = "1 0.5 0.5 5.0 200 100 50 0.1 1 0"
IMAGE = "1 1.0 0 0 0 0.1 0 0 7 a.png\n"


def array_header(old: str, new: str) -> str:
    return array_seeds()[0].decode("latin1").replace(old, new)


def array_of_colors(color: str) -> str:
    columns = "".join(f"property double {name}\n" for name in ("x", "y", "z", "red", "green", "blue"))
    return f"ply\nformat ascii 1.0\nelement vertex 1\n{columns}end_header\n1 2 3 {color} 0 0\n"


@pytest.mark.parametrize(
    ("target", "content", "words"),
    [
        ("colmap_points3D_txt", POINT.replace("1 ", f"{2**63} ", 1), "the id of a point"),
        ("colmap_points3D_txt", POINT.replace("0.5", "1e300"), "a point is not finite"),
        ("colmap_points3D_txt", POINT.replace("200", "300"), "line 1 cannot be read"),
        ("colmap_images_txt", IMAGE.replace("1.0", "1e308"), "no valid pose"),
        ("colmap_images_txt", IMAGE + "3.0 4.0 nan", "line 2 cannot be read"),
        ("colmap_cameras_txt", f"7 PINHOLE {10**30} 15 20 20 10 7", "camera 7 is 1000000000"),
        ("camera", json.dumps(CAMERA | {"w2c": HUGE}), "not a rotation"),
        ("camera", "[" * 100_000, "too deep"),
        ("camera", '{"w2c": ' + "1" * 5000 + "}", "not usable as JSON"),
        ("camera", '{"w2c": "\\ud800"}', "not usable as JSON"),
        ("camera_list", json.dumps([CAMERA | {"w2c": HUGE}]), "camera 0: .*not a rotation"),
        ("capture", "[]", "is not a JSON object"),
        ("transforms", '{"frames": [1], "test_filenames": 1.5}', "frame 0 lacks"),
        ("run_metrics", '{"test": 3}', '"test" is not what a run writes'),
        ("run_metrics", '{"views": {"a": 3}}', '"views.a" is not what a run writes'),
        ("run_dog_profile", '{"with_dog": {"error": [0.1, "x"]}}', '"with_dog.error" is not what a run writes'),
        ("point_ply", array_of_colors("1e300"), "a colour has no valid value"),
        ("checkpoint_array", array_header("(12,), }", "(10000000000000,), }"), "not a readable checkpoint"),
        ("checkpoint_array", array_header("<f4", "|O8"), "not a readable checkpoint"),
        ("checkpoint_array", array_header("<f4", "<i0"), "not a readable checkpoint"),
    ],
)
def test_a_file_that_was_once_a_traceback_is_one_line(target, content, words):
    message = refusal(TARGETS[target], content.encode("latin1"))
    assert re.search(words, message), message
    assert message.count(str(TARGETS[target].folder)) == 1


def test_an_image_name_that_no_file_system_holds_is_too_long():
    target = TARGETS["colmap_dataset"]
    message = refusal(target, target.seeds[0].replace(b"img_00.png", b"i" * 5000))
    assert "has a name of 5000 bytes, too long for those of its pictures; shorten the name of the image" in message


def test_a_lens_that_nothing_passes_is_one_line():
    target = TARGETS["transforms"]
    content = json.loads(target.seeds[2])
    assert "no lens has" in refusal(target, json.dumps(content | {"k1": 1e308}).encode())
    assert "leaves no pinhole image" in refusal(target, json.dumps(content | {"cx": 1e308}).encode())


def test_a_history_with_numbers_that_nobody_measures_is_drawn_without_them():
    rows = RUN["history.jsonl"].decode().splitlines()
    rows += ['{"step": 1' + "0" * 400 + ', "l1": 1e-320}', '{"step": -1e308, "seconds": 1e308, "l1": 1e307}']
    rows += ['{"step": -1e20, "n": 1e300}', '{"step": 90, "l']
    assert TARGETS["run_history"].check("\n".join(rows).encode()) == "read"


def test_profiles_of_two_lengths_are_compared_where_both_are():
    content = json.loads(RUN["test/dog_profile.json"])
    content["with_dog"]["error"].pop()
    assert TARGETS["run_dog_profile"].check(json.dumps(content).encode()) == "read"


def test_a_checkpoint_is_never_unpacked_or_unpickled(tmp_path):
    target = TARGETS["checkpoint"]
    for save, values in ((np.savez_compressed, np.zeros(10**6)), (np.savez, np.array([{"a": 1}], dtype=object))):
        file = io.BytesIO()
        save(file, step=values)
        assert "not a readable checkpoint" in refusal(target, file.getvalue())


# --- memory ---


def png_header(width: int, height: int) -> bytes:
    """A PNG that promises so many pixels and holds none."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("target", "content"),
    [
        ("image", png_header(9000, 9000)),
        ("ply", b"ply\nformat binary_big_endian 1.0\nelement vertex 99999999999\nproperty int x\nend_header\n1234"),
        ("point_ply", b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty int x\nend_header\n1 2 3 4"),
        ("colmap_points3D_bin", struct.pack("<Q", 2**60)),
        ("colmap_images_bin", struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 0, 7) + b"a\0" + b"\xff" * 8),
        ("colmap_cameras_bin", struct.pack("<Q", 2**62)),
    ],
)
def test_a_header_that_promises_too_much_costs_no_memory(target, content):
    """The address space may grow by 64 MiB; what is promised are 250 MB and more."""
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + (64 << 20), limits[1]))
    try:
        assert TARGETS[target].check(content) == "refused"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


# --- files that are not what their names say ---


FORMATS = ["ply", "point_ply", "camera", "transforms", "checkpoint", "colmap_images_bin", "image"]


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_that_is_something_else_is_refused(name):
    others = [b"", b"\1" * 100, b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", b"\x7fELF" + b"\1" * 99]
    others += [b"{}", b"ply\n"]
    others += [b"<html>not found</html>", b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 5\n"]
    others += [image_seeds()[0]] if name != "image" else []
    for content in others:
        refusal(TARGETS[name], content)


def test_a_jpeg_that_is_called_png_is_an_image_all_the_same():
    file = io.BytesIO()
    Image.new("RGB", (5, 4), (9, 9, 9)).save(file, "JPEG")
    assert TARGETS["image"].check(file.getvalue()) == "read"


# --- nothing that reads a file can run what is in it ---

FORBIDDEN = {"pickle", "dill", "marshal", "shelve", "torch", "yaml", "np.load", "allow_pickle", "eval", "exec"}


def test_no_code_comes_out_of_files():
    """No pickle, no eval, no np.load (which has both inside) in the whole package."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {alias.name.split(".")[0] for alias in node.names} if isinstance(node, ast.Import) else set()
            if isinstance(node, ast.ImportFrom) and not node.level:
                names.add((node.module or "").split(".")[0])
            if isinstance(node, ast.Call):
                names.add(ast.unparse(node.func))
                names |= {str(word.arg) for word in node.keywords}
            found = names & FORBIDDEN
            assert not found, f"{path.relative_to(PACKAGE)}:{getattr(node, 'lineno', 0)}: {found}"


def test_the_members_of_a_checkpoint_are_stored_as_they_are():
    """What the reader insists on is what the writer does."""
    with zipfile.ZipFile(io.BytesIO(TARGETS["checkpoint"].seeds[0])) as archive:
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}
