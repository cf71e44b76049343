"""The walk of one parameter through the code, as CONTRIBUTING.md tells it."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_station_of_the_walk_exists_and_no_file_is_visited_twice():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text[text.index("## One parameter through the code") :]
    stations = re.findall(r"^\| \d+ \| `([^`]+)` \| `(\w+)` \|", section, re.MULTILINE)
    assert len(stations) > 10
    files = [file for file, _ in stations]
    assert len(set(files)) == len(files)
    for file, name in stations:
        tree = ast.parse((ROOT / "mi_dogsplat" / file).read_text(encoding="utf-8"))
        defined = {node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        assert name in defined, f"{file} defines no {name}"
