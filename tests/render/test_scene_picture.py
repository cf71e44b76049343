"""``dogsplat render`` of a Mitsuba scene: which sensor sees it, and the values that its parameters get."""

import numpy as np
import pytest
from mi_dogsplat.cli import main
from mi_dogsplat.render.render_files import render_scene
from mi_dogsplat.support.errors import DataError
from rendered_files import read_exr

SENSOR = """<sensor type="perspective">
<transform name="to_world"><lookat origin="0, {y}, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="8"/>
<string name="pixel_format" value="rgba"/></film></sensor>"""
SCENE = f"""<scene version="3.0.0"><default name="light" value="1"/>{{more}}
<integrator type="path"/><emitter type="constant"><rgb name="radiance" value="$light"/></emitter>
{SENSOR.format(y=-4, width=10)}{SENSOR.format(y=4, width=12)}</scene>"""


@pytest.fixture
def scene(tmp_path):
    def write(more=""):
        path = tmp_path / "scene.xml"
        path.write_text(SCENE.format(more=more))
        return path

    return write


@pytest.mark.parametrize(("sensor", "width"), [(0, 10), (1, 12)])
def test_a_scene_is_seen_by_the_sensor_that_is_asked_for(scene, tmp_path, sensor, width):
    out = tmp_path / "out.exr"
    assert main(["render", str(scene()), "-o", str(out), "-s", str(sensor)]) == 0
    assert read_exr(out)["RGBA"].shape == (8, width, 4)


@pytest.mark.parametrize("film", ["rgb", "rgba", "luminance_alpha"])
def test_png_has_the_colours_of_a_scene_whatever_its_aovs_are(scene, model, tmp_path, film):
    path, pictures = scene(f'<shape type="dog"><string name="filename" value="{model}"/></shape>'), []
    with_splats = path.read_text().replace('"path"', '"dogsplat"').replace('"rgba"', f'"{film}"')
    for aovs in ("", "alpha", "depth, alpha"):
        named = f'"dogsplat"><string name="aovs" value="{aovs}"/></integrator>'
        path.write_text(with_splats.replace('"dogsplat"/>', named))
        render_scene(path, tmp_path / "out.png")
        pictures.append((tmp_path / "out.png").read_bytes())
    assert pictures == pictures[:1] * 3


@pytest.mark.parametrize("sensor", [-1, 2])
def test_a_sensor_that_is_not_there_is_told_how_many_there_are(scene, tmp_path, sensor):
    with pytest.raises(DataError, match=r"--sensor: .*scene\.xml has 2 sensors; give 0 to 1"):
        render_scene(scene(), tmp_path / "out.png", sensor=sensor)
    assert not (tmp_path / "out.png").exists()


@pytest.mark.parametrize(("given", "light"), [([], 1), (["-D", "light=3"], 3), (["-Dlight=3", "-D", "light=.5"], 0.5)])
def test_parameters_of_a_scene_have_the_values_that_are_given(scene, tmp_path, given, light):
    out = tmp_path / "out.exr"
    assert main(["render", str(scene()), "-o", str(out), *given]) == 0
    np.testing.assert_allclose(read_exr(out)["RGBA"][..., :3], light, rtol=1e-3)


def test_splats_that_are_not_seen_are_warned_of_whatever_the_parameters_are(scene, model, tmp_path, capfd):
    path = scene('<shape type="dog"><string name="filename" value="$model"/></shape>')
    render_scene(path, tmp_path / "out.png", defined={"model": str(model)})
    assert "scene.xml: 1 dog shape not seen" in "".join(capfd.readouterr())


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("fog=1", '--define: {path} has no parameter "$fog"; leave it out, or correct its name'),
        ("light", '--define: "light" is not NAME=VALUE; write it like -D spp=16'),
        ("=1", '--define: "=1" is not NAME=VALUE; write it like -D spp=16'),
        ("path=1", '--define: Mitsuba keeps the name "path" for itself; give the parameter of the scene another name'),
        ("light=x", '{path}: line 2: Mitsuba cannot render it (could not parse RGB value "x"); correct the scene'),
    ],
)
def test_definitions_of_no_use_are_one_line(scene, tmp_path, capsys, given, line):
    path, out = scene(), tmp_path / "out.png"
    assert main(["render", str(path), "-o", str(out), "-D", given]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"dogsplat: {line.format(path=path)}"
    assert not out.exists()


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["-s", "1"], "--sensor: a model has no sensors; leave it out"),
        (["-D", "light=1"], "--define: is only for parameters of a scene; leave it out"),
    ],
)
def test_a_model_has_neither_sensors_nor_parameters(model, tmp_path, capsys, flags, line):
    assert main(["render", str(model), "-o", str(tmp_path / "out.png"), *flags]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"dogsplat: {line}"


def test_what_the_callers_function_raises_is_not_blamed_on_the_scene(scene, model, tmp_path):
    def on_pass(done, n):
        raise ValueError(f"the caller's own, after {done} of {n}")

    path = scene(f'<shape type="dog"><string name="filename" value="{model}"/></shape>')
    path.write_text(path.read_text().replace('"path"', '"dogsplat"'))
    with pytest.raises(ValueError, match="^the caller's own, after 1 of 2$"):
        render_scene(path, tmp_path / "out.png", spp=2, on_pass=on_pass)
    assert not (tmp_path / "out.png").exists()
