"""``dogsplat export MODEL -o page.html``: one file that a browser shows from disk, and that shows the model."""

import gzip
import html
import json
import re
import time
from importlib.resources import files
from pathlib import Path

import browser
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import write_ply
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.export.bake import baked
from mi_dogsplat.export.web_page import (
    UP_OF_SOG,
    VIEWER,
    VIEWER_FROM_SOG,
    Opening,
    opening_of,
    read_page,
    write_page,
)
from mi_dogsplat.film.subject import read_subject
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.framing import automatic_camera, likely_up, robust_sphere
from mi_dogsplat.render.picture import picture_of
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.drawing import Drawing, DrawnAs
from mi_dogsplat.scene.orientation import rotation_between
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError

ROOT = Path(__file__).parents[2]
WAIT_SECONDS = 90.0
ALIKE = 30.0  # dB between two renderers of the same model


@pytest.fixture
def model(tmp_path) -> Path:
    path = tmp_path / "a <model>.ply"
    write_ply(path, tiny_data.dog_model())
    return path


@pytest.fixture
def page(model, tmp_path, capsys) -> Path:
    out = tmp_path / "page.html"
    assert run(capsys, "export", model, "-o", out, "--views", "0", "--refine", "0")[0] == 0
    return out


def scene_of(page: Path) -> dict:
    found = re.search(r'<script type="application/json" id="scene">([^<]*)</script>', page.read_text())
    assert found
    return json.loads(found[1])


def shown_camera(page: Path, width: int, height: int) -> Camera:
    """The camera that a page of this size opens with, in the axes of the model."""
    scene = scene_of(page)
    turn = np.array(scene["turned_by"])
    model_from_viewer = (VIEWER_FROM_SOG @ turn).T
    position, target = (model_from_viewer @ scene[name] for name in ("position", "target"))
    across, upward = scene["tangents"]
    focal = 0.5 * height / max(upward, across * height / width)
    w2c = look_at(position, target, turn.T @ UP_OF_SOG)
    return Camera(w2c, focal, focal, width / 2, height / 2, width, height)


# --- the file ---


def test_a_page_holds_all_that_it_needs(page):
    text = page.read_text()
    assert not re.search(r"<(?:script|img|link|iframe)[^>]+(?:src|href)=", text)
    assert "default-src 'none'" in text  # so a browser would refuse to load anything else
    for part in ("Permission is hereby granted", "PlayCanvas", (VIEWER / "VERSION").read_text().strip()):
        assert part in text


def test_a_page_names_the_model_and_says_what_became_of_dog(model, page, tmp_path, capsys):
    name = html.escape("a <model>")
    assert f"<title>{name}</title>" in page.read_text() and "<model>" not in page.read_text()
    assert f"{name}: 60 Gaussians (30 of them Differences of Gaussians, baked)" in page.read_text()
    assert "the Gaussian nearest to it" in page.read_text()
    run(capsys, "export", model, "-o", tmp_path / "drop.html", "--views", "0", "--dog", "drop")
    assert "without their negative lobes" in (tmp_path / "drop.html").read_text()
    write_ply(tmp_path / "plain.ply", tiny_data.truth())
    run(capsys, "export", tmp_path / "plain.ply", "-o", tmp_path / "plain.html", "--views", "0")
    assert "plain: 60 Gaussians<" in (tmp_path / "plain.html").read_text()


@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0), (0, 1, 0), (0.3, -0.5, 0.8)])
def test_the_model_is_read_back_from_a_page_in_its_own_axes(tmp_path, up):
    """As from a SOG file, but for a rotation there and back."""
    plain = Model(baked(tiny_data.dog_model()))
    opening = Opening("m", np.array([3.0, 0, 0]), np.zeros(3), np.array(up, float), (0.4, 0.3))
    write_page(tmp_path / "m.html", plain, opening)
    write_model(tmp_path / "m.sog", plain)
    again, sog = read_page(tmp_path / "m.html").splats, read_model(tmp_path / "m.sog").splats
    camera = tiny_data.cameras()[1]
    for other, least in ((sog, 40), (plain.splats, 35)):
        assert psnr(picture_of(again, 0.0)(camera).color, picture_of(other, 0.0)(camera).color) > least


