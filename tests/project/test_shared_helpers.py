"""Tests need each other no more than modules do: what two files share is a helper, and each has a name of its own."""

import ast
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parents[1]
CHECKS = sorted((TESTS / "blender").glob("check_*.py"))  # of the Blender add-on
FILES = [*sorted(TESTS.rglob("test_*.py")), *CHECKS]
HELPERS = [*TESTS.glob("helpers/*.py"), *TESTS.glob("fuzz/[!_]*.py"), *TESTS.glob("blender/helpers/*.py")]
NAMES = {path.stem for path in FILES}


def imported(path: Path) -> set[str]:
    """The modules that a file imports anywhere, by their last names too: ``tests.scene.test_a`` is ``test_a``."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[-1] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            whole = (node.module or "").split(".")
            of_package = whole[0] in ("mi_dogsplat", "blender_addon")
            found |= set() if of_package else {whole[-1], *(alias.name for alias in node.names)}
    return found


def test_no_file_imports_a_file_of_tests():
    found = {path.name: others for path in [*FILES, *HELPERS] if (others := imported(path) & NAMES)}
    assert not found, "move what they share to tests/helpers or tests/blender/helpers"


def test_an_import_is_found(tmp_path):
    (tmp_path / "a.py").write_text("def f():\n    from check_render import psnr\nimport test_a as b, tests.c.test_d\n")
    assert imported(tmp_path / "a.py") >= {"check_render", "test_a", "test_d"}
    (tmp_path / "b.py").write_text("from tests.e import test_b\nfrom mi_dogsplat.datasets import check_cameras\n")
    assert imported(tmp_path / "b.py") == {"e", "test_b"}


def test_names_of_files_are_unique():
    """All of these are modules of one namespace (``pythonpath`` in ``pyproject.toml``)."""
    counts = Counter(path.stem for path in [*FILES, *HELPERS])
    assert not [name for name, count in counts.items() if count > 1]
    assert len(CHECKS) > 1 and len(HELPERS) > 1
