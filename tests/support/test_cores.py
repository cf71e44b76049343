"""The cores that count are those that this process may use."""

import os

import pytest
from mi_dogsplat.support import cores


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs Linux: it gives up cores")
def test_cores_outside_of_the_affinity_do_not_count():
    before = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(before)})
        assert cores.usable_cores() == 1
    finally:
        os.sched_setaffinity(0, before)
    assert 1 <= cores.usable_cores() <= len(before)


@pytest.mark.parametrize(("inner", "outer", "expected"), [
    ("max 100000", "max 100000", 8), ("max 100000", "250000 100000", 3), ("50000 100000", "400000 100000", 1),
    ("1600000 100000", "max 100000", 8), (None, None, 8),
])
def test_the_share_of_a_container_counts(tmp_path, monkeypatch, inner, outer, expected):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(8)), raising=False)
    monkeypatch.setattr(cores, "OWN_GROUP", tmp_path / "cgroup")
    monkeypatch.setattr(cores, "GROUPS", tmp_path)
    (tmp_path / "cgroup").write_text("2:cpu:/other\n0::/box/job\n")
    for folder, text in (("box/job", inner), ("box", outer)):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        if text:
            (tmp_path / folder / "cpu.max").write_text(text + "\n")
    assert cores.usable_cores() == expected


def test_without_control_groups_the_affinity_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 5}, raising=False)
    monkeypatch.setattr(cores, "OWN_GROUP", tmp_path / "none")
    assert cores.usable_cores() == 2
