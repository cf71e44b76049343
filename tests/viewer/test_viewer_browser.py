"""The viewer in a real browser: the page shows the picture that was rendered for its camera."""

import json
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace

import browser
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import Drawing, Model, write_model, write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.render.framing import robust_sphere
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from mi_dogsplat.support.arrays import write_arrays
from mi_dogsplat.viewer.view_state import ONLY_GAUSSIANS, Pace, Pose

pytest.importorskip("viser", reason="needs viser: pip install 'mi_dogsplat[view]'", exc_type=ModuleNotFoundError)
from mi_dogsplat.viewer.server import Server  # noqa: E402
from mi_dogsplat.viewer.source import Source  # noqa: E402

WAIT_SECONDS = 90.0
SIZE = 1000, 700
SHOWN = slice(60, -100), slice(330, 650)  # of a screenshot: beside the panel and messages, whatever the fonts


def wait_for(condition: Callable[[], bool]) -> bool:
    """Whether it became true in time."""
    end = time.monotonic() + WAIT_SECONDS
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.2)
    return False


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.ply"
    write_ply(path, tiny_data.dog_model(f_a=0.7, F=0.5))
    return path


def with_visitor(server: Server, visit: Callable[[browser.Page], None]) -> None:
    """Serve in this thread, as Dr.Jit needs it, while another one plays the visitor."""
    failed: list[BaseException] = []

    def play() -> None:
        try:
            with browser.opened(server.url, *SIZE) as page:
                visit(page)
        except BaseException as error:  # shown below, in the thread that pytest watches
            failed.append(error)

    visitor, end = threading.Thread(target=play), time.monotonic() + 3 * WAIT_SECONDS
    visitor.start()
    try:
        while visitor.is_alive() and time.monotonic() < end:
            server.serve(0.2)
    finally:
        visitor.join()
        server.stop()
    if failed:
        raise failed[0]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # viser's own event loop and sockets
def test_the_page_shows_what_is_rendered_for_its_camera_as_it_moves_and_as_settings_change(model, tmp_path):
    if browser.executable() is None:
        pytest.skip("needs a browser: apt-get install chromium")
    dataset = load_dataset(tiny_data.write_tiny_data(tmp_path / "data"))
    server = Server(Source(model), dataset, port=8765)
    drawn: list[tuple] = []
    draw = server.renderer.draw

    def record(pose, settings, moving=False):
        result = draw(pose, settings, moving)
        drawn.append((settings, moving, result.image, pose))
        return result

    server.renderer.draw = record

    def difference(page: browser.Page) -> float:
        """Mean difference between the page and the picture rendered last, in grey levels of 255."""
        shown, image = page.screenshot().astype(float), drawn[-1][2]
        rows = np.linspace(0, image.shape[0] - 1, shown.shape[0]).round().astype(int)
        columns = np.linspace(0, image.shape[1] - 1, shown.shape[1]).round().astype(int)
        return float(np.abs(shown - image[rows[:, None], columns])[SHOWN].mean())

    def visit(page: browser.Page) -> None:
        def full() -> bool:
            return bool(drawn) and not drawn[-1][1]

        start = dataset.test[0].camera.position
        assert wait_for(lambda: full() and bool(np.allclose(drawn[-1][3].position, start, atol=1e-4)))
        assert drawn[-1][2].shape[0] == 600 and drawn[-1][2].std() > 10
        assert wait_for(lambda: difference(page) < 4), difference(page)
        before = page.screenshot()

        n, where = len(drawn), drawn[-1][3].position
        page.drag((300, 350), (450, 350))
        assert wait_for(lambda: full() and not np.allclose(drawn[-1][3].position, where, atol=1e-3))
        assert any(moving for _, moving, _, _ in drawn[n:])
        assert wait_for(lambda: difference(page) < 4), difference(page)
        moved = page.screenshot()
        assert np.abs(moved[SHOWN].astype(float) - before[SHOWN]).mean() > 8

        server.choose(ONLY_GAUSSIANS)
        assert wait_for(lambda: drawn[-1][0].show == ONLY_GAUSSIANS and difference(page) < 4)
        assert np.abs(page.screenshot()[SHOWN].astype(float) - moved[SHOWN]).mean() > 8

        write_ply(model, Splats.empty(1))
        assert wait_for(lambda: not drawn[-1][2].any())
        assert wait_for(lambda: "0 primitives" in str(page.evaluate("document.body.innerText")))

    with_visitor(server, visit)


