"""Runs under a Python with ``bpy``, started by ``tests/project/test_blender.py``: every test gets an empty file."""

import atexit
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
from training_scene import subject  # noqa: F401  (a fixture)

REFERENCES = Path(os.environ["DOGSPLAT_REFERENCES"])
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
    """The scene of a new, empty file with the add-on enabled."""
    import addon_utils  # found once bpy is there

    bpy.ops.wm.read_factory_settings(use_empty=True)
    if addon_utils.enable("blender_addon") is None:
        raise RuntimeError("the add-on cannot be enabled")
    return bpy.context.scene


@pytest.fixture
def model() -> Path:
    """A small DoG model of SH degree 3."""
    return REFERENCES / "dog.ply"


@pytest.fixture
def shared() -> Path:
    """The folder of real data."""
    if not SHARED.is_dir():
        pytest.skip(f"no data in {SHARED}")
    return SHARED


def load(path, **options) -> bpy.types.Object:
    """Import a model and return its object."""
    assert bpy.ops.import_scene.dogsplat(filepath=str(path), **options) == {"FINISHED"}
    return bpy.context.object


def datablocks() -> SimpleNamespace:
    """How many there are of each kind that an import can leave behind."""
    kinds = ("objects", "meshes", "cameras", "collections", "images")
    return SimpleNamespace(**{kind: len(getattr(bpy.data, kind)) for kind in kinds})
