"""The cores that count are those that this process may use."""

import os

import pytest
from mi_dogsplat.support import control_groups, cores


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
    monkeypatch.setattr(control_groups, "OWN", tmp_path / "cgroup")
    monkeypatch.setattr(control_groups, "ROOT", tmp_path)
    (tmp_path / "cgroup").write_text("2:cpu:/other\n0::/box/job\n")
    for folder, text in (("box/job", inner), ("box", outer)):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        if text:
            (tmp_path / folder / "cpu.max").write_text(text + "\n")
    assert cores.usable_cores() == expected


@pytest.mark.parametrize("controllers", ["cpu", "cpu,cpuacct", "cpuacct", "cpuset"])
@pytest.mark.parametrize(("inner", "outer", "expected"), [
    (-1, -1, 8), (-1, 250000, 3), (50000, 400000, 1), (None, -1, 8),
])
def test_so_does_one_of_control_groups_version_1(tmp_path, monkeypatch, controllers, inner, outer, expected):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(8)), raising=False)
    monkeypatch.setattr(control_groups, "OWN", tmp_path / "cgroup")
    monkeypatch.setattr(control_groups, "ROOT", tmp_path)
    (tmp_path / "cgroup").write_text(f"5:memory:/other\n2:{controllers}:/docker/1a\n0::/\n")
    for folder, quota in (("cpu/docker/1a", inner), ("cpu/docker", outer)):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        if quota is not None:
            (tmp_path / folder / "cpu.cfs_quota_us").write_text(f"{quota}\n")
            (tmp_path / folder / "cpu.cfs_period_us").write_text("100000\n")
    assert cores.usable_cores() == (expected if "cpu" in controllers.split(",") else 8)


def test_without_control_groups_the_affinity_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 5}, raising=False)
    monkeypatch.setattr(control_groups, "OWN", tmp_path / "none")
    assert cores.usable_cores() == 2
