"""What draws viewports: a process of the package that leaves pictures, ends and starts again."""

import sys

import pytest
from live_views import last, staged, through_the_camera
from mathutils import Matrix
from references import place_camera
from surroundings import plane

from blender_addon.engine.order import camera_request
from blender_addon.package.live import LiveCommand, live_renderer
from blender_addon.package.served import RendererError
from blender_addon.viewport.pace import Level
from blender_addon.viewport.rendered import request_of


def test_one_process_serves_all_pictures_and_leaves_those_of_other_views(scene, live_command, tmp_path):
    place_camera(scene, "square")
    plane(200).matrix_world = scene.camera.matrix_world @ Matrix.Translation((0, 0, -20))
    scene.dogsplat.samples = 100_000
    seen = through_the_camera(scene)
    stage = staged(tmp_path, seen.camera)
    request = request_of(stage, scene, seen.scaled(0.25), Level(), rests=True)
    shares: list[float] = []
    for share, _ in live_command.pictures(request, lambda: bool(shares)):
        shares.append(share)
    assert len(shares) >= 1 and max(shares) < 1
    with pytest.raises(RendererError, match="none.ply: cannot be read") as caught:
        last(live_command, {"model": "none.ply", **camera_request(seen.camera)})
    assert "\n" not in str(caught.value)
    assert last(live_command, {**request, "samples": 1}).shape == (16, 24, 4)


def test_a_process_that_has_ended_is_started_again(scene):
    dying = LiveCommand((sys.executable, "-c", "import sys; sys.exit('dogsplat: no memory')"))
    for _ in range(2):
        with pytest.raises(RendererError, match="no memory"):
            last(dying, {"camera": {"width": 1, "height": 1}})
    dying.close()


@pytest.mark.parametrize("said", ["[]", "{}", '{"share": 0.5}', '{"picture": "frame.rgba"}', '{"done": 1}'])
def test_an_answer_that_lacks_something_is_an_error_of_one_line(said):
    strange = LiveCommand((sys.executable, "-c", f"print({said!r}, flush=True); import sys; sys.stdin.read()"))
    with pytest.raises(RendererError, match="does not answer as dogsplat serve does; update the package"):
        last(strange, {"camera": {"width": 1, "height": 1}})
    strange.close()


def test_the_package_is_found_as_for_final_pictures(monkeypatch):
    live = live_renderer(sys.executable)
    assert isinstance(live, LiveCommand) and live.folder.is_dir()
    live.close()
    assert not live.folder.exists()
    with pytest.raises(RendererError, match="correct or clear"):
        live_renderer("/no/such")
