"""``dogsplat info``: the numbers are right, and each problem is found and only where it is."""

import base64
import dataclasses
import json
import zipfile
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from dataset_folders import transforms_folder
from described import value_of
from mi_dogsplat import Drawing, Model, write_model, write_ply
from mi_dogsplat.cli.printing import size_line
from mi_dogsplat.inspection.describe_features import describe_features
from mi_dogsplat.inspection.info import describe
from mi_dogsplat.inspection.model import model_problems
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.wording import file_size
from own_axes_models import CURVED, CUT, PLANE_KINDS, SECOND_CUT, SHIFTED, SLOPED, Kind


def healthy(n: int = 200) -> Splats:
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(n, 4))
    return Splats(
        means=rng.uniform(-1, 1, (n, 3)),
        log_scales=np.log(rng.uniform(0.02, 0.1, (n, 3))),
        quats=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        logit_opacities=rng.normal(size=n),
        sh_coeffs=rng.normal(size=(n, 4, 3)),
        dog_index=np.array([3, 5, 8]),
        dog_logit_opacities=np.array([-1.0, 0.0, 1.0]),
        dog_log_scales=np.log(np.full((3, 3), 0.5)),
    )


def test_a_model_is_described_by_its_counts_and_ranges(tmp_path):
    splats = healthy()
    splats.means[:, 1] = np.linspace(-2, 4, 200)
    write_ply(tmp_path / "m.ply", splats)
    lines = describe(tmp_path / "m.ply")
    size = (tmp_path / "m.ply").stat().st_size
    assert lines[0] == f"{tmp_path / 'm.ply'}: model"
    assert value_of(lines, "primitives") == "200, 3 of them DoG"
    assert value_of(lines, "SH degree") == "1"
    assert value_of(lines, "size") == f"{size / 1000:.3g} kB, {size / 200:.0f} bytes per primitive"
    assert value_of(lines, "position y") == "-2 to 4, median 1"
    assert value_of(lines, "DoG opacity") == "0.2689 to 0.7311, median 0.5"
    assert value_of(lines, "DoG scale") == "0.5 to 0.5, median 0.5"
    low, high = splats.opacities.min(), splats.opacities.max()
    assert value_of(lines, "opacity").startswith(f"{low:.4g} to {high:.4g}")
    assert lines[-1] == "problems: none found"


def test_the_size_of_a_model_is_that_of_all_its_files(tmp_path):
    write_model(tmp_path / "m.sog", Model(tiny_data.truth()))
    with zipfile.ZipFile(tmp_path / "m.sog") as bundle:
        bundle.extractall(tmp_path / "sog")
    write_model(tmp_path / "m.gltf", Model(tiny_data.truth()))
    content = json.loads((tmp_path / "m.gltf").read_text())
    (tmp_path / "gltf").mkdir()
    embedded = content["buffers"][0]["uri"].partition(",")[2]
    (tmp_path / "gltf" / "a b.bin").write_bytes(base64.b64decode(embedded))
    content["buffers"][0]["uri"] = "a%20b.bin"
    content["buffers"] += [{"byteLength": 4, "uri": uri} for uri in ("../m.sog", "no.bin")]  # of nothing that is read
    (tmp_path / "gltf" / "m.gltf").write_text(json.dumps(content))
    for name in ("m.sog", "sog/meta.json", "m.gltf", "gltf/m.gltf"):
        folder = (tmp_path / name).parent
        size = sum(file.stat().st_size for file in ([tmp_path / name] if folder == tmp_path else folder.iterdir()))
        told = value_of(describe(tmp_path / name), "size")
        assert told == f"{file_size(size)}, {size / tiny_data.N_TRUTH:.0f} bytes per primitive", name
        written = size_line(tmp_path / "m.sog", tiny_data.N_TRUTH, tmp_path / name)  # of what is made of it
        assert written.endswith(f"; {Path(name).name} has {file_size(size)}"), name


def test_a_mixed_model_is_counted_by_sh_degree_and_its_bytes_by_part(tmp_path):
    splats = healthy().with_sh_degrees(np.repeat([0, 1], [150, 50]))
    write_ply(tmp_path / "m.ply", splats, "rows")
    lines = describe(tmp_path / "m.ply")
    assert value_of(lines, "SH degree") == "0: 150, 1: 50"
    names = [part.split()[0] for part in value_of(lines, "bytes of").split(", ")]
    assert names == ["primitives", "sh1", "dog"]


