"""Models of every format: SPZ by the reader of the add-on, others by the package; drawn as their files say."""

import gzip
import shlex
import shutil

import bpy
import numpy as np
import pytest
from model_files import load
from package_command import COMMAND
from references import REFERENCES, reference

from blender_addon.files.errors import FileError
from blender_addon.files.light import Light
from blender_addon.files.ply import read_ply
from blender_addon.files.read import EXTENSIONS, read_model
from blender_addon.files.said import Said, direction, said_in
from blender_addon.files.sh import C0
from blender_addon.files.spz import read_spz
from blender_addon.import_export import import_operator
from blender_addon.nodes.modifier import get_input, splat_modifier
from blender_addon.objects.conventions import conversion
from blender_addon.package import renderers


def unwanted(path, out):
    raise AssertionError(f"{path} needs no package")


def of(obj, *names):
    return [get_input(splat_modifier(obj), name) for name in names]


@pytest.fixture
def in_preferences(monkeypatch):
    """The command of the package, as if the preferences named it."""
    monkeypatch.setattr(import_operator, "command_of", lambda context: shlex.join(COMMAND))


def test_spz_is_read_without_the_package_and_gives_its_numbers():
    found, antialiased = read_spz(REFERENCES / "plain.spz")
    expected = reference("spz")
    assert antialiased and found.n_splats == len(expected["means"]) == 150 and not found.is_dog.any()
    for name in ("means", "log_scales", "logit_opacities", "sh_coeffs"):
        assert np.allclose(getattr(found, name), expected[name], atol=1e-5), name
    cosine = np.abs((found.quats * expected["quats"][:, [3, 0, 1, 2]]).sum(axis=1))
    assert cosine.min() > 1 - 1e-6


def test_ply_and_spz_need_no_package():
    assert read_model(REFERENCES / "plain.spz", unwanted)[1] == Said(antialiased=True)
    model, said = read_model(REFERENCES / "says.ply", unwanted)
    assert model.is_dog.any() and said == Said(True, 0.05, False, (0, -1, 0), 2.0)
    assert read_model(REFERENCES / "dog.ply", unwanted)[1] == Said()


def test_an_spz_of_linear_radiance_says_so_in_its_gzip_header(tmp_path):
    data = (REFERENCES / "plain.spz").read_bytes()
    comment = b"dogsplat linear true\ndogsplat white 4.0\0"
    (tmp_path / "a.spz").write_bytes(data[:3] + bytes([16]) + data[4:10] + comment + data[10:])
    (plain, _), (model, said) = (read_model(path, unwanted) for path in (REFERENCES / "plain.spz", tmp_path / "a.spz"))
    assert said == Said(antialiased=True, linear=True, white=4.0)
    assert np.allclose(model.sh_coeffs[:, 1:], 4 * plain.sh_coeffs[:, 1:])
    assert np.allclose(0.5 + C0 * model.sh_coeffs[:, 0], 4 * (0.5 + C0 * plain.sh_coeffs[:, 0]), atol=1e-5)


def test_radiance_of_a_linear_spz_is_that_of_the_package():
    model, said = read_model(REFERENCES / "linear.spz", unwanted)
    assert said.light == Light(True, 2.5)
    expected = reference("linear_spz")["sh_coeffs"]
    assert expected.max() > 50
    assert np.allclose(model.sh_coeffs, expected, rtol=1e-4, atol=1e-4)


def test_colours_by_sh_degree_are_filled_up_with_zeros():
    rows, padded = read_ply(REFERENCES / "rows.ply"), read_ply(REFERENCES / "padded.ply")
    assert rows.sh_degree == 3 and rows.is_dog.any()
    for name, values in vars(padded).items():
        assert np.array_equal(getattr(rows, name), values), name
    obj = load(REFERENCES / "rows.ply")
    assert len(obj.data.vertices) == 150


@pytest.mark.parametrize("suffix", [".spz", ".glb", ".usdz", ".sog", ".splat", ".compressed.ply"])
def test_every_format_is_imported(suffix, in_preferences):
    name = f"plain{suffix}"
    obj = load(REFERENCES / name)
    assert len(obj.data.vertices) == 150 and obj["dogsplat_source"].endswith(name)
    assert of(obj, "Antialiased") == [name != "plain.splat"]
    means = np.empty(450, np.float32)
    obj.data.attributes["position"].data.foreach_get("vector", means)
    raw = read_ply(REFERENCES / "plain.ply")
    distance = np.abs(means.reshape(-1, 1, 3) - raw.means).max(axis=-1)
    assert distance.min(axis=0).max() < 0.01


def test_what_the_file_says_is_taken_unless_the_option_is_set():
    obj = load(REFERENCES / "says.ply")
    assert of(obj, "Antialiased", "Near Clip") == [True, pytest.approx(0.1)]  # 0.05 times the scale
    turned = load(REFERENCES / "dog.ply", up_axis="-Y", scale=2.0)
    assert np.allclose(obj.matrix_world, turned.matrix_world)
    told = load(REFERENCES / "says.ply", antialiased=False, up_axis="Z", scale=1.0)
    assert of(told, "Antialiased") == [False] and np.allclose(told.matrix_world, np.eye(4))
    left = load(REFERENCES / "says.ply", place=False)
    assert of(left, "Near Clip") == [pytest.approx(0.05)] and np.allclose(left.matrix_world, np.eye(4))


