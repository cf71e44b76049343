"""The zip that ``make addon`` builds, installed and used as an artist would."""

import subprocess
import sys
import zipfile
from pathlib import Path

import bpy
import pytest
from model_files import load
from package_command import SECONDS
from references import REFERENCES

ROOT = Path(__file__).parents[2]
KINDS = (bpy.types.Operator, bpy.types.Panel, bpy.types.Menu, bpy.types.PropertyGroup, bpy.types.AddonPreferences,
         bpy.types.RenderEngine, bpy.types.FileHandler)  # fmt: skip


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    script = ROOT / "scripts" / "release" / "addon.sh"
    subprocess.run([script, bpy.app.binary_path or sys.executable, folder], check=True, timeout=SECONDS)
    (path,) = folder.glob("dogsplat-*.zip")
    return path


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # Blender 4.3 leaves a pipe open
def test_the_extension_builds_installs_imports_and_goes(package, tmp_path):
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
        bpy.ops.export_scene.dogsplat(filepath=str(tmp_path / "out.ply"))
        installed = Path(sys.modules[module].__file__).parent
        assert files_below(installed) == names_in(package)  # nothing was written there
        handler = bpy.types.FileHandler.bl_rna_get_subclass_py("DOGSPLAT_FH_model")
        assert handler is not None and handler.bl_import_operator == "import_scene.dogsplat"
    finally:
        addon_utils.disable(module, default_set=True)
        bpy.ops.extensions.package_uninstall(repo_index=_repository("user_default"), pkg_id="dogsplat")
    assert not hasattr(bpy.types.Scene, "dogsplat_colors")


def files_below(folder):
    found = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {path.relative_to(folder).as_posix() for path in found}


def names_in(package):
    with zipfile.ZipFile(package) as archive:
        return {name for name in archive.namelist() if not name.endswith("/")}


def test_the_zip_holds_code_and_its_licence_alone(package):
    names = names_in(package)
    others = {name for name in names if not name.endswith(".py")}
    assert others == {"LICENSE", "blender_manifest.toml"} and "__init__.py" in names
    assert package.stat().st_size < 300_000


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


def traces():
    """All of Blender that an add-on can leave something in, and what of that is ours."""
    holders = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    menus = {name: getattr(getattr(bpy.types, name).draw, "_draw_funcs", [])
             for name in dir(bpy.types) if "_MT_" in name}  # fmt: skip
    functions = {name: [f for f in found if f.__module__.startswith("blender_addon")]
                 for name, found in {**holders, **menus}.items() if isinstance(found, list)}  # fmt: skip
    classes = {cls.__name__ for kind in KINDS for cls in kind.__subclasses__()
               if cls.__module__.startswith("blender_addon") and cls.is_registered}  # fmt: skip
    properties = {kind.__name__: set(kind.bl_rna.properties.keys()) for kind in (bpy.types.Scene, bpy.types.Object)}
    keymaps = sum(len(keymap.keymap_items) for keymap in bpy.context.window_manager.keyconfigs.addon.keymaps)
    engines = {panel.__name__: set(panel.COMPAT_ENGINES) for panel in bpy.types.Panel.__subclasses__()
               if hasattr(panel, "COMPAT_ENGINES") and not panel.__module__.startswith("blender_addon")}  # fmt: skip
    types = {name for name in dir(bpy.types) if "dogsplat" in name.lower()}
    return functions, classes, types, properties, keymaps, engines, sys.path[:]


def test_nothing_is_left_of_the_add_on_however_often_it_was_there(model):
    import addon_utils

    addon_utils.disable("blender_addon")
    before = traces()
    for _ in range(2):
        addon_utils.enable("blender_addon")
        assert traces() != before
        load(model)
        addon_utils.disable("blender_addon")
        for kept, first in zip(traces(), before, strict=True):
            assert kept == first
    assert not any(before[0].values()) and not before[1] and "dogsplat" not in repr(before[2:-1]).lower()
    addon_utils.enable("blender_addon")
