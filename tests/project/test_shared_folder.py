"""What the tests of all processes share is made once, and a test that changes it is found out."""

from pathlib import Path

import pytest
from shared_folder import contents, shared_folder, unchanged_folder


def test_a_shared_folder_is_filled_once_and_a_change_of_it_is_seen(tmp_path):
    filled: list[Path] = []

    def write(folder: Path) -> None:
        (folder / "images").mkdir(parents=True)
        (folder / "images" / "0.png").write_bytes(b"picture")
        filled.append(folder)

    folder, again = (shared_folder(tmp_path, "tiny", write) for _ in range(2))
    assert folder == again == tmp_path / "tiny" and len(filled) == 1
    before = contents(folder)
    assert list(before) == ["images/0.png"] and contents(folder) == before
    (folder / "images" / "0.png").write_bytes(b"another")
    assert contents(folder) != before
    (folder / "images" / "0.png").write_bytes(b"picture")
    (folder / "more").touch()
    assert contents(folder) != before


def test_a_fixture_of_a_shared_folder_fails_where_a_test_has_changed_it(tmp_path):
    (tmp_path / "popen-gw0").mkdir()
    fixture = unchanged_folder(tmp_path / "popen-gw0", "tiny", Path.mkdir)
    folder = next(fixture)
    assert folder == tmp_path / "tiny"  # beside those of single processes
    assert list(fixture) == []
    fixture = unchanged_folder(tmp_path, "tiny", Path.mkdir)
    (next(fixture) / "more").touch()
    with pytest.raises(AssertionError, match="a test has changed the shared folder"):
        next(fixture)
