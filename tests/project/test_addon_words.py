"""What processes of the package say reaches Blender's messages as it was said, whatever the locale.

Blender's own Python reads UTF-8, also on a Windows whose programs write something else.
"""

import sys

import pytest

SAYS = "import sys; sys.exit('dogsplat: Z\\u00fcrich.ply: is no model; copy it again')"
SAID = "Zürich.ply: is no model; copy it again"


@pytest.fixture(autouse=True)
def another_locale(monkeypatch):
    """In which a Python writes Latin-1."""
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")


@pytest.fixture
def words() -> list[str]:
    """A command that complains, whatever it is asked for."""
    return [sys.executable, "-c", SAYS]


def test_why_a_training_ended(addon, tmp_path, words):
    run = addon("training.run").TrainingRun(words, tmp_path, tmp_path / "run", {"steps": "9"}, False)
    run.wait()
    with pytest.raises(RuntimeError, match=SAID):
        run.require_result()


def test_why_no_picture_is_served(addon, tmp_path, words):
    served = addon("package.served").Served(words, "dogsplat", tmp_path / "log.txt")
    with pytest.raises(RuntimeError, match=SAID):
        list(served.answers({}, lambda: False))


def test_why_a_model_is_not_converted(addon, tmp_path, words):
    command = addon("package.renderers").Command(tuple(words))
    with pytest.raises(addon("files.errors").FileError, match=SAID):
        command.convert(tmp_path / "model.sog", tmp_path / "model.ply")
    command.close()
