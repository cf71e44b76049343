"""Files that are no model, damaged, or claim more than they hold, and models that cannot be written: one line each."""

import errno
import gzip
import io
import json
import os
import struct
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import Splats, read_model, write_model
from mi_dogsplat.datasets.point_ply import write_point_ply
from mi_dogsplat.formats.read import read_source
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.support.errors import DataError
from PIL import Image
from ply_files import random_splats
from written_models import written


def test_what_is_no_model_is_refused_in_one_line_that_says_what_to_do(tmp_path):
    files = {"empty.ply": b"", "notes.txt": b"hello there", "short.splat": b"x" * 33, "a.spz": b"something else",
             "a.sog": b"PK\x03\x04 but no more", "a.glb": b"glTF\x02\0\0\0", "a.gltf": b"{}", "meta.json": b"[]",
             "b.sog": b"{}", "deep.gltf": b'{"asset":' * 3000}  # fmt: skip
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    for path in (*(tmp_path / name for name in files), tmp_path, tmp_path / "missing.spz"):
        with pytest.raises(DataError, match=path.name) as caught:
            read_model(path)
        assert "; " in str(caught.value) and len(str(caught.value).splitlines()) == 1
    for name in ("a.obj", "a"):
        with pytest.raises(DataError, match=r"\.spz.*\.splat"):
            write_model(tmp_path / name, foreign_model.model())
    with pytest.raises(DataError, match="cannot be written"):
        write_model(tmp_path / "no folder" / "a.spz", foreign_model.model())


def test_where_nothing_can_be_written_is_said_before_anything_is_made_of_a_model(tmp_path, monkeypatch):
    def read_only(**_):
        raise OSError(errno.EROFS, "Read-only file system")

    model = written(tmp_path / "model.ply", foreign_model.model())
    read_source(model, tmp_path / "small.ply", "simplify")
    with pytest.raises(DataError, match=r"small.ply: cannot be written \(there is no such folder\)"):
        read_source(model, tmp_path / "no folder" / "small.ply", "simplify")
    monkeypatch.setattr("mi_dogsplat.support.files.TemporaryFile", read_only)
    with pytest.raises(DataError, match=r"small.ply: cannot be written \(Read-only file system\)"):
        read_source(model, tmp_path / "small.ply", "simplify")
    assert list(tmp_path.iterdir()) == [model]


@pytest.mark.skipif(os.name != "posix", reason="other systems may not let their user make links")
def test_where_the_link_that_is_to_be_written_leads_is_looked_at_before_anything_is_made_of_a_model(tmp_path):
    model = written(tmp_path / "model.ply", foreign_model.model())
    (tmp_path / "small.ply").symlink_to(tmp_path / "unmounted" / "small.ply")
    with pytest.raises(DataError, match=r"small.ply: cannot be written \(leads into .*unmounted, which is no folder\)"):
        read_source(model, tmp_path / "small.ply", "simplify")
    (tmp_path / "itself.ply").symlink_to("model.ply")
    with pytest.raises(DataError, match="itself.ply: is the model itself"):
        read_source(model, tmp_path / "itself.ply", "simplify")


@pytest.mark.parametrize("part", ["scales", "sh0", "shN"])
def test_a_first_value_of_a_sog_that_is_null_is_a_step_below_the_second(tmp_path, part):
    """As PlayCanvas takes it; JSON has no -∞."""
    model = _replace_in_sog(tmp_path, "", b"")
    with zipfile.ZipFile(model) as bundle:
        files = {name: bundle.read(name) for name in bundle.namelist()}
    meta = json.loads(files["meta.json"])
    table = meta[part]["codebook"] = np.linspace(-3, 0.5, 256).tolist()
    for first in (table[1] - (table[255] - table[1]) / 255, None):
        table[0] = first
        with zipfile.ZipFile(tmp_path / f"{first is None}.sog", "w") as bundle:
            for name, content in files.items():
                bundle.writestr(name, json.dumps(meta) if name == "meta.json" else content)
    found, wanted = (read_model(tmp_path / f"{null}.sog").splats for null in (True, False))
    for name in ("log_scales", "sh_coeffs"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name)), name