def test_the_export_is_measured_from_the_page(model, data, tmp_path, capsys):
    status, out, _ = run(capsys, "export", model, "-o", tmp_path / "p.html", "--data", data, "--refine", "0")
    lines = out.splitlines()
    assert status == 0 and lines[3].startswith("  read from the file")
    without, read = (float(re.findall(r"([\d.]+) dB", line)[0]) for line in lines[2:4])
    assert read > without - 3
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".html", ".ply"]


def test_a_small_model_is_small_in_a_page_that_turns_it(tmp_path, capsys):
    rng, n = np.random.default_rng(0), 1500
    splats = Splats(
        means=rng.normal(size=(n, 3)),
        log_scales=rng.normal(-3, 0.4, (n, 3)),
        quats=rng.normal(size=(n, 4)),
        logit_opacities=rng.normal(size=n),
        sh_coeffs=rng.normal(size=(n, 9, 3)) * 0.2,
    )
    write_model(tmp_path / "m.ply", Model(splats, Drawing(up="0.1,-0.9,0.42")))
    bundles = []
    for flags in ((), ("--small",)):
        run(capsys, "export", tmp_path / "m.ply", "-o", tmp_path / "m.html", "--views", "0", "--refine", "0", *flags)
        found = re.search(r'id="model">([^<]*)</script>', (tmp_path / "m.html").read_text())
        assert found
        bundles.append(len(found[1]))
    assert bundles[1] < 0.65 * bundles[0]  # .73 on the grids of the model as it lies


# --- how it opens ---


@pytest.mark.parametrize("b", [(0, -1, 0), (0, 1, 0), (1, 0, 0), (0.6, 0, -0.8)])
@pytest.mark.parametrize("a", [(0, 1, 0), (0, -2, 0), (0.1, 0.2, 3)])
def test_the_rotation_between_directions_is_a_rotation_and_the_smallest(a, b):
    a, b = np.array(a, float), np.array(b, float)
    turn = rotation_between(a, b)
    np.testing.assert_allclose(turn @ a / np.linalg.norm(a), b, atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    assert (np.trace(turn) - 1) / 2 == pytest.approx(a @ b / np.linalg.norm(a))  # the angle is that between them


def test_a_page_opens_with_the_first_photograph_or_the_whole_model(model, data, tmp_path, capsys):
    run(capsys, "export", model, "-o", tmp_path / "p.html", "--data", data, "--views", "0", "--refine", "0")
    first = tiny_data.cameras()[0]
    camera = shown_camera(tmp_path / "p.html", first.width, first.height)
    np.testing.assert_allclose(camera.position, first.position, atol=1e-6)
    np.testing.assert_allclose(camera.w2c, first.w2c, atol=0.02)  # upright is the mean of all cameras
    np.testing.assert_allclose(camera.K, first.K, rtol=1e-9)
    run(capsys, "export", model, "-o", tmp_path / "q.html", "--views", "0", "--refine", "0")
    whole = automatic_camera(tiny_data.dog_model())
    camera = shown_camera(tmp_path / "q.html", whole.width, whole.height)
    np.testing.assert_allclose(camera.w2c, whole.w2c, atol=1e-6)
    assert scene_of(tmp_path / "q.html")["target"] == pytest.approx(
        list(VIEWER_FROM_SOG @ rotation_between(likely_up(tiny_data.dog_model()), UP_OF_SOG) @
             robust_sphere(tiny_data.dog_model())[0]), abs=1e-6
    )  # fmt: skip


def test_the_file_of_a_model_says_what_is_up(tmp_path):
    path = tmp_path / "m.ply"
    read = Model(tiny_data.truth())
    for up, direction in (("-y", (0, -1, 0)), ("x", (1, 0, 0))):
        write_model(path, Model(read.splats, type(read.drawing)(up=up)))
        subject = read_subject(path, None, PictureOptions())
        assert opening_of(subject, "m").up.tolist() == list(direction)


def test_a_flag_on_what_is_up_comes_before_the_file(tmp_path, capsys):
    write_model(tmp_path / "m.ply", Model(tiny_data.truth(), Drawing(up="-y")))
    for flags, up in (((), (0, -1, 0)), (("--up=x",), (1, 0, 0))):
        run(capsys, "export", tmp_path / "m.ply", "-o", tmp_path / "p.html", "--views", "0", *flags)
        np.testing.assert_allclose(np.array(scene_of(tmp_path / "p.html")["turned_by"]) @ up, UP_OF_SOG, atol=1e-9)


# --- bad input ---


def test_a_page_may_be_named_by_bytes_that_are_no_utf_8(tmp_path):
    opening = Opening("m\udcfc", np.array([3.0, 0, 0]), np.zeros(3), UP_OF_SOG, (0.4, 0.3))
    write_page(tmp_path / "m.html", Model(tiny_data.truth()), opening)
    assert "<title>m\\udcfc</title>" in (tmp_path / "m.html").read_text("utf-8")


def test_bad_input_is_one_line_and_leaves_nothing(model, tmp_path, capsys):
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "p.xhtml"), "p.xhtml", ".html")
    (tmp_path / "file").touch()
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "file" / "p.html"), "p.html", "cannot be written")
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "p.html", "--dog", "keep"), "--dog")
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "p.html", "--data", tmp_path / "no"), "no such file")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a <model>.ply", "file"]
    (tmp_path / "other.html").write_text("<html></html>")
    with pytest.raises(DataError, match="is not a web page of dogsplat export"):
        read_page(tmp_path / "other.html")