def test_flags_come_before_what_the_run_was_trained_with(capsys, data, model, tmp_path, monkeypatch):
    folder, served = tmp_path / "run", []
    folder.mkdir()
    (folder / "point_cloud.ply").write_bytes(model.read_bytes())
    (folder / "config.json").write_text(json.dumps({"data": str(data), "background": "white", "downscale": 2}))
    monkeypatch.setattr(Server, "serve", lambda self: served.append(self))

    def shown(*flags: object) -> tuple[float, int]:
        """The background, and the width of the photographs."""
        status, _, error = run(capsys, "view", folder, "--port", 8792, *flags)
        assert (status, error) == (0, "")
        return served[-1].settings.background, served[-1].renderer.views[0].camera.width

    width = tiny_data.cameras()[0].width
    assert shown() == (1.0, width // 2)
    assert shown("--background", "black", "--downscale", 3) == (0.0, width // 3)
    assert shown("--background", "auto", "--downscale", 1) == (0.0, width)  # said, though it is what is usual
    assert shown("--data", data) == (1.0, width // 2)  # which may have moved since then


def served_once(server: Server, monkeypatch) -> Server:
    """The server after one look at its file."""
    monkeypatch.setattr("mi_dogsplat.viewer.server.POLL_SECONDS", 0.0)
    server.serve(0.02)
    return server


def test_a_file_that_changes_is_drawn_as_it_says_then(tmp_path, monkeypatch):
    path, plain = tmp_path / "m.ply", tiny_data.truth().uniform_sh(0)
    write_model(path, Model(plain, Drawing(antialiased=True, up="-y")))
    server = Server(Source(path), port=8766)
    assert server.settings.sh_degree == 0
    colourful = replace(plain, sh_coeffs=np.pad(plain.sh_coeffs, ((0, 0), (0, 8), (0, 0)), constant_values=0.3))
    write_model(path, Model(colourful, Drawing(antialiased=False, near_clip=0.01, linear=True, white=2.5)))
    now, pose = served_once(server, monkeypatch), Pose((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -4.0), 0.8, 1.0)
    anew = Server(Source(path), port=8767)
    drawn = [s.renderer.drawn for s in (now, anew)]
    assert drawn[0] == drawn[1] == DrawnAs(False, 0.01, True, 2.5)
    assert now.settings == anew.settings and now.settings.sh_degree == 2
    a, b = (s.renderer.draw(pose, s.settings).image for s in (now, anew))
    assert np.array_equal(a, b) and a.any()
    now.stop()
    anew.stop()


def test_a_near_clip_that_is_asked_for_holds_without_data(model):
    servers = [Server(Source(model), options=PictureOptions(near_clip=asked), port=8769) for asked in (2.0, None)]
    assert servers[0].renderer.drawn.near_clip == 2.0 and 0 < servers[1].renderer.drawn.near_clip <= 0.2
    for server in servers:
        server.stop()


@pytest.mark.parametrize("unit", [1.0, 1e-4, 1e5])
def test_visitors_turn_about_the_model_and_come_as_near_to_it_whatever_its_unit(tmp_path, unit):
    splats = transformed(tiny_data.truth(), np.diag([unit, unit, unit, 1.0]))
    write_ply(tmp_path / "model.ply", splats)
    centre, radius = robust_sphere(splats)
    server = Server(Source(tmp_path / "model.ply"), port=8767)
    camera = SimpleNamespace(on_update=lambda _: None)
    server._arrived(SimpleNamespace(client_id=0, camera=camera))
    np.testing.assert_allclose(server.viser.initial_camera.look_at, centre, atol=1e-3 * radius)
    assert camera.min_orbit_distance <= 0.011 * radius and camera.max_orbit_distance >= 9e3 * radius
    server.stop()


def test_the_data_say_what_is_up_and_how_long_a_unit_is_where_the_model_does_not(model, tmp_path, monkeypatch):
    data, turned = tiny_data.write_tiny_data(tmp_path / "data"), []
    (data / "world.json").write_text(json.dumps({"up": "x", "scale": 2.0}))
    monkeypatch.setattr("viser.SceneApi.set_up_direction", lambda self, up: turned.append(tuple(up)))
    server = Server(Source(model), load_dataset(data), port=8773)
    assert turned[-1] == (1, 0, 0)
    assert f"{4 * robust_sphere(tiny_data.dog_model(f_a=0.7, F=0.5))[1]:.3g} m across" in server.statistics("")
    server.stop()


class FlatCamera:
    """That of a window without height, as viser has it."""

    wxyz, position, fov = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -4.0), 0.8

    @property
    def aspect(self) -> float:
        return 900.0 / 0


def test_a_window_without_height_does_not_end_the_viewer(model):
    server, pictures = Server(Source(model), port=8771), []
    scene, pace = SimpleNamespace(set_background_image=lambda image, **_: pictures.append(image.shape)), Pace()
    pace.changed()
    server.visitors[0] = SimpleNamespace(camera=FlatCamera(), scene=scene), pace
    server.serve(0.02)
    assert pictures == [(600, 600, 3)]
    server.stop()


def test_a_camera_that_makes_no_sense_leaves_the_viewer_to_others(model):
    server, pictures = Server(Source(model), port=8770), []
    scene = SimpleNamespace(set_background_image=lambda image, **_: pictures.append(image.shape))
    good = {"wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, -4.0), "fov": 0.8, "aspect": 1.5}
    for wrong in ({"position": (np.nan, 0, 0)}, {"wxyz": (np.inf, 0, 0, 0)}, {"fov": 0.0}, {"fov": 4.0}, {}):
        pace = Pace()
        pace.changed()
        visitor = SimpleNamespace(camera=SimpleNamespace(**good | wrong), scene=scene)
        server.visitors[len(server.visitors)] = visitor, pace
    server.serve(0.02)
    assert pictures == [(600, 900, 3)]
    server.stop()


def test_a_file_that_was_away_is_no_trouble_once_it_is_back(model, tmp_path, monkeypatch):
    server = Server(Source(model), port=8768)
    before = server.statistics("")
    model.rename(tmp_path / "away.ply")
    assert "shown as it was" in served_once(server, monkeypatch).statistics("")
    (tmp_path / "away.ply").rename(model)
    assert served_once(server, monkeypatch).statistics("") == before
    server.stop()


def test_arrays_that_are_no_checkpoint_are_refused_in_one_line(capsys, tmp_path):
    np.savez(tmp_path / "arrays.npz", a=np.zeros(3))
    names = ("logit_opacities", "sh_dc", "means", "log_scales", "quats")
    write_arrays(tmp_path / "odd.npz", {f"optimizer.{name}": np.zeros(4) for name in names})
    np.savez_compressed(tmp_path / "compressed.npz", a=np.zeros(3))
    (tmp_path / "text.npz").write_text("no arrays")
    for name in ("arrays.npz", "odd.npz", "compressed.npz", "text.npz"):
        words = f"{name}: is not a checkpoint of a training", "give a model or a run folder"
        assert_one_line(run(capsys, "view", tmp_path / name), *words)


def test_view_names_what_is_missing_in_one_line(capsys, tmp_path):
    assert_one_line(run(capsys, "view", tmp_path / "no.ply"), "no.ply", "no such file")
    assert_one_line(run(capsys, "view", tmp_path), "checkpoint")


def test_a_white_that_the_model_does_not_go_by_is_refused_in_one_line(capsys, model):
    assert_one_line(run(capsys, "view", model, "--white", "3"), "--white: is for linear radiance", "add --linear")


def test_a_downscale_without_photographs_is_refused_in_one_line(capsys, model):
    assert_one_line(run(capsys, "view", model, "--downscale", 2), "--downscale: there are no images to shrink; leave")


def test_an_address_that_is_not_ours_is_refused_in_one_line(capsys, model):
    assert_one_line(run(capsys, "view", model, "--host", "192.0.2.1"), "--host", "127.0.0.1")  # for documentation only
    assert_one_line(run(capsys, "view", model, "--host", "no such host"), "--host")
    assert_one_line(run(capsys, "view", model, "--host", ""), "--host: names no address", "0.0.0.0")
    assert_one_line(run(capsys, "view", model, "--port", "99999"), "--port")


def test_ports_of_which_none_is_free_are_one_line(capsys, model):
    with socket.socket() as taken:
        with suppress(OSError):  # somebody else has it
            taken.bind(("127.0.0.1", 65535))
            taken.listen()
        assert_one_line(run(capsys, "view", model, "--port", "65535"), "--port: neither 65535 nor one after it is free")


@pytest.mark.parametrize("within_a_render", [False, True])
def test_ctrl_c_ends_the_viewer_quietly(capsys, model, monkeypatch, within_a_render):
    def interrupted(self, seconds=0.0):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            if within_a_render:
                raise RuntimeError("what Dr.Jit makes of it") from error
            raise

    monkeypatch.setattr(Server, "serve", interrupted)
    status, printed, error = run(capsys, "view", model, "--port", "8790")
    assert (status, error) == (0, "") and printed == f"http://127.0.0.1:8790 shows {model}; Ctrl-C ends it\n"
