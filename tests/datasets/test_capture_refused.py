"""Scenes that cannot be captured, and what the command says."""

from pathlib import Path

import captured_scenes
import mitsuba as mi
import pytest
import tiny_data
from captured_scenes import error_of, tiny, write_scene
from mi_dogsplat.cli import main
from mi_dogsplat.datasets import capture as module
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.scene.ply import write_ply

SPLATS = '<shape type="dog"><string name="filename" value="model.ply"/></shape>'


@pytest.fixture(scope="module")
def balls(tmp_path_factory) -> Path:
    return write_scene(tmp_path_factory.mktemp("scene"))


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "no such file"),
        ("<scene", "Mitsuba cannot load it"),
        ('<scene version="3.0.0"><integrator type="path"/><emitter type="constant"/></scene>', "has no shape"),
        ('<scene version="3.0.0"><shape type="sphere"/></scene>', 'no integrator; add <integrator type="path"/>'),
        ('<scene version="3.0.0">SPLATS</scene>', 'no integrator; add <integrator type="dogsplat"/>'),
        ('<bsdf version="3.0.0" type="diffuse"/>', "its root element is not <scene>"),
    ],
)
def test_a_scene_that_cannot_be_captured_is_named_and_leaves_nothing(tmp_path, content, problem):
    file = tmp_path / "scene.xml"
    if content is not None:
        write_ply(tmp_path / "model.ply", tiny_data.truth())
        file.write_text(content.replace("SPLATS", SPLATS))
    message = error_of(file, tmp_path / "out", tiny())
    assert message.startswith(str(file)) and problem in message
    assert not (tmp_path / "out").exists()


def test_a_folder_in_place_of_a_scene_is_called_one(tmp_path):
    assert "this is a folder; give a Mitsuba scene as .xml file" in error_of(tmp_path, tmp_path / "out", tiny())


def test_a_model_in_place_of_a_scene_is_told_what_to_give(tmp_path):
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    assert error_of(tmp_path / "model.ply", tmp_path / "out", tiny()).endswith("; give a Mitsuba scene as .xml file")
    assert not (tmp_path / "out").exists()


def test_a_variant_without_a_compiler_is_refused_in_words(balls, tmp_path):
    mi.set_variant("scalar_rgb")
    assert "scalar_rgb computes no arrays" in error_of(balls, tmp_path / "out", tiny())


@pytest.mark.parametrize("integrator", ["path", "dogpath"])
def test_splats_that_the_integrator_leaves_out_are_warned_of(tmp_path, capfd, integrator):
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    scene = write_scene(tmp_path, SPLATS, integrator=f'<integrator type="{integrator}"/>')
    capture(scene, tmp_path / "out", tiny(views=1, test=0, size=(8, 6), spp=1, points=0))
    told = "scene.xml: 1 dog shape not seen; use the integrator dogsplat or dogpath" in "".join(capfd.readouterr())
    assert told == (integrator == "path")


def test_a_render_that_is_not_finite_names_its_view(tmp_path):
    light = '<emitter type="point"><point name="position" x="0" y="0" z="9"/>{}</emitter>'
    scene = write_scene(tmp_path, light.format('<rgb name="intensity" value="1e39"/>'))
    assert "view 000 renders to NaN or infinity" in error_of(scene, tmp_path / "out", tiny())


@pytest.mark.parametrize("is_made", [False, True])
def test_a_scene_that_gives_no_picture_can_be_corrected_and_captured_under_the_same_name(tmp_path, is_made):
    out, config = tmp_path / "out", tiny(views=1, test=0, size=(8, 6), spp=1, points=0)
    if is_made:
        out.mkdir()
    error_of(write_scene(tmp_path, integrator='<integrator type="dogsplat"/>'), out, config)
    assert out.exists() == is_made and not list(tmp_path.glob("out/*"))
    assert (capture(write_scene(tmp_path), out, config) / "transforms.json").exists()


def test_a_scene_that_is_refused_when_it_is_rendered_is_one_line(tmp_path):
    scene = write_scene(tmp_path, integrator='<integrator type="dogsplat"/>')
    error = error_of(scene, tmp_path / "out", tiny())
    assert error == f'{scene}: dogsplat: the scene has no shape of type "dog"; add one'


def test_the_command_shows_where_it_looks_and_how_far_it_is(tmp_path, capsys):
    scene = write_scene(tmp_path, captured_scenes.sensor("a"))
    out = tmp_path / "out"
    command = [*("capture", str(scene), "-o", str(out), "--views", "2", "--test", "0", "--size", "8", "6")]
    assert main([*command, "--spp", "1", "--points", "9", "--path", "orbit", "--center", "0", "0", "0.1"]) == 0
    shown = capsys.readouterr()
    assert shown.out == f"centre 0 0 0.1, radius 1.99, up z\n{out}\n" and "2/2" in shown.err
    assert main([*command, "--spp", "2"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main([*command, "--path", "sensors"]) == 2
    assert "--views: is not for --path sensors" in capsys.readouterr().err


def test_ctrl_c_in_the_command_says_how_to_go_on(balls, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(module, "render_shot", lambda *a: (_ for _ in ()).throw(KeyboardInterrupt))
    assert main(["capture", str(balls), "-o", str(tmp_path / "out")]) == 130
    assert "the same command again goes on" in capsys.readouterr().err
