"""A disk that fills up, and files that may not grow: COLMAP would end the process from a thread of its own, or leave
out what it cannot write, so it is not let that far."""

import re
import resource
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import pytest
from mi_dogsplat.poses import matching
from mi_dogsplat.poses.colmap_database import opened
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.output import write_model
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.support.errors import DataError

pycolmap = pytest.importorskip("pycolmap")
FULL = "its disk has 100 kB left, and up to .* are written next; make room; the same command goes on"
TOO_LARGE = r"file too large: 20 kB are allowed \(ulimit -f\), and up to .* are written next; raise that limit"


@pytest.fixture
def full(monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=10**5))


@contextmanager
def short():
    """No file may have more than 20 kB; over before pytest writes of the test, for its output may be a longer file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def database(tmp_path):
    pycolmap.Database.open(str(tmp_path / "database.db")).close()
    return tmp_path / "database.db"


def never(*_, **__):
    raise AssertionError("COLMAP writes")


@pytest.mark.slow
def test_no_features_are_sought_where_they_would_have_no_room(room, tmp_path, full, monkeypatch):
    monkeypatch.setattr("pycolmap.extract_features", never)
    with pytest.raises(DataError, match=FULL):
        find_poses(room / "pictures", tmp_path / "posed", PosesConfig(), lambda *_: None)


def test_no_pairs_are_matched_where_they_would_have_no_room(database, full, monkeypatch):
    monkeypatch.setattr("pycolmap.match_image_pairs", never)
    monkeypatch.setattr(matching, "_pairs", lambda *_: [(0, 1)])
    with pytest.raises(DataError, match=FULL):
        matching.match(pycolmap, database, False, PosesConfig(), lambda *_: None)


@pytest.mark.parametrize("written", ["features", "matches"])
def test_the_database_is_not_written_where_files_may_not_be_so_large(room, tmp_path, database, monkeypatch, written):
    monkeypatch.setattr("resource.getrlimit", lambda _: (20_000, resource.RLIM_INFINITY))
    monkeypatch.setattr("pycolmap.extract_features", never)
    monkeypatch.setattr("pycolmap.match_image_pairs", never)
    monkeypatch.setattr(matching, "_pairs", lambda *_: [(0, 1)])
    with pytest.raises(DataError, match=f"database.db: {TOO_LARGE}; the same command goes on"):
        if written == "features":
            find_poses(room / "pictures", tmp_path / "posed", PosesConfig(), lambda *_: None)
        else:
            matching.match(pycolmap, database, False, PosesConfig(), lambda *_: None)


def test_a_database_that_may_not_be_written_is_not_said_to_be_broken(database):
    with short(), pytest.raises(DataError, match=f"database.db: {TOO_LARGE}"), opened(pycolmap, database):
        pass


@pytest.mark.parametrize("lack", ["disk", "limit"])
def test_a_model_that_has_no_room_is_not_begun(tmp_path, lack, request):
    model = pycolmap.synthesize_dataset(pycolmap.SyntheticDatasetOptions(num_points3D=1000))
    model.write_binary(str(tmp_path))
    n_bytes = sum(file.stat().st_size for file in tmp_path.iterdir())
    if lack == "disk":
        request.getfixturevalue("full")
    with (
        short() if lack == "limit" else nullcontext(),
        pytest.raises(DataError, match=FULL if lack == "disk" else f"sparse: {TOO_LARGE}") as refused,
    ):
        write_model(model, tmp_path / "sparse" / "0")
    kilobytes = float(re.findall(r"up to (\d+) kB", str(refused.value))[0])
    assert n_bytes < 1000 * kilobytes < 1.2 * n_bytes
    assert not (tmp_path / "sparse").exists()
