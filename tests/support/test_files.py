"""Files appear whole or not at all."""

import errno
import json
import os

import pytest
from mi_dogsplat.support.files import is_empty, replacing, write_json
from mi_dogsplat.support.resumable import begin


def test_a_write_that_fails_leaves_the_old_file_and_no_remains(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), replacing(path) as part:
        part.write_text("half")
        raise RuntimeError
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_text() == "old"


def test_what_file_managers_leave_in_a_folder_is_no_content(tmp_path):
    for name in (".DS_Store", "Thumbs.db", ".lock", ".a.json.0.part"):
        (tmp_path / name).touch()
    assert is_empty(tmp_path)
    begin(tmp_path / "capture.json", {"n": 1}, "capture")
    assert not is_empty(tmp_path)


def test_json_comes_back_and_what_json_cannot_hold_leaves_the_old_file(tmp_path):
    path = tmp_path / "deeper" / "a.json"
    write_json(path, {"a": [1, None]})
    assert json.loads(path.read_text()) == {"a": [1, None]} and path.read_text().endswith("}\n")
    with pytest.raises(TypeError):
        write_json(path, {"a": object()})
    assert json.loads(path.read_text()) == {"a": [1, None]} and [p.name for p in path.parent.iterdir()] == ["a.json"]


@pytest.mark.parametrize("place", [(), ("{part}",), ("photo.jpg", None, "{part}")])
def test_what_cannot_be_written_is_named_by_its_own_name(tmp_path, place):
    """A full disk names nothing, or the file that was copied; and the part has a random name."""
    path = tmp_path / "a.txt"
    with pytest.raises(OSError) as caught, replacing(path) as part:
        names = [str(part) if name == "{part}" else name for name in place]
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), *names)
    assert caught.value.filename == str(path)
    with pytest.raises(OSError) as caught, replacing(path):
        (tmp_path / "nothing").read_text()
    assert caught.value.filename == str(tmp_path / "nothing")


def test_a_part_that_cannot_be_removed_does_not_hide_why_nothing_was_written(tmp_path, monkeypatch):
    def refused(part, missing_ok):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(part))  # of a disk that is read-only

    monkeypatch.setattr("pathlib.Path.unlink", refused)
    with pytest.raises(OSError) as caught, replacing(tmp_path / "a.txt") as part:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(part))
    assert caught.value.filename == str(tmp_path / "a.txt")
