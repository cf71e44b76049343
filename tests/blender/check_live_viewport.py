"""A viewport that our engine draws, over time: when it writes stages, tries again, and is looked at no more."""

import time
from types import SimpleNamespace

import bpy
from live_views import a_context, drawn_viewport, update
from model_files import load
from package_command import never
from references import place_camera

from blender_addon.package.served import RendererError
from blender_addon.viewport import rendered
from blender_addon.viewport.pace import REST
from blender_addon.viewport.rendered import PATIENCE, PAUSE, Rendered


def test_stages_leave_blender_some_time(monkeypatch, tmp_path, scene, model):
    place_camera(scene, "dog")
    load(model)
    clock, made = [100.0], []
    monkeypatch.setattr(rendered.time, "monotonic", lambda: clock[0])

    def slow(*_):
        clock[0] += 0.5
        made.append(clock[0])
        raise ValueError("no matter")

    viewport = drawn_viewport(monkeypatch, tmp_path)
    monkeypatch.setattr(rendered, "make_stage", slow)
    viewport.restage()
    again = SimpleNamespace(objects=[], updates=[update(bpy.data.materials.new("M"))])
    viewport.note(again)
    viewport.restage()
    assert len(made) == 1 and viewport.waits(clock[0])
    clock[0] += 0.5 * PAUSE
    viewport.restage()
    assert len(made) == 2


def test_a_viewport_tries_again_with_another_command(monkeypatch, tmp_path, scene, model):
    """Also where another one draws."""
    load(model)
    named, asked, closed = [""], [], []

    def live(command):
        asked.append(command)
        if not command:
            raise RendererError("the package is missing")
        return SimpleNamespace(folder=tmp_path, pictures=never, close=lambda: closed.append(command))

    viewport = drawn_viewport(monkeypatch, tmp_path)
    monkeypatch.setattr(rendered, "live_renderer", live)
    monkeypatch.setattr(rendered, "command_of", lambda context: named[0])
    viewport.restage()
    assert "missing" in viewport.error
    for named[0] in ("first", "second"):
        viewport.draw(a_context(), bpy.context.evaluated_depsgraph_get())
        viewport.restage()
        assert not viewport.error
    assert asked == ["", "first", "second"]
    limit = time.monotonic() + 10
    while not closed and time.monotonic() < limit:
        time.sleep(0.01)
    assert closed == ["first"]


def test_a_stage_that_fails_takes_no_file_from_the_one_before(monkeypatch, tmp_path, scene, model):
    """Which may still be read."""
    obj, viewport = load(model), drawn_viewport(monkeypatch, tmp_path)
    monkeypatch.setattr(rendered, "PAUSE", 0.0)
    whole = rendered.make_stage

    def stage(make):
        monkeypatch.setattr(rendered, "make_stage", make)
        obj.location.x += 1
        viewport.note(SimpleNamespace(objects=[], updates=[update(bpy.data.materials.new("M"))]))
        viewport.restage()
        return {path.name for path in tmp_path.iterdir()}

    def fails(*_):
        raise ValueError("no stage")

    (first,) = stage(whole)
    assert stage(fails) == {first}
    second = stage(whole)
    assert len(second) == 2 and first in second
    assert first not in stage(whole)


def test_a_viewport_that_is_not_on_the_screen_is_not_waited_for(monkeypatch, tmp_path):
    """As one in another workspace; a timer would look at it for ever."""
    viewport = Rendered()
    assert not viewport.has_news(0.0) and viewport.waits(0.0)  # it has no stage yet
    viewport.restage()
    assert viewport.waits(0.0)  # nor has it been drawn
    viewport = drawn_viewport(monkeypatch, tmp_path)
    viewport.restage()
    assert "no splats" in viewport.error
    now = time.monotonic() + REST
    assert viewport.has_news(now) and viewport.waits(now + 0.9 * PATIENCE)
    assert not viewport.has_news(now + PATIENCE) and not viewport.waits(now + PATIENCE)
    viewport.draw(a_context(), bpy.context.evaluated_depsgraph_get())
    assert not viewport.waits(now)