@pytest.mark.parametrize(
    ("kind", "what", "label"),
    [
        *((kind, f"with {kind.word}", kind.word) for kind in (SLOPED, CURVED, SHIFTED)),
        (CUT, "with a cut", "cut normals"),
        (SECOND_CUT, "with a second cut", "second normals"),
    ],
    ids=lambda value: getattr(value, "word", ""),
)
def test_rows_are_counted_where_there_are_some(tmp_path, kind: Kind, what, label):
    splats, told = kind.having(healthy(), every=50), "-0.25 to 1.75, median 0.75"
    kind.values(splats)[:] = np.linspace(-0.25, 1.75, kind.values(splats).size).reshape(4, *kind.shape)
    if kind in PLANE_KINDS:  # their lengths
        kind.values(splats)[:], told = [[3, 4, 0], [0, 0, 2], [0, -8, 6], [0, 12, 5]], "2 to 13, median 7.5"
    write_ply(tmp_path / "m.ply", splats)
    lines = describe(tmp_path / "m.ply")
    assert value_of(lines, "primitives") == f"200, 3 of them DoG, 4 {what}"
    assert value_of(lines, label) == told and lines[-1] == "problems: none found"
    write_ply(tmp_path / "rows.ply", splats.with_sh_degrees(np.repeat([0, 1], [150, 50])), "rows")
    parts = value_of(describe(tmp_path / "rows.ply"), "bytes of").split(", ")
    assert parts[-1].startswith(f"{kind.word} ") and parts[-2].startswith("dog ")


def test_a_model_without_dog_says_nothing_about_it(tmp_path):
    write_ply(tmp_path / "m.ply", tiny_data.truth())
    for line in describe(tmp_path / "m.ply"):
        assert not line.startswith("  DoG") and not any(word in line for word in ("slopes", "cut", "curv", "shift"))


@pytest.mark.parametrize(
    ("name", "rows", "value", "words"),
    [
        ("quats", [0, 7], 0.0, "quaternion of length zero"),
        ("quats", [1], 3.0, "not of unit length"),
        ("log_scales", [4, 5, 6], -20.0, "a millionth of the radius"),
        ("log_scales", [9], 3.0, "the radius of the model"),
        ("logit_opacities", [2, 3], -8.0, "below 1/255"),
        ("means", [11], 1e5, "100 radii from the centre"),
        ("sh_coeffs", [5, 6], 1e37, "1,000,000 times as bright as white"),
    ],
)
def test_each_problem_is_found_in_just_the_primitives_that_have_it(tmp_path, name, rows, value, words):
    splats = healthy()
    assert model_problems(splats) == []
    getattr(splats, name)[rows] = value
    (problem,) = model_problems(splats)
    assert words in problem and problem.startswith(f"{len(rows)} of 200 ")
    write_ply(tmp_path / "m.ply", splats)
    lines = describe(tmp_path / "m.ply")
    assert lines[-2:] == ["problems:", f"  {problem}"]


def test_the_range_of_colours_is_told_and_lamps_of_a_linear_model_are_no_problem(tmp_path):
    splats = tiny_data.truth()
    splats.sh_coeffs[:, 0] = 0
    splats.sh_coeffs[3, 0, 1] = 1e7
    for drawing, found in ((Drawing(), True), (Drawing(linear=True, white=100.0), False)):
        write_model(tmp_path / "m.ply", Model(splats, drawing))
        lines = describe(tmp_path / "m.ply")
        assert value_of(lines, "colour") == f"0.5 to {0.28209479 * 1e7 + 0.5:.4g}, median 0.5"
        assert ("as bright as white" in lines[-1]) == found


def test_an_empty_model_is_a_problem(tmp_path):
    write_ply(tmp_path / "m.ply", Splats.empty(0))
    lines = describe(tmp_path / "m.ply")
    assert value_of(lines, "primitives").startswith("0,") and "there is no primitive" in lines[-1]


# --- data sets ---


def test_a_data_set_shows_its_views_points_and_whether_they_agree(tmp_path):
    lines = describe(tiny_data.write_tiny_data(tmp_path))
    assert lines[0] == f"{tmp_path}: data set"
    assert value_of(lines, "views") == "7 for training, 1 for testing"
    assert value_of(lines, "images") == "48x36"
    assert value_of(lines, "names") == "1, 2, 3, 4 and 4 more"
    assert value_of(lines, "points") == "60"
    assert value_of(lines, "cameras").startswith("100% of the points")
    assert "differ by 0." in value_of(lines, "colours")


def test_a_data_set_tells_its_up_axis_and_unit(tmp_path):
    world = tiny_data.write_tiny_data(tmp_path) / "world.json"
    assert not any(line.startswith("  world") for line in describe(tmp_path))
    world.write_text('{"up": "-y", "scale": 0.30999999493360519}')
    assert value_of(describe(tmp_path), "world") == "up -y, scale 0.31"  # as of a product in float32
    world.write_text('{"up": "w"}')
    with pytest.raises(DataError, match="world.json: \"up\" is 'w'"):
        describe(tmp_path)


