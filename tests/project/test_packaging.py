"""What is said of the package where there is nothing but the package: its page on an index, its licences, its types."""

import re
import sys
from pathlib import Path

import mi_dogsplat

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports]  # pytest brings it there

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
MANIFEST = tomllib.loads((ROOT / "blender_addon" / "blender_manifest.toml").read_text(encoding="utf-8"))


def test_the_page_of_the_package_has_no_link_that_is_dead_outside_of_the_repository():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!https?:)[^)]*\)", text)
    for rule in PROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(rule["pattern"], rule["replacement"], text)
    assert links and not re.findall(r"\]\((?!https?:)[^)]*\)", text)
    assert "docs/training.md" in text and "https://mitsuba-renderer.org" in text


def test_package_and_add_on_say_their_licences():
    assert PROJECT["project"]["license"] == "BSD-3-Clause"
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").startswith("BSD 3-Clause License")
    assert MANIFEST["license"] == ["SPDX:GPL-3.0-or-later"]
    text = (ROOT / "blender_addon" / "LICENSE").read_text(encoding="utf-8")
    assert "GNU GENERAL PUBLIC LICENSE" in text and "Version 3, 29 June 2007" in text and "17. Interpretation" in text


def test_the_version_is_said_once_to_each():
    assert PROJECT["project"]["version"] == mi_dogsplat.__version__ == MANIFEST["version"]


def test_type_checkers_of_others_see_the_types():
    assert Path(mi_dogsplat.__file__).with_name("py.typed").exists()
