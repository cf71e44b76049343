"""The Blender add-on without Blender."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ADDON = Path(__file__).parents[2] / "blender_addon"


@pytest.fixture(scope="module")
def addon():
    """``addon("files.sh")`` is that module.

    The add-on's ``__init__.py`` needs Blender; its files of numbers need the language of its messages alone, and are
    imported past it.
    """
    package = ModuleType("blender_addon")
    package.__path__ = [str(ADDON)]
    language: Any = ModuleType("bpy.app.translations")  # all that files know of Blender: here English
    language.pgettext_iface = language.pgettext_rpt = lambda text, context=None: text
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "blender_addon", package)
        for module in (ModuleType("bpy"), ModuleType("bpy.app"), language):
            patch.setitem(sys.modules, module.__name__, module)
        yield lambda name: importlib.import_module(f"blender_addon.{name}")
        for name in [name for name in sys.modules if name.startswith("blender_addon.")]:
            del sys.modules[name]