def test_what_is_no_bundle_of_a_sog_says_so_in_words(tmp_path):
    np.savez(tmp_path / "state.npz", a=np.zeros(3))
    with pytest.raises(DataError, match="is a ZIP file without meta.json"):
        read_model(tmp_path / "state.npz")
    whole = written(tmp_path / "a.sog", foreign_model.model()).read_bytes()
    (tmp_path / "cut.sog").write_bytes(whole[:-30])
    with pytest.raises(DataError, match="it is not a ZIP file, or only a part of one; the file is damaged"):
        read_model(tmp_path / "cut.sog")


def test_a_small_file_cannot_claim_much_memory(tmp_path):
    header = struct.pack("<IIIBBBB", 0x5053474E, 3, 40_000_000, 3, 12, 0, 0)
    (tmp_path / "bomb.spz").write_bytes(gzip.compress(header + bytes(1000)))
    streams = struct.pack("<IIIBBBBI12x", 0x5053474E, 4, 2**32 - 1, 3, 12, 0, 6, 32) + struct.pack("<QQ", 9, 9) * 6
    (tmp_path / "bomb4.spz").write_bytes(streams + bytes(60))
    with zipfile.ZipFile(tmp_path / "bomb.sog", "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("meta.json", b" " * 20_000_000 + b"{}")
    for name in ("bomb.spz", "bomb4.spz", "bomb.sog"):
        with pytest.raises(DataError, match=f"{name}.*which no model compresses to"):
            read_model(tmp_path / name)


@pytest.mark.parametrize("side", [9_600, 20_000])  # beyond what Pillow warns of, and what it refuses by itself
def test_a_picture_of_a_sog_cannot_claim_much_memory(tmp_path, side):
    header = struct.pack(">IIBBBBB", side, side, 8, 6, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    packed = [struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
              for kind, data in chunks]  # fmt: skip
    _replace_in_sog(tmp_path, "means_l.webp", b"\x89PNG\r\n\x1a\n" + b"".join(packed))
    with pytest.raises(DataError, match="a.sog"):
        read_model(tmp_path / "a.sog")


def test_a_member_of_a_sog_is_no_larger_than_the_file(tmp_path):
    """By its directory, where the size of a member stands 20 bytes behind the signature."""
    model = _replace_in_sog(tmp_path, "", b"")
    data = bytearray(model.read_bytes())
    at = data.index(b"PK\x01\x02") + 20
    data[at : at + 8] = struct.pack("<II", 2**31, 2**31)
    model.write_bytes(data)
    with pytest.raises(DataError, match="claims 2147483648 bytes of a file of"):
        read_model(model)


def test_many_primitives_of_few_colours_cannot_either(tmp_path):
    """Pictures of one colour are bytes, whatever their size."""
    side = 1000
    one = io.BytesIO()
    Image.new("RGBA", (side, side), (128, 128, 128, 255)).save(one, "WEBP", lossless=True)
    model = _replace_in_sog(tmp_path, "", b"")
    with zipfile.ZipFile(model) as bundle:
        meta = json.loads(bundle.read("meta.json")) | {"count": side * side}
        names = [name for name in bundle.namelist() if name.endswith(".webp")]
    with zipfile.ZipFile(model, "w") as bundle:
        bundle.writestr("meta.json", json.dumps(meta))
        for name in names:
            bundle.writestr(name, one.getvalue())
    with pytest.raises(DataError, match="which no model compresses to"):
        read_model(model)


@pytest.mark.parametrize("suffix", [".sog", ".spz"])
def test_a_model_that_compresses_to_almost_nothing_is_read_again(tmp_path, suffix):
    """As that of a regular grid of points is."""
    model = foreign_model.model().uniform_sh(3).select(np.zeros(70_000, int))
    assert read_model(written(tmp_path / f"a{suffix}", model)).splats.n_splats == 70_000


def _replace_in_sog(folder: Path, name: str, content: bytes) -> Path:
    """A SOG with another content under one of its names."""
    path = written(folder / "a.sog", foreign_model.model())
    with zipfile.ZipFile(path) as bundle:
        files = {member: bundle.read(member) for member in bundle.namelist()}
    with zipfile.ZipFile(path, "w") as bundle:
        for member, data in files.items():
            bundle.writestr(member, content if member == name else data)
    return path


def test_values_that_are_not_finite_are_refused_with_their_place(tmp_path):
    path = written(tmp_path / "a.splat", foreign_model.model())
    data = bytearray(path.read_bytes())
    data[32 * 3 : 32 * 3 + 4] = struct.pack("<f", np.nan)
    path.write_bytes(data)
    with pytest.raises(DataError, match="means that are not finite: 1, the first in primitive 3"):
        read_model(path)


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_model_with_a_position_that_is_none_is_not_written(tmp_path, suffix):
    path = written(tmp_path / f"a{suffix}", foreign_model.model())
    before, broken = path.read_bytes(), foreign_model.model()
    broken.means[7] = np.nan
    with pytest.raises(DataError, match="values.* are not finite: 3, the first .* 7.*; nothing was written; "):
        write_model(path, broken)
    assert path.read_bytes() == before


def test_of_rows_that_are_not_finite_the_primitive_is_named(tmp_path):
    values = np.zeros((3, 3, 3))
    values[1, 2, 0], values[2] = np.nan, np.inf
    slopes = {"slope_index": [2, 5, 7], "color_slopes": values}
    with pytest.raises(DataError, match="has values of color_slopes that are not finite: 10, the first in primitive 5"):
        write_model(tmp_path / "a.compressed.ply", replace(foreign_model.model(), **slopes))


@pytest.mark.parametrize("suffix", FORMATS)
def test_scales_beyond_float32_are_the_largest_that_a_file_can_say(tmp_path, suffix):
    model = foreign_model.model()
    model.log_scales[3] = 200
    back = read_model(written(tmp_path / f"a{suffix}", model)).splats
    assert np.isfinite(back.log_scales).all() and back.log_scales.max() >= 5.9


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("degree", [0, 3])
def test_no_primitives_are_written_and_read_or_refused_by_name(tmp_path, suffix, degree):
    if suffix in (".glb", ".gltf"):
        with pytest.raises(DataError, match="glTF cannot hold a model without primitives; "):
            write_model(tmp_path / f"a{suffix}", Splats.empty(degree))
        return
    assert read_model(written(tmp_path / f"a{suffix}", Splats.empty(degree))).splats.n_splats == 0


def test_a_gltf_names_what_it_lacks(tmp_path):
    path = written(tmp_path / "a.gltf", foreign_model.model())
    content = json.loads(path.read_text())
    without = json.loads(path.read_text())
    del without["meshes"][0]["primitives"][0]["extensions"]
    path.write_text(json.dumps(without))
    with pytest.raises(DataError, match="holds no primitive with KHR_gaussian_splatting"):
        read_model(path)
    for uri, words in (("https://example.org/a.bin", "not a file beside it"), ("../a.bin", "not a file beside it"),
                       ("a.bin", "cannot be read")):  # fmt: skip
        content["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(content))
        with pytest.raises(DataError, match=words):
            read_model(path)


def test_for_a_folder_the_model_in_it_is_named(tmp_path):
    with pytest.raises(DataError, match="this is a folder; give the path of a model"):
        read_model(tmp_path)
    (tmp_path / "a.ply").mkdir()
    write_point_ply(tmp_path / "points.ply", np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(DataError, match="this is a folder; give the path of a model"):
        read_model(tmp_path)
    model = written(tmp_path / "point_cloud.ply", random_splats())
    with pytest.raises(DataError, match=f"this is a folder; give the model in it: {model}"):
        read_model(tmp_path)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["transforms.json", "points.ply"], "is a data set, but a model is needed; .*RUN/point_cloud.ply"),
        (["sparse", "images"], "is a data set"),
        (["config.json", "history.jsonl", "checkpoint"], "is a run that has no model yet; let it end .*dogsplat view"),
    ],
)
def test_for_a_folder_without_a_model_it_is_said_what_it_is(tmp_path, names, said):
    for name in names:
        path = tmp_path / name
        path.write_text("ply\nelement vertex 0\nend_header\n") if "." in name else path.mkdir()
    with pytest.raises(DataError, match=said) as caught:
        read_model(tmp_path)
    assert "\n" not in str(caught.value)