def test_a_data_set_tells_what_of_it_is_not_read(tmp_path):
    file = transforms_folder(tmp_path) / "transforms.json"
    content = json.loads(file.read_text())
    content["frames"][0]["mask_path"] = "masks/r_0.png"
    file.write_text(json.dumps(content))
    assert f"--masks {tmp_path / 'masks'}" in value_of(describe(tmp_path), "not read")


def test_alpha_and_the_lack_of_points_are_told(tmp_path):
    lines = describe(tiny_data.write_tiny_data(tmp_path, n=2, alpha=True, points=False))
    assert value_of(lines, "images") == "48x36, with alpha"
    assert value_of(lines, "points").startswith("none")
    assert not any(line.startswith("  cameras") for line in lines)
    assert describe(tmp_path / "transforms.json")[1:] == lines[1:]


def test_photographs_that_do_not_fit_into_memory_are_described(data, monkeypatch):
    expected = describe(data), describe_features(data)
    monkeypatch.setattr("mi_dogsplat.datasets.view_images.available_memory", lambda: 1)  # byte
    assert (describe(data), describe_features(data)) == expected


@pytest.mark.parametrize("points", [True, False])
def test_a_photograph_that_is_cut_off_is_named(tmp_path, points):
    tiny_data.write_tiny_data(tmp_path, n=2, points=points)
    photograph = sorted((tmp_path / "images").iterdir())[-1]
    photograph.write_bytes(photograph.read_bytes()[:-30])
    with pytest.raises(DataError, match=f"{photograph.name}: cannot be read as an image"):
        describe(tmp_path)


def test_a_mitsuba_scene_is_a_data_set(tmp_path):
    (tmp_path / "s.xml").write_text(
        '<scene version="3.0.0"><integrator type="path"/><shape type="sphere"/><emitter type="constant"/>'
        '<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="16"/>'
        '<integer name="height" value="12"/></film></sensor></scene>'
    )
    lines = describe(tmp_path / "s.xml")
    assert value_of(lines, "views") == "1 for training, 0 for testing"
    assert value_of(lines, "images").startswith("16x12")


SCENE_OF_SPLATS = (
    '<scene version="3.0.0"><integrator type="INTEGRATOR"/><emitter type="constant"/><emitter type="point"/>'
    '<shape type="dog"><string name="filename" value="m.ply"/></shape>'
    '<shape type="sphere"><emitter type="area"/></shape><shape type="sphere"/>'
    '<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="16"/>'
    '<integer name="height" value="12"/></film></sensor></scene>'
)


def test_a_scene_without_sensor_or_model_says_so_in_a_line(tmp_path):
    write_model(tmp_path / "m.ply", Model(tiny_data.truth()))
    blind = SCENE_OF_SPLATS[: SCENE_OF_SPLATS.index("<sensor")].replace("INTEGRATOR", "dogpath") + "</scene>"
    (tmp_path / "a b.xml").write_text(blind)
    lines = describe(tmp_path / "a b.xml")
    assert value_of(lines, "to see it").startswith("dogsplat render '") and value_of(lines, "sensors") == "none"
    assert lines[-1] == "  there is no sensor: nothing can be rendered"
    (tmp_path / "m.ply").write_bytes(b"")
    with pytest.raises(DataError, match="m.ply: the file is empty") as refused:
        describe(tmp_path / "a b.xml")
    assert "Traceback" not in str(refused.value)


def test_models_that_are_to_be_drawn_in_different_ways_are_a_problem(tmp_path):
    for name, antialiased in (("m.ply", True), ("n.ply", False)):
        write_model(tmp_path / name, Model(tiny_data.truth(), Drawing(antialiased=antialiased)))
    scene = SCENE_OF_SPLATS.replace("INTEGRATOR", "dogpath")
    shape = '<shape type="dog"><string name="filename" value="m.ply"/></shape>'
    (tmp_path / "s.xml").write_text(scene.replace(shape, shape + shape.replace("m.ply", "n.ply")))
    problem = 'set "antialiased" of the integrator'
    assert describe(tmp_path / "s.xml")[-1].endswith(problem)
    with pytest.raises(DataError, match=problem):
        describe_features(tmp_path / "s.xml")


