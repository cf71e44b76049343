"""Runs under a Python with ``bpy``, started by ``tests/project/test_blender.py``: every test gets an empty file."""

import atexit
import os
import sys
from pathlib import Path

import bpy
import pytest
from native_splats import native  # noqa: F401  (a fixture)
from package_command import COMMAND
from references import REFERENCES
from training_scene import subject  # noqa: F401  (a fixture)

from blender_addon import render_engine
from blender_addon.package.live import LiveCommand, LiveInProcess
from blender_addon.package.renderers import Command

SHARED = Path(os.environ["DOGSPLAT_SHARED"])
STATUS = pytest.StashKey[int]()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    session.config.stash[STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """End without Blender's destructors: one of those of 4.5 waits for a thread that now and then never ends."""
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(config.stash.get(STATUS, 1))


@pytest.fixture(autouse=True)
def scene() -> bpy.types.Scene:
    """The scene of a new, empty file with the add-on enabled.

    Factory settings and the add-on are taken anew where the test before has left others: they take .05 s, a file .01.
    """
    import addon_utils  # found once bpy is there

    if bpy.context.preferences.is_dirty or not addon_utils.check("blender_addon")[1]:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        if addon_utils.enable("blender_addon") is None:
            raise RuntimeError("the add-on cannot be enabled")
        bpy.context.preferences.is_dirty = False
    else:
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy.context.scene


@pytest.fixture
def model() -> Path:
    """A small DoG model of SH degree 3."""
    return REFERENCES / "dog.ply"


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real data."""
    if not SHARED.is_dir():
        pytest.skip(f"no data in {SHARED}")
    return SHARED


@pytest.fixture(scope="session")
def command():
    """The process of all final pictures, as the frames of a film have one."""
    renderer = Command(COMMAND)
    yield renderer
    renderer.close()


@pytest.fixture
def by_command(monkeypatch, command) -> Command:
    """The render engine draws by that process."""
    monkeypatch.setattr(render_engine, "choose_renderer", lambda words: command)
    return command


@pytest.fixture(scope="session")
def live_command():
    """The process of all pictures of viewports."""
    renderer = LiveCommand(COMMAND)
    yield renderer
    renderer.close()
    assert not renderer.folder.exists()


@pytest.fixture(params=["command", "process"])
def live(request, live_command):
    """Both ways to the pictures of a viewport."""
    if request.param == "command":
        return live_command
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    return LiveInProcess()
