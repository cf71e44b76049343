"""The zip that ``make addon`` builds, installed and used as an artist would."""

import subprocess
import sys
from pathlib import Path

import bpy
import pytest
from conftest import REFERENCES

ROOT = Path(__file__).parents[2]


@pytest.fixture
def package(tmp_path):
    subprocess.run([ROOT / "scripts" / "build_addon.sh", bpy.app.binary_path or sys.executable, tmp_path], check=True)
    (path,) = tmp_path.glob("dogsplat-*.zip")
    return path


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # Blender 4.3 leaves a pipe open
def test_the_extension_builds_installs_imports_and_goes(package):
    import addon_utils

    addon_utils.disable("blender_addon")
    bpy.ops.preferences.addon_enable(module="bl_pkg")
    bpy.ops.extensions.package_install_files(filepath=str(package), repo="user_default", enable_on_install=True)
    module = "bl_ext.user_default.dogsplat"
    try:
        assert module in bpy.context.preferences.addons
        assert bpy.context.preferences.addons[module].preferences.command == ""
        assert bpy.ops.import_scene.dogsplat(filepath=str(REFERENCES / "dog.ply")) == {"FINISHED"}
        assert len(bpy.context.object.data.vertices) == 150
        handler = bpy.types.FileHandler.bl_rna_get_subclass_py("DOGSPLAT_FH_model")
        assert handler is not None and handler.bl_import_operator == "import_scene.dogsplat"
    finally:
        addon_utils.disable(module, default_set=True)
        bpy.ops.extensions.package_uninstall(repo_index=_repository("user_default"), pkg_id="dogsplat")
    assert not hasattr(bpy.types.Scene, "dogsplat_colors")


def _repository(module):
    return next(i for i, repo in enumerate(bpy.context.preferences.extensions.repos) if repo.module == module)


def test_only_the_engine_needs_other_packages():
    """Every import of the add-on, by its own line."""
    allowed = {"__future__", "bpy", "bpy_extras", "gpu", "gpu_extras", "mathutils", "numpy", *sys.stdlib_module_names}
    for path in (ROOT / "blender_addon").rglob("*.py"):
        for line in path.read_text().splitlines():
            words = line.split()
            if words[:1] not in (["import"], ["from"]) or words[1].startswith("."):
                continue
            if words[1].split(".")[0].rstrip(",") not in allowed:
                assert path.name in ("live.py", "renderers.py") and line.startswith("            "), (path.name, line)


def test_everything_that_is_registered_is_unregistered():
    import addon_utils

    import blender_addon

    classes = blender_addon.CLASSES
    assert all(cls.is_registered for cls in classes)
    addon_utils.disable("blender_addon")
    assert not any(cls.is_registered for cls in classes)
    assert not any(
        "DOGSPLAT" in panel.COMPAT_ENGINES
        for panel in bpy.types.Panel.__subclasses__()
        if hasattr(panel, "COMPAT_ENGINES")
    )
    addon_utils.enable("blender_addon")