@pytest.mark.parametrize(("integrator", "last"), [
    ("dogpath", "problems: none found"),
    ("path", "  the integrator PathIntegrator does not know splats: use dogsplat or dogpath"),
])  # fmt: skip
def test_a_scene_of_splats_is_described_as_one(tmp_path, integrator, last):
    """After another variant too, which defines the plugins anew."""
    variant = mi.variant() or ""
    mi.set_variant("scalar_rgb")
    mi.set_variant(variant)
    write_model(tmp_path / "m.ply", Model(tiny_data.truth(), Drawing(linear=True, white=2.0)))
    (tmp_path / "s.xml").write_text(SCENE_OF_SPLATS.replace("INTEGRATOR", integrator))
    lines = describe(tmp_path / "s.xml")
    assert lines[0].endswith("s.xml: Mitsuba scene of splats, not a data set") and lines[-1] == last
    n = tiny_data.truth().n_splats
    assert value_of(lines, "splats").endswith(f"m.ply: {n} primitives, 0 of them DoG, SH degree 1")
    assert value_of(lines, "drawn") == "linear, white 2"
    assert value_of(lines, "other shapes") == "2, 1 of them emit light"
    assert value_of(lines, "other lights") == "1"
    assert value_of(lines, "sensors") == "16x12"


def test_what_the_integrator_says_of_drawing_comes_before_what_the_file_says(tmp_path):
    write_model(tmp_path / "m.ply", Model(tiny_data.truth(), Drawing(near_clip=0.5, scale=2.0)))
    own = '"dogpath"><float name="near_clip" value="0.125"/><boolean name="antialiased" value="true"/></integrator>'
    (tmp_path / "s.xml").write_text(SCENE_OF_SPLATS.replace('"INTEGRATOR"/>', own))
    assert value_of(describe(tmp_path / "s.xml"), "drawn") == "antialiased, near clip 0.125, scale 2"


# --- what it is not ---


def test_anything_else_is_answered_with_what_is_accepted(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    for path in (tmp_path, tmp_path / "notes.txt", tmp_path / "missing"):
        with pytest.raises(DataError, match="a run folder, or a data set") as caught:
            describe(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@dataclasses.dataclass
class Broken:
    name: str
    content: bytes
    words: str


@pytest.mark.parametrize(
    "broken",
    [
        Broken("m.ply", b"not a ply", "m.ply"),
        Broken("transforms.json", b"{", "line 1"),
        Broken("s.xml", b"<scene", "Mitsuba"),
    ],
    ids=lambda broken: broken.name,
)
def test_a_broken_file_of_a_known_kind_is_told_what_is_broken(tmp_path, broken):
    (tmp_path / broken.name).write_bytes(broken.content)
    with pytest.raises(DataError, match=broken.words):
        describe(tmp_path / broken.name)


@pytest.mark.parametrize("name", ["a.ply", "a.glb", "a.sog"])
def test_a_model_is_known_by_its_first_bytes_whatever_it_is_called(tmp_path, name):
    write_model(tmp_path / name, Model(tiny_data.truth()))
    (tmp_path / name).rename(tmp_path / "model")
    assert value_of(describe(tmp_path / "model"), "primitives").startswith("60, ")


def test_the_pictures_of_a_sog_are_no_photographs_and_the_model_is_named(tmp_path):
    write_model(tmp_path / "a.sog", Model(tiny_data.truth()))
    with zipfile.ZipFile(tmp_path / "a.sog") as bundle:
        bundle.extractall(tmp_path / "sog")
    with pytest.raises(DataError, match=r"sog: this is a folder; give the model in it: .*meta\.json$"):
        describe(tmp_path / "sog")
    (tmp_path / "sog" / "meta.json").write_text('{"device": "a phone"}')
    with pytest.raises(DataError, match="has no cameras yet"):
        describe(tmp_path / "sog")


def test_a_broken_run_is_told_too(tmp_path):
    (tmp_path / "config.json").write_text("{")
    with pytest.raises(DataError, match="config.json: not valid JSON"):
        describe(tmp_path)


@pytest.mark.parametrize("name", ["config.json", "history.jsonl", "metrics.json"])
def test_a_file_of_a_run_names_its_folder(tmp_path, name):
    for file in ("config.json", "history.jsonl", "metrics.json"):
        (tmp_path / file).write_text('{"step": 1}\n{"step": 2}\n')
    with pytest.raises(DataError, match=f"{name}: is a file of a run; give its folder: {tmp_path}$"):
        describe(tmp_path / name)


def test_of_what_has_no_cameras_yet_it_says_how_it_gets_them(tmp_path):
    for name in ("pictures/1.jpg", "walk.mp4", "run/posed/poses.json", "run/posed/images/1.jpg", "empty/notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    says = {
        "pictures": "has no cameras yet; dogsplat poses",
        "walk.mp4": "has no cameras yet; dogsplat poses",
        "run": "has not begun to train; give its dogsplat train command",
        "run/posed": "has no poses yet",
        "empty": "not something dogsplat knows",
    }
    for name, words in says.items():
        with pytest.raises(DataError, match=f"{name}: .*{words}"):
            describe(tmp_path / name)
