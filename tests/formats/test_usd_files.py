"""Files of OpenUSD that are damaged, called something else, written anew, or cannot be written; and no library."""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

import os
import resource
import struct
import zipfile

import numpy as np
import pytest
from mi_dogsplat import Model, read_model, write_model
from mi_dogsplat.formats import usd_author
from mi_dogsplat.formats.read import size_of
from mi_dogsplat.support.errors import DataError
from pxr import Usd, UsdGeom
from usd_stages import MODEL, a_stage, assert_same, read_saved, referencing, written


@pytest.fixture
def file(tmp_path):
    return written(tmp_path)


@pytest.fixture
def stage(file):
    return Usd.Stage.Open(str(file))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('upAxis = "Y"', 'upAxis = "X"', "its upAxis is X, neither Y nor Z"),
        ("metersPerUnit = 1", "metersPerUnit = 0", "its metersPerUnit is 0, not above zero and finite"),
        (
            "point3f[] positions = [",
            "float[] positions = [1, 2]\nfloat3[] other = [",
            "positions has no rows of 3 numbers",
        ),
    ],
)
def test_what_makes_no_sense_is_one_line(file, old, new, said):
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(DataError, match=f"a.usda: .*{said}"):
        read_model(file)


def test_a_stage_without_gaussians_says_what_it_lacks_and_why(tmp_path, file):
    stage = a_stage(tmp_path / "set.usda")
    UsdGeom.Sphere.Define(stage, "/Ball")
    with pytest.raises(DataError, match="set.usda: holds no prim ParticleField3DGaussianSplat that is shown; export"):
        read_saved(stage)
    place = referencing(stage, "/Set", file)
    place.MakeInvisible()
    with pytest.raises(DataError, match=r"that is shown \(1 prim not shown\); export"):
        read_saved(stage)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_files_that_end_early_are_one_line(tmp_path, suffix, capfd):
    path = tmp_path / f"a{suffix}"
    write_model(path, Model(MODEL))
    data = path.read_bytes()
    for size in (12, 100, len(data) // 2, len(data) - 20):
        path.write_bytes(data[:size])
        with pytest.raises(DataError, match=f"a{suffix}: (cannot be read|is no).*the file is damaged"):
            read_model(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("place", [b"Splats", b"positions", b"upAxis"])
def test_text_that_is_none_is_one_line(tmp_path, file, place):
    file.write_bytes(file.read_bytes().replace(place, b"\xff\xfe" + place))
    with pytest.raises(DataError, match="a.usda: .*the file is damaged"):
        read_model(file)


def test_a_path_that_the_library_cannot_be_told_is_one_line(tmp_path, file):
    folder = tmp_path / os.fsdecode(b"\xff")
    folder.mkdir()
    line = "its path is not UTF-8, which OpenUSD needs; rename it"
    with pytest.raises(DataError, match=line):
        read_model(file.rename(folder / file.name))
    for suffix in (".usdc", ".usdz"):
        with pytest.raises(DataError, match=line):
            write_model(folder / f"b{suffix}", Model(MODEL))
    assert os.listdir(folder) == [file.name]


def crate_of(path) -> tuple[bytearray, dict[str, int]]:
    """The bytes of a binary file, and where its sections begin."""
    data = bytearray(path.read_bytes())
    (table,) = struct.unpack_from("<q", data, 16)
    (n,) = struct.unpack_from("<Q", data, table)
    rows = [struct.unpack_from("<16sqq", data, table + 8 + 32 * k) for k in range(n)]
    return data, {name.rstrip(b"\0").decode(): start for name, start, _ in rows} | {"TABLE": table}


@pytest.mark.parametrize("suffix", [".usdc", ".usdz"])
@pytest.mark.parametrize("section", ["TOKENS", "FIELDS", "FIELDSETS", "PATHS", "SPECS"])
def test_counts_out_of_proportion_are_refused_before_the_library_believes_them(tmp_path, section, suffix):
    """One byte of these took the library minutes and gigabytes."""
    write_model(tmp_path / "a.usdc", Model(MODEL))
    write_model(tmp_path / f"b{suffix}", Model(MODEL))
    data, starts = crate_of(tmp_path / "a.usdc")
    raw = bytearray((tmp_path / f"b{suffix}").read_bytes())
    first = raw.index(data[:24])  # of the binary file in the package
    raw[first + starts[section] + 3] = 0xFF  # the fourth byte of the count: 4 thousand million
    (tmp_path / f"b{suffix}").write_bytes(raw)
    with pytest.raises(DataError, match="claim to unpack to .*the file is damaged"):
        read_model(tmp_path / f"b{suffix}")


def test_lists_and_sections_that_end_outside_of_the_file_are_refused(tmp_path):
    write_model(tmp_path / "a.usdc", Model(MODEL))
    data, starts = crate_of(tmp_path / "a.usdc")
    for at, said in (
        (starts["SPECS"] + 8, "a list of its section SPECS is longer than that"),
        (starts["TABLE"] + 8 + 16, "its section TOKENS is at bytes"),
        (16, "it names byte"),
        (starts["TABLE"], "sections"),
    ):
        broken = bytearray(data)
        broken[at : at + 8] = (1 << 40).to_bytes(8, "little")
        (tmp_path / "b.usdc").write_bytes(broken)
        with pytest.raises(DataError, match=f"b.usdc: is not a binary OpenUSD file .*{said}"):
            read_model(tmp_path / "b.usdc")


def test_a_package_whose_files_are_compressed_is_refused(tmp_path):
    write_model(tmp_path / "a.usdc", Model(MODEL))
    with zipfile.ZipFile(tmp_path / "a.usdz", "w", zipfile.ZIP_DEFLATED) as package:
        package.write(tmp_path / "a.usdc", "a.usdc")
    with pytest.raises(DataError, match="a.usdz: is not an OpenUSD package .*compressed"):
        read_model(tmp_path / "a.usdz")


def test_a_name_that_says_something_else_is_no_obstacle(tmp_path, capfd):
    for suffix in (".usda", ".usdc", ".usdz"):
        write_model(tmp_path / f"a{suffix}", Model(MODEL))
        for name in ("b.usda", "b.usdc", "b.usdz", "b.glb"):
            (tmp_path / name).write_bytes((tmp_path / f"a{suffix}").read_bytes())
            assert_same(read_model(tmp_path / name).splats, MODEL)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["ä b.usda", "a[1].usdc", "a.b@c.usdz", "%04d:SDF_FORMAT_ARGS:x=1.usdc"])
def test_names_are_only_names(tmp_path, name):
    write_model(tmp_path / name, Model(MODEL))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert_same(read_model(tmp_path / name).splats, MODEL)


def test_names_of_folders_are_only_names(tmp_path, monkeypatch):
    folder = tmp_path / "a.usdz[b]:SDF_FORMAT_ARGS:x=1"
    folder.mkdir()
    monkeypatch.chdir(folder)
    write_model("a.usdc", Model(MODEL))
    assert_same(read_model("a.usdc").splats, MODEL)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_a_file_that_is_written_anew_is_read_anew_while_others_have_it_open(tmp_path, suffix):
    """The library keeps layers by their names; a notebook keeps the stage of an error."""
    stages = []
    for k in (1, 2):
        write_model(tmp_path / f"a{suffix}", Model(MODEL.select(np.arange(k))))
        os.utime(tmp_path / f"a{suffix}", (k, k))  # file systems tell times apart that differ by some ms
        assert read_model(tmp_path / f"a{suffix}").splats.n_splats == k
        stages.append(Usd.Stage.Open(str(tmp_path / f"a{suffix}")))


def test_a_stage_that_its_user_has_not_saved_keeps_what_is_new(stage):
    stage.DefinePrim("/New")
    assert read_model(stage.GetRootLayer().realPath).splats.n_splats == MODEL.n_splats
    assert stage.GetPrimAtPath("/New")


def test_a_file_is_not_beside_itself_where_its_folder_is_a_link(tmp_path, file):
    (tmp_path / "link").symlink_to(tmp_path)
    assert size_of(tmp_path / "link" / "a.usda") == file.stat().st_size


def test_without_the_library_nothing_is_written_and_one_line_says_what_to_install(tmp_path, file, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pxr", None)
    needed = r"OpenUSD needs the package usd-core; pip install 'mi_dogsplat\[usd\]'"
    with pytest.raises(DataError, match=f"b.usdz: {needed}"):
        write_model(tmp_path / "b.usdz", Model(MODEL))
    with pytest.raises(DataError, match=f"a.usda: {needed}"):
        read_model(file)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usda"]


def test_a_folder_that_is_missing_or_full_keeps_what_was_there(tmp_path, file, monkeypatch):
    with pytest.raises(DataError, match="no/a.usdc: cannot be written"):
        write_model(tmp_path / "no" / "a.usdc", Model(MODEL))
    held = file.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(usd_author.shutil, "move", full)
    with pytest.raises(DataError, match="a.usda: .*No space left"):
        write_model(file, Model(MODEL.select(np.arange(3))))
    assert file.read_bytes() == held and [path.name for path in tmp_path.iterdir()] == ["a.usda"]


@pytest.mark.parametrize(("suffix", "more"), [(".usda", 0), (".usdc", -50), (".usdz", -50), (".usdz", 50)])
def test_what_the_library_cannot_write_is_one_line(tmp_path, capfd, suffix, more):
    """As where a disk is full; at the end the package, and not what lies in it."""
    write_model(tmp_path / "a.usdc", Model(MODEL))
    most = (tmp_path / "a.usdc").stat().st_size + more
    limits_before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits_before[1]))
    try:
        with pytest.raises(DataError, match=f"b{suffix}: cannot be written .*(too large|not complete)"):
            write_model(tmp_path / f"b{suffix}", Model(MODEL))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits_before)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usdc"] and capfd.readouterr() == ("", "")
