"""What would end the process inside of Mitsuba is one line before, however a scene comes."""

import json
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.datasets.scene_file import load_scene
from mi_dogsplat.inspection.features import splat_scene
from mi_dogsplat.render.render_files import render_scene
from mi_dogsplat.requests.answer import Answerer
from mi_dogsplat.requests.request import read_request
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.scene_loading import load_dict, load_file

SCENE = """<scene version="3.0.0"><shape type="sphere"/><emitter type="constant"/>
<integrator type="{integrator}">{passes}</integrator>
<sensor type="perspective"><sampler type="{sampler}">{samples}</sampler>
<film type="hdrfilm"><integer name="width" value="4"/>{film}
<rfilter type="{filter}">{width}</rfilter></film></sensor></scene>
"""
PLAIN = {"integrator": "path", "sampler": "independent", "filter": "box", "passes": "", "samples": "", "film": "",
         "width": ""}  # fmt: skip


def number(name, value):
    kind = "float" if isinstance(value, float) else "integer"
    return f'<{kind} name="{name}" value="{value}"/>'


@pytest.mark.parametrize("wrong, line", [
    ({"integrator": "ptracer", "passes": number("samples_per_pass", 0)},
     'line 2: "samples_per_pass" of the plugin ptracer is 0; give 1 or more, or leave it out'),
    ({"samples": number("sample_count", 0)},
     'line 3: "sample_count" of the plugin independent is 0; give 1 to 16777216'),
    ({"sampler": "ldsampler", "samples": number("sample_count", 2**31)},
     'line 3: "sample_count" of the plugin ldsampler is 2147483648; give 1 to 16777216'),
    ({"sampler": "orthogonal", "samples": number("strength", 0)},
     'line 3: "strength" of the plugin orthogonal is 0; give 1 or more'),
    ({"film": number("height", 0)}, 'line 4: "height" of the plugin hdrfilm is 0; give 1 or more'),
    ({"filter": "lanczos", "width": number("lobes", -1)},
     'line 5: "lobes" of the plugin lanczos is -1; give 0 or more'),
    ({"filter": "tent", "width": number("radius", -1.0)},
     'line 5: "radius" of the plugin tent is -1.0; give 0 or more'),
])  # fmt: skip
def test_numbers_that_mitsuba_does_not_survive_are_named_with_their_line(tmp_path, wrong, line):
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(**PLAIN | wrong))
    for read in (load_file, load_scene, splat_scene):
        with pytest.raises(DataError) as caught:
            read(path)
        assert str(caught.value) == f"{path}: {line}"


def test_what_mitsuba_survives_is_loaded(tmp_path):
    path = tmp_path / "scene.xml"
    usual = {"passes": number("samples_per_pass", 1), "samples": number("sample_count", 2**24)}
    path.write_text(SCENE.format(**PLAIN | usual | {"filter": "tent", "width": number("radius", 0.5)}))
    assert load_file(path).sensors()[0].sampler().sample_count() == 2**24


@pytest.mark.parametrize("part, unknown", [
    ('<shape type="sphere"/>', number("raduis", 2.0)), ('<sampler type="independent">', number("strength", 2)),
])  # fmt: skip
def test_a_parameter_that_no_plugin_knows_is_refused_as_mitsuba_does(tmp_path, part, unknown):
    path = tmp_path / "scene.xml"
    with_it = f"{part.removesuffix('/>')}>{unknown}</shape>" if part.endswith("/>") else part + unknown
    path.write_text(SCENE.format(**PLAIN).replace(part, with_it))
    for read in (mi.load_file, lambda file: load_file(Path(file))):
        with pytest.raises(RuntimeError, match="unreferenced property"):
            read(str(path))
    with pytest.raises(DataError, match="scene.xml: line .*unreferenced property"):
        render_scene(path, tmp_path / "out.png")


def test_a_command_says_so(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(**PLAIN | {"samples": number("sample_count", 0)}))
    with pytest.raises(DataError, match='line 3: "sample_count" of the plugin independent is 0'):
        render_scene(path, tmp_path / "out.png")


def test_names_of_old_files_are_told_as_they_are_called_today(tmp_path):
    path = tmp_path / "scene.xml"
    old = SCENE.replace("3.0.0", "0.6.0").format(**PLAIN | {"samples": number("sampleCount", 0)})
    path.write_text(old)
    with pytest.raises(DataError, match='"sample_count" of the plugin independent is 0'):
        load_file(path)


def test_a_meter_of_no_shape_is_refused(tmp_path):
    """It asks its shape where it is."""
    film = {"type": "hdrfilm", "width": 2, "height": 2, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    meter, path = {"type": "irradiancemeter", "film": film}, tmp_path / "scene.json"
    path.write_text(json.dumps({"meter": meter, "sky": {"type": "constant"}, "ball": {"type": "sphere"}}))
    with pytest.raises(DataError) as caught:
        list(Answerer().answer(read_request({"scene": str(path), "samples": 1})))
    remedy = "put it into the shape whose light it is to measure"
    assert str(caught.value) == f'{path}: "meter": the sensor irradiancemeter is in no shape; {remedy}'
    path.write_text(json.dumps({"sky": {"type": "constant"}, "ball": {"type": "sphere", "meter": meter}}))
    (*_, (_, picture)) = Answerer().answer(read_request({"scene": str(path), "samples": 1}))
    assert picture is not None and np.isfinite(picture["color"]).all()


def test_a_dictionary_becomes_what_mitsuba_makes_of_it(tmp_path):
    film = {"type": "hdrfilm", "width": 3, "height": 2}
    described = {"type": "scene", "ball": {"type": "sphere"}, "eye": {"type": "perspective", "film": film}}
    assert str(load_dict(tmp_path, described)) == str(mi.load_dict(described))