# --- the viewer in it ---


def test_the_viewer_is_what_its_script_makes_and_has_its_licence():
    script = (ROOT / "scripts" / "setup" / "vendor_viewer.sh").read_text()
    version = re.search(r"^VERSION=(\S+)$", script, re.M)
    assert version and f"supersplat-viewer {version[1]}, playcanvas " in (VIEWER / "VERSION").read_text()
    assert (VIEWER / "LICENSE").read_text().startswith("MIT License")
    code = gzip.decompress((VIEWER / "viewer.js.gz").read_bytes()).decode()
    assert code.startswith("var splatViewer=") and "</script" not in code
    assert sum(len((VIEWER / name).read_bytes()) for name in ("viewer.js.gz", "viewer.css")) < 1_000_000
    assert "url(" not in (VIEWER / "viewer.css").read_text()
    assert (files("mi_dogsplat.export") / "web_page.html").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("size", [(700, 500), (500, 800)])
def test_a_browser_shows_the_model_as_we_render_it(model, page, size):
    """Its own rasterizer, sorting and colours; a mirrored picture would be far from ours."""
    if browser.executable() is None:
        pytest.skip("needs a browser: apt-get install chromium")
    with browser.opened(page.as_uri(), *size) as visitor:
        end = time.monotonic() + WAIT_SECONDS
        while visitor.evaluate("document.documentElement.dataset.state") is None and time.monotonic() < end:
            time.sleep(0.2)
        said = visitor.evaluate("document.getElementById('problem').textContent")
        assert visitor.evaluate("document.documentElement.dataset.state") == "loaded", said
        loaded = visitor.evaluate("JSON.stringify(performance.getEntriesByType('resource').map((e) => e.name))")
        assert all(name.startswith(("blob:", "data:")) for name in json.loads(loaded)), loaded
        for part in ("#about", ".sse-ui"):
            visitor.evaluate(f"document.querySelector('{part}').style.display = 'none'")
        height, width = visitor.screenshot().shape[:2]
        picture = picture_of(read_page(page).splats, 0.0, DrawnAs(near_clip=0.01))
        expected = picture(shown_camera(page, width, height)).color
        best = 0.0
        while best < ALIKE and time.monotonic() < end:  # it sorts and draws in its own time
            best = max(best, psnr(visitor.screenshot() / np.float32(255), expected))
    assert best >= ALIKE
    assert max(psnr(other, expected) for other in (expected[:, ::-1], expected[::-1])) < ALIKE - 5
