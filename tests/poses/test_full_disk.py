"""A disk that fills up: COLMAP would end the process from a thread of its own, so it is not let that far."""

from types import SimpleNamespace

import pytest
from mi_dogsplat.poses import matching
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.support.errors import DataError

FULL = "its disk has 100 kB left, and up to .* are written next; make room; the same command goes on"


@pytest.fixture
def full(monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=10**5))


def never(*_, **__):
    raise AssertionError("COLMAP writes")


def test_no_features_are_sought_where_they_would_have_no_room(room, tmp_path, full, monkeypatch):
    monkeypatch.setattr("pycolmap.extract_features", never)
    with pytest.raises(DataError, match=FULL):
        find_poses(room / "pictures", tmp_path / "posed", PosesConfig(), lambda *_: None)


def test_no_pairs_are_matched_where_they_would_have_no_room(tmp_path, full, monkeypatch):
    pycolmap = pytest.importorskip("pycolmap")
    monkeypatch.setattr("pycolmap.match_image_pairs", never)
    monkeypatch.setattr(matching, "_pairs", lambda *_: [(0, 1)])
    with pytest.raises(DataError, match=FULL):
        matching.match(pycolmap, tmp_path / "database.db", False, PosesConfig(), lambda *_: None)
