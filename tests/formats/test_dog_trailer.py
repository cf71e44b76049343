"""DoG rows behind the last element of a compressed PLY: read back within half a step, never seen by other readers."""

import re
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.formats import compressed_ply
from mi_dogsplat.formats.packing import morton_order
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.trailer import encode
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from splat_scenes import random_splats, rounded

BOUNDS_BYTES, ROW_BYTES = 24, 5
GAPS = [0, 1, 254, 255, 256, 257, 511, 512, 768, 1999]  # primitives that are DoG: steps around those of a byte


def plain_model(n: int = 2000) -> dict[str, np.ndarray]:
    return vars(rounded(random_splats(n, seed=4, degree=1, dog_share=0)).plain())


def model(index: list[int] = GAPS) -> Splats:
    rng = np.random.default_rng(1)
    rows = {"dog_logit_opacities": rng.normal(0, 3, len(index)), "dog_log_scales": rng.normal(0, 1.5, (len(index), 3))}
    return Splats(**plain_model() | rows | {"dog_index": np.array(index, np.uint32)})


def written(splats: Splats, folder: Path) -> Path:
    path = folder / "model.compressed.ply"
    path.write_bytes(compressed_ply.encode(splats))
    return path


@pytest.mark.parametrize("index", [GAPS, [0], [1999], [1020], list(range(2000)), []])
def test_rows_are_read_back_within_half_a_step(index, tmp_path):
    truth = model(index=index)
    back = compressed_ply.read(written(truth, tmp_path)).splats
    assert np.array_equal(back.dog_index, truth.dog_index)
    if len(index):
        assert np.abs(back.dog_opacities - truth.dog_opacities).max() <= 0.5001 / 256
        steps = np.ptp(truth.dog_log_scales, axis=0) / 255
        assert (np.abs(back.dog_log_scales - truth.dog_log_scales).max(axis=0) <= 0.501 * steps + 1e-6).all()
    plain = compressed_ply.read(written(truth.plain(), tmp_path)).splats
    assert all(np.array_equal(getattr(back, name), getattr(plain, name)) for name in ("means", "quats", "sh_coeffs"))


def test_rows_by_hand():
    rows = {"dog_index": np.array([2, 258, 599]), "dog_logit_opacities": np.array([-50, 0, 50])}
    rows["dog_log_scales"] = np.array([[0, -1, 2], [1, -1, 1.2], [0.5, -1, 0]])
    comments, trailer = encode(Splats(**plain_model(600) | rows))
    assert comments == ["dogsplat dog 1 5"]
    assert struct.unpack_from("<6f", trailer) == (0, -1, 0, 1, -1, 2)
    rows = np.frombuffer(trailer, np.uint8, offset=BOUNDS_BYTES).reshape(5, ROW_BYTES)
    assert rows[0].tolist() == [2, 0, 0, 0, 255]
    assert rows[1, 0] == 255 and rows[2].tolist() == [0, 128, 255, 0, 153]  # 255 plain ones lie between 2 and 258
    assert rows[3, 0] == 255 and rows[4].tolist() == [85, 255, 128, 0, 0]


def test_a_row_takes_five_bytes_and_a_plain_model_none():
    every_second = model(index=list(range(0, 2000, 2)))
    added = len(compressed_ply.encode(every_second)) - len(compressed_ply.encode(every_second.plain()))
    assert added == BOUNDS_BYTES + 5 * 1000 + len("comment dogsplat dog 1 1000\n")
    assert b"dogsplat" not in compressed_ply.encode(every_second.plain())


def test_the_model_goes_through_files_by_name_in_an_order_of_neighbours(tmp_path):
    truth = model()
    write_model(tmp_path / "a.compressed.ply", truth)
    back = read_model(tmp_path / "a.compressed.ply").splats
    assert np.array_equal(back.dog_index, truth.select(morton_order(truth.means)).dog_index)
    write_model(tmp_path / "b.ply", back)
    assert np.array_equal(read_model(tmp_path / "b.ply").splats.dog_log_scales, back.dog_log_scales)


def damaged(old: bytes, new: bytes, content: bytes) -> bytes:
    assert content.count(old) == 1
    return content.replace(old, new)


@pytest.mark.parametrize(
    "damage, complaint",
    [
        (lambda b: damaged(b"dogsplat dog 1 ", b"dogsplat dog 2 ", b), "of version 2, known is 1"),
        (
            lambda b: damaged(b"dogsplat dog 1 ", b"dogsplat fog 1 ", b),
            "bytes follow the last element; 0 DoG rows are 0",
        ),
        (lambda b: damaged(b"dogsplat dog 1 ", b"dogsplat dog 1 9", b), "bytes follow the last element"),
        (lambda b: b[:-1], "bytes follow the last element"),
        (lambda b: b + b"x", "bytes follow the last element"),
        (lambda b: re.sub(rb"dogsplat dog 1 \d+", b"dogsplat dog 1 " + b"9" * 18, b), "bytes follow the last element"),
        (lambda b: b[:-ROW_BYTES] + b"\xfe" + b[-ROW_BYTES + 1 :], "but the model has 2000 (0 to 1999)"),
    ],
)
def test_damage_is_told_in_one_line(damage, complaint, tmp_path):
    path = written(model(), tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(DataError) as error:
        read_model(path)
    assert complaint in str(error.value) and len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("bounds", [(np.nan,) * 6, (0, 0, 0, 0, 0, np.inf), (1, 0, 0, 0, 0, 0), (0, 0, 0, 50, 0, 0)])
def test_bounds_that_make_no_sense_are_refused(bounds, tmp_path):
    path = written(model(), tmp_path)
    content = path.read_bytes()
    _, trailer = encode(model())
    path.write_bytes(content[: -len(trailer)] + struct.pack("<6f", *bounds) + trailer[BOUNDS_BYTES:])
    with pytest.raises(DataError, match="bounds of its DoG rows"):
        read_model(path)


def test_another_program_reads_the_same_primitives_with_rows_and_without(tmp_path):
    program = shutil.which("splat-transform")
    if program is None:
        pytest.skip("needs splat-transform in the PATH: npm install -g @playcanvas/splat-transform")
    found = []
    for name, splats in (("with", model()), ("without", model().plain())):
        path, table = tmp_path / f"{name}.compressed.ply", tmp_path / f"{name}.csv"
        path.write_bytes(compressed_ply.encode(splats))
        subprocess.run([program, str(path), str(table)], check=True, capture_output=True, timeout=120)
        found.append(table.read_bytes())
    assert found[0] == found[1] and found[0].count(b"\n") >= 2000
