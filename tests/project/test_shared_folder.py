"""What the tests of all processes share is made once, and a test that changes it is found out."""

from pathlib import Path

from shared_folder import contents, shared_folder


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
