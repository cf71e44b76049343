"""Files appear whole or not at all."""

import errno
import json
import math
import os

import pytest
from mi_dogsplat.runs.run import prepare_folder
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.files import is_empty, replacing, require_place, write_bytes, write_json
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


def test_json_has_no_words_that_are_none(tmp_path):
    """Infinity, as a bound that nothing reaches, comes back; programs that know JSON alone read the file, too."""

    def refuse(word: str) -> None:
        pytest.fail(f"{word} is no JSON")

    path, quoted = tmp_path / "a.json", 'Infinity, "NaN"\\'
    write_json(path, {"most": math.inf, "Infinity": [-math.inf, math.nan, quoted]})
    content = json.loads(path.read_text(), parse_constant=refuse)
    assert content == {"most": math.inf, "Infinity": [-math.inf, None, quoted]}


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


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_file_that_is_written_again_keeps_its_permissions(tmp_path):
    """What nobody else may read stays so, and what a group may write, too."""
    for mode in (0o600, 0o664, 0o444):
        path = tmp_path / f"{mode:o}.bin"
        path.write_bytes(b"old")
        path.chmod(mode)
        write_bytes(path, b"new")
        assert path.read_bytes() == b"new" and path.stat().st_mode & 0o777 == mode
    (tmp_path / "like.bin").touch()
    write_bytes(tmp_path / "new.bin", b"new")
    assert (tmp_path / "new.bin").stat().st_mode == (tmp_path / "like.bin").stat().st_mode


def linked(place, target):
    """A symbolic link, where the system lets its user make one."""
    try:
        place.symlink_to(target)
    except OSError as error:
        pytest.skip(f"no symbolic links here: {error}")
    return place


@pytest.mark.parametrize("there", [True, False])
def test_a_symbolic_link_stays_one_and_what_it_leads_to_is_written(tmp_path, there):
    """Also where that is not there yet, and where another link leads to it, from another folder."""
    for folder in ("models", "links"):
        (tmp_path / folder).mkdir()
    target = tmp_path / "models" / "a.bin"
    if there:
        target.write_bytes(b"old")
    first = linked(tmp_path / "models" / "newest.bin", "a.bin")
    second = linked(tmp_path / "links" / "a.bin", "../models/newest.bin")
    write_bytes(second, b"new")
    assert target.read_bytes() == b"new" and not target.is_symlink() and first.is_symlink() and second.is_symlink()
    assert sorted(path.name for path in tmp_path.rglob("*.bin")) == ["a.bin", "a.bin", "newest.bin"]
    assert not list(tmp_path.rglob("*.part"))


def test_links_that_lead_nowhere_are_refused_by_their_own_names_and_stay(tmp_path):
    links = {"away.bin": "unmounted/a.bin", "one.bin": "other.bin", "other.bin": "one.bin"}
    paths = [linked(tmp_path / name, target) for name, target in links.items()]
    for path in paths:
        for attempt in (require_place, lambda place: write_bytes(place, b"new")):
            with pytest.raises(DataError, match=rf"^{path}: cannot be written \("):
                attempt(path)
    assert sorted(tmp_path.iterdir()) == sorted(paths) and all(path.is_symlink() for path in paths)


def test_a_folder_that_is_a_link_to_nowhere_is_one_line_and_stays(tmp_path):
    out = linked(tmp_path / "out", "unmounted/runs")
    for attempt in (prepare_folder, lambda place: begin(place / "settings.json", {}, "film"),
                    lambda place: require_place(place / "of_today" / "a.bin")):  # fmt: skip
        with pytest.raises(DataError, match=f"^{out}: is a link to unmounted/runs, which is not there; make that"):
            attempt(out)
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
def test_no_file_takes_the_place_of_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    for path in (tmp_path / "pipe.png", linked(tmp_path / "link.png", "pipe.png")):
        with pytest.raises(DataError, match=rf"^{path}: cannot be written \(not a regular file\)"):
            write_bytes(path, b"new")
    assert (tmp_path / "pipe.png").is_fifo() and (tmp_path / "link.png").is_symlink()
