"""What extensions.blender.org asks of an add-on, as far as its files say it: docs/blender_extension.md is the list."""

import ast
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports]  # pytest brings it there

ROOT = Path(__file__).parents[2]
ADDON = ROOT / "blender_addon"
MANIFEST = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))
FILES = sorted(ADDON.rglob("*.py"))
LONGEST = 64  # characters of a tagline and of a reason
# https://docs.blender.org/manual/en/latest/advanced/extensions/tags.html
TAGS = {
    "3D View", "Add Curve", "Add Mesh", "Animation", "Bake", "Camera", "Compositing", "Development", "Game Engine",
    "Geometry Nodes", "Grease Pencil", "Import-Export", "Lighting", "Material", "Modeling", "Mesh", "Node", "Object",
    "Paint", "Pipeline", "Physics", "Render", "Rigging", "Scene", "Sculpt", "Sequencer", "System", "Text Editor",
    "Tracking", "User Interface", "UV",
}  # fmt: skip
# What an add-on without these permissions must not use: modules, and names that the code says
NETWORK = {"ftplib", "http", "requests", "smtplib", "socket", "ssl", "telnetlib", "urllib", "webbrowser", "xmlrpc"}
FORBIDDEN = {
    "__file__": "its folder may not be writable; bpy.utils.extension_path_user, or a temporary folder",
    "__name__": "bl_ext.… and not the add-on; __package__",
    "bl_info": "of add-ons before 4.2; the manifest has it",
    "print": "a report, which people see",
    "eval": "code that cannot be reviewed",
    "exec": "code that cannot be reviewed",
    "__import__": "a relative import",
}


def names(tree: ast.AST) -> set[str]:
    """Every name that code uses, and every attribute of a module, as ``sys.path``."""
    found = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    attributes = (node for node in ast.walk(tree) if isinstance(node, ast.Attribute))
    return found | {f"{node.value.id}.{node.attr}" for node in attributes if isinstance(node.value, ast.Name)}


def imports(tree: ast.AST) -> set[str]:
    """The first names of modules that are imported absolutely."""
    found = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    absolute = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level)
    return {name.split(".")[0] for name in found | {node.module or "" for node in absolute}}


@pytest.mark.parametrize("text", [MANIFEST["tagline"], *MANIFEST["permissions"].values()])
def test_a_line_of_the_manifest_is_short_and_no_sentence(text):
    assert 0 < len(text) <= LONGEST and (text[-1].isalnum() or text[-1] in ")]}") and text == text.strip()


def test_the_manifest_says_what_the_platform_asks():
    assert MANIFEST["schema_version"] == "1.0.0" and MANIFEST["type"] == "add-on"
    assert set(MANIFEST["tags"]) <= TAGS and MANIFEST["tags"]
    assert "blender" not in MANIFEST["name"].lower() and MANIFEST["id"].isidentifier()
    assert tuple(map(int, MANIFEST["blender_version_min"].split("."))) >= (4, 2, 0)
    assert all(line.split(" ", 1)[0].isdigit() and line.split(" ", 1)[1] for line in MANIFEST["copyright"])


def test_the_permissions_are_those_that_the_code_needs():
    """Files of the user; nothing goes to a network, the clipboard, a camera or a microphone."""
    assert set(MANIFEST["permissions"]) == {"files"}
    for path in FILES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert not imports(tree) & NETWORK, path
        assert not any(name.endswith(".clipboard") for name in names(tree)), path


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ADDON)))
def test_the_code_keeps_to_itself(path):
    """Relative imports of its own, no module into everybody's namespace, nothing that the guidelines name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    used = names(tree)
    assert not [f"{name}: {remedy}" for name, remedy in FORBIDDEN.items() if name in used]
    assert not used & {"sys.path", "sys.modules", "site.addsitedir", "os.chdir"}
    assert "blender_addon" not in imports(tree)


def test_what_is_shipped_is_text():
    """No binaries and no picture: those of the page of the extension are in docs/pictures."""
    kinds = {path.suffix for path in ADDON.rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert kinds == {".py", ".toml", ""}  # the last is LICENSE