@pytest.mark.parametrize("system, length, metres", [("METRIC", 0.01, 0.01), ("IMPERIAL", 0.5, 0.5), ("NONE", 0.01, 1)])
def test_metres_of_the_file_are_metres_of_the_scene(scene, system, length, metres):
    """Whatever a unit of the scene is; a scale that is set by hand is in units."""
    scene.unit_settings.system, scene.unit_settings.scale_length = system, length
    obj = load(REFERENCES / "says.ply")
    assert obj.scale.x * metres == pytest.approx(2.0) and of(obj, "Near Clip") == [pytest.approx(0.1 / metres)]
    assert load(REFERENCES / "says.ply", scale=3.0).scale.x == pytest.approx(3.0)


@pytest.mark.parametrize("name", ["x", "-x", "-z", "0.2,-0.9,0.4", "3,4,12"])
def test_what_is_up_in_the_file_is_up_in_blender(name):
    up = direction(name)
    assert up is not None and said_in([f"dogsplat up {name}"]).up == up
    matrix = np.array(conversion(up, 2.0))
    assert matrix[:3, :3] @ up == pytest.approx(2 * np.linalg.norm(up) * np.array([0, 0, 1]), abs=1e-5)
    assert matrix[:3, :3] @ matrix[:3, :3].T == pytest.approx(4 * np.eye(3), abs=1e-5)
    assert np.linalg.det(matrix) == pytest.approx(8, abs=1e-4)


@pytest.mark.parametrize("name", ["x", "-z", "0.2,-0.9,0.4", "3,4,12"])
def test_a_model_lies_where_blender_puts_a_gltf_or_openusd_of_it(name):
    """Those are turned from up to -y the shortest way, about what lies across both; y up becomes Blender's z then."""
    up = direction(name)
    across = np.cross(up, (0, -1, 0))
    x, y, z = across
    assert np.array(conversion(up, 1.0))[:3, :3] @ across == pytest.approx(np.array([x, z, -y]), abs=1e-5)


def test_comments_that_make_no_sense_are_passed_over():
    assert said_in(["dogsplat near_clip nan", "dogsplat scale 0", "dogsplat up 1,2", "dogsplat", "hello"]) == Said()
    assert said_in(["Vertical axis: y", "SplatRenderMode: mip"]) == Said(antialiased=True, up=(0, -1, 0))
    assert said_in(["SplatRenderMode: mip", "dogsplat antialiased false"]) == Said(antialiased=False)


def test_without_the_package_a_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(renderers.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(RuntimeError, match="plain.glb: only the package reads this format.*pip install"):
        load(REFERENCES / "plain.glb")
    load(REFERENCES / "plain.spz")


def test_a_broken_file_is_one_line_that_names_it(tmp_path, in_preferences):
    data = (REFERENCES / "plain.spz").read_bytes()
    contents = {"a.spz": data[:100], "b.spz": data[:2], "c.spz": b"\x1f\x8b" + bytes(50), "d.glb": b"glTF and no more"}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RuntimeError, match=name) as caught:
            load(tmp_path / name)
        assert str(tmp_path) in str(caught.value) and len(str(caught.value).strip().splitlines()) == 1
    with pytest.raises(FileError, match="this is a folder"):
        read_model(tmp_path, unwanted)


def test_an_spz_is_compared_with_its_check_sum(tmp_path):
    data = (REFERENCES / "plain.spz").read_bytes()
    for broken in (data[:-1], data[:-8], data[:-8] + bytes([data[-8] ^ 1]) + data[-7:]):
        (tmp_path / "a.spz").write_bytes(broken)
        with pytest.raises(FileError, match="check"):
            read_spz(tmp_path / "a.spz")


@pytest.mark.parametrize("version", [2, 3])
def test_a_damaged_spz_is_read_or_refused_in_one_line(tmp_path, version):
    raw = bytearray(gzip.decompress((REFERENCES / "plain.spz").read_bytes()))
    raw[4] = version
    chance, refused = np.random.default_rng(version), 0
    for _ in range(300):
        damaged = bytearray(raw)
        for at in chance.integers(0, 24, 2):  # the header and a little more
            damaged[at] = chance.choice([0, 1, 2, 3, 4, 127, 255, damaged[at]])
        data = gzip.compress(bytes(damaged[: chance.choice([8, 16, 500, len(raw)])]))
        (tmp_path / "a.spz").write_bytes(data[: chance.choice([len(data), len(data), 12])])
        try:
            read_spz(tmp_path / "a.spz")
        except FileError as error:
            refused += 1
            assert "a.spz" in str(error) and len(str(error).splitlines()) == 1
    assert refused > 100


def test_the_file_selector_and_drag_and_drop_take_all():
    assert import_operator.DOGSPLAT_FH_model.bl_file_extensions == ";".join(EXTENSIONS)
    glob = bpy.ops.import_scene.dogsplat.get_rna_type().properties["filter_glob"].default
    assert glob == ";".join(f"*{extension}" for extension in EXTENSIONS)
