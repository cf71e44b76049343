"""What draws final pictures: the package in this process or as a process of its own, and how either ends."""

import sys
from pathlib import Path

import numpy as np
import pytest
from package_command import never, nothing
from references import REFERENCES, place_camera, reference

from blender_addon.cameras.objects import camera_numbers
from blender_addon.files.errors import FileError
from blender_addon.package import renderers
from blender_addon.package.renderers import Command, InProcess, choose_renderer, close_renderers, converted
from blender_addon.package.served import Cancelled, RendererError


@pytest.fixture
def request_of_dog(scene):
    """What the engine asks for to draw the reference."""
    place_camera(scene, "dog")
    camera = camera_numbers(scene, scene.camera)
    numbers = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    return {"model": str(REFERENCES / "dog.ply"), "camera": {"w2c": camera.w2c.tolist(), **numbers}}


@pytest.fixture(params=["command", "process"])
def renderer(request, command):
    """Both of them."""
    if request.param == "command":
        return command
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    return InProcess()


def test_both_renderers_make_the_picture_and_tell_how_far_they_are(request_of_dog, renderer):
    progress = []
    picture = renderer.render(request_of_dog, never, progress.append, nothing)
    assert np.abs(picture["color"] - reference()["color"]).max() < 1e-3
    assert np.abs(picture["alpha"] - reference()["alpha"]).max() < 1e-3
    assert progress == sorted(progress) and progress[-1] == 1


def test_bands_are_parts_of_one_picture(request_of_dog, monkeypatch):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    import mi_dogsplat  # noqa: F401  (before what needs its LLVM)
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    from mi_dogsplat.requests import answer

    monkeypatch.setattr(answer, "BAND_PIXELS", 16 * 96)
    progress = []
    picture = InProcess().render(request_of_dog, never, progress.append, nothing)
    assert np.abs(picture["color"] - reference()["color"]).max() < 1e-3 and len(progress) == 4


def test_one_process_serves_all_frames_until_it_is_cancelled(request_of_dog, command):
    command.render(request_of_dog, never, nothing, nothing)
    first = command.process_id
    command.render(request_of_dog, never, nothing, nothing)
    assert command.process_id == first
    with pytest.raises(Cancelled):
        command.render(request_of_dog, lambda: True, nothing, nothing)
    assert command.process_id is None
    command.render(request_of_dog, never, nothing, nothing)
    assert command.process_id not in (None, first)


def test_what_the_package_refuses_does_not_end_its_process(request_of_dog, command):
    with pytest.raises(RendererError, match="none.ply: cannot be read") as caught:
        command.render({**request_of_dog, "model": "none.ply"}, never, nothing, nothing)
    assert "\n" not in str(caught.value)
    command.render(request_of_dog, never, nothing, nothing)


def test_cancelling_stops_a_process_that_does_not_answer(request_of_dog):
    sleeper = Command((sys.executable, "-c", "import time; time.sleep(600)"))
    with pytest.raises(Cancelled):
        sleeper.render(request_of_dog, lambda: True, nothing, nothing)
    sleeper.close()


def test_cancelling_stops_in_this_process(request_of_dog):
    pytest.importorskip("mitsuba", reason="mitsuba is not installed beside bpy")
    with pytest.raises(Cancelled):
        InProcess().render(request_of_dog, lambda: True, nothing, nothing)


@pytest.mark.parametrize("script, message", [
    ("import sys; sys.exit('dogsplat: model.ply: broken; mend it')", "model.ply: broken; mend it"),
    *((f"print({said!r}, flush=True); import sys; sys.stdin.read()", "update the package")
      for said in ("hello", "7", "[]", "{}", '{"share": "half"}', '{"share": null}')),
])  # fmt: skip
def test_what_the_command_complains_about_is_shown_in_one_line(request_of_dog, script, message):
    failing = Command((sys.executable, "-c", script))
    with pytest.raises(RendererError, match=message) as caught:
        failing.render(request_of_dog, never, nothing, nothing)
    assert "\n" not in str(caught.value)
    failing.close()


@pytest.mark.parametrize("script, reason", [
    ("import sys; sys.exit('killed by somebody')", "killed by somebody"),
    ("import no_package_of_this_name", "No module named 'no_package_of_this_name'"),
    ("pass", "exit status 0"),
])  # fmt: skip
def test_a_command_that_converts_nothing_is_named_and_not_the_file(monkeypatch, tmp_path, script, reason):
    """A Python without the package, say: the model need not be exported again."""
    failing = Command((sys.executable, "-c", script))
    monkeypatch.setattr(renderers, "choose_renderer", lambda words: failing)
    with pytest.raises(FileError, match=f"^model.sog: only the package .*: .*{reason}; install") as told:
        converted("", Path("model.sog"), tmp_path / "out.ply")
    assert "\n" not in str(told.value)
    failing.close()


def test_what_the_package_says_of_a_file_is_said_of_it(tmp_path):
    failing = Command((sys.executable, "-c", "import sys; sys.exit('dogsplat: model.sog: is torn; mend it')"))
    with pytest.raises(FileError, match="^model.sog: is torn; mend it$"):
        failing.convert(Path("model.sog"), tmp_path / "out.ply")
    failing.close()


def test_a_renderer_whose_folder_was_cleaned_up_is_replaced():
    first = choose_renderer(sys.executable)
    first.folder.rmdir()
    second = choose_renderer(sys.executable)
    assert second is not first and second.folder.is_dir()
    close_renderers()


def test_without_mitsuba_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RendererError, match="pip install.*preferences"):
        choose_renderer()
    with pytest.raises(RendererError, match='"/no/such".*correct or clear'):
        choose_renderer("/no/such")


def test_a_renderer_stays_for_the_next_frame():
    first = choose_renderer(sys.executable)
    assert choose_renderer(sys.executable) is first and first.folder.is_dir()
    close_renderers()
    assert not first.folder.exists()
    assert choose_renderer(sys.executable) is not first
    close_renderers()
