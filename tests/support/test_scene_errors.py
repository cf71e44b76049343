"""What Mitsuba and our plugins say about a scene is one line, without what Mitsuba wraps around it."""

import sys

import mitsuba as mi
import pytest
from mi_dogsplat.datasets.scene_file import has_splats, load_scene
from mi_dogsplat.inspection.features import splat_scene
from mi_dogsplat.render.render_files import render_scene
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.scene_errors import scene_error

SCENE = """<scene version="3.0.0">
    <integrator type="dogsplat">{parameter}</integrator>
    <sensor type="perspective"/>
    {shape}
</scene>
"""
MISSING = '<shape type="dog"><string name="filename" value="no.ply"/></shape>'
LINE = "dog: no.ply: cannot be read (No such file or directory); check the path and its permissions"


@pytest.fixture
def written(tmp_path):
    def write(parameter="", shape=""):
        path = tmp_path / "scene.xml"
        path.write_text(SCENE.format(parameter=parameter, shape=shape))
        return path

    return write


@pytest.mark.parametrize("what, line", [
    ({"shape": MISSING}, f"line 4: {LINE}"),
    ({"parameter": '<string name="aovs" value="fog"/>'}, 'line 2: dogsplat: unknown AOV "fog"; available are alpha, '
     "depth, median_depth, normal, index, count, dog_share"),
    ({"parameter": '<float name="near_clip" value="-1"/>'},
     'line 2: dogsplat: "near_clip" is -1.0, it must be finite, 0 or more'),
    ({}, 'dogsplat: the scene has no shape of type "dog"; add one'),  # while it renders
    ({"parameter": '<float name="fog" value="1"/>'},
     'line 2: Mitsuba cannot render it (Found 1 unreferenced property in integrator plugin of type "dogsplat": '
     '- float "fog": 1); correct the scene'),
])  # fmt: skip
def test_rendering_a_scene_that_is_wrong_says_so_in_one_line(written, tmp_path, what, line):
    path = written(**what)
    with pytest.raises(DataError) as caught:
        render_scene(path, tmp_path / "out.png")
    assert str(caught.value) == f"{path}: {line}"


@pytest.mark.parametrize("included, line", [
    ('\n<shape type="sphere"><float name="radius" value="wide"/></shape>',
     'line 2: Mitsuba cannot load it (could not parse floating point value "wide"); correct the scene'),
    ('\n<shape>', 'line 2: Mitsuba cannot load it (Start-end tags mismatch); correct the scene'),
    ('\n<shape type="sphere"><float name="radius" value="$r"/></shape>',
     'line 2: Mitsuba cannot load it (undefined parameter: $r); give it a value by <default name="r" value="…"/>, or '
     "by the flag -D of dogsplat render or film"),
])  # fmt: skip
def test_what_is_wrong_in_an_included_file_names_that_file_and_its_line(written, included, line):
    path = written(shape='<include filename="more.xml"/>')
    more = path.with_name("more.xml")
    more.write_text(f'<scene version="3.0.0">{included}</scene>')
    with pytest.raises(DataError) as caught:
        load_scene(path)
    assert str(caught.value) == f"{more}: {line}"


def test_an_included_file_that_is_missing_is_told_with_the_line_that_wants_it(written):
    path = written(shape='<include filename="no.xml"/>')
    with pytest.raises(DataError) as caught:
        load_scene(path)
    said = 'line 4: Mitsuba cannot load it (included file "no.xml" not found); correct the scene'
    assert str(caught.value) == f"{path}: {said}"


def test_so_does_looking_into_it(written):
    path = written(shape=MISSING)
    with pytest.raises(DataError) as caught:
        splat_scene(path)
    assert str(caught.value) == f"{path}: line 4: {LINE}"


@pytest.mark.skipif(sys.platform != "linux", reason="needs a file system whose names are bytes, as Linux has it")
@pytest.mark.parametrize("read", [splat_scene, has_splats, load_scene, lambda path: render_scene(path, "out.png")])
def test_a_path_that_mitsuba_cannot_be_told_is_refused(written, read):
    path = written().rename(written().with_name("caf\udce9.xml"))  # é of Latin-1, as Python has it
    with pytest.raises(DataError, match=r"its path is not UTF-8, which Mitsuba needs; rename it"):
        read(path)


def test_the_node_of_a_dictionary_is_named_and_a_file_once(tmp_path):
    model = tmp_path / "no.ply"
    for described, expected in (
        ({"type": "dog", "filename": str(model)}, f"{model}: cannot be read (No such file or directory); check the"),
        ({"type": "scene", "splats": {"type": "dog", "filename": "no.ply"}}, f'{model}: "splats": dog: no.ply: cannot'),
    ):
        with pytest.raises(RuntimeError) as caught:
            mi.load_dict(described)
        assert str(scene_error(model, caught.value, "cannot be drawn")).startswith(expected)
