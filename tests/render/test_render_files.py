"""``dogsplat render``: which camera is taken, what the files hold, and what is said about bad ones."""

from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR
import pytest
import tiny_data
from mi_dogsplat import write_ply
from mi_dogsplat.reference import aovs as reference_aovs
from mi_dogsplat.render.picture import picture_of, render_picture
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.render.render_files import render_model, render_scene
from mi_dogsplat.scene.appearance import Appearance, device_of, radii_squared
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import srgb_to_linear
from rendered_files import read_exr, read_png, render

SENSOR = """<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0, -4, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="20"/><integer name="height" value="16"/>
<string name="pixel_format" value="rgba"/></film></sensor>"""
SPHERE = '<integrator type="path"/><shape type="sphere"/><emitter type="constant"/>'


def scene_file(tmp_path, content) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{content}</scene>')
    return path


# --- models ---


def test_a_view_of_the_data_is_rendered_as_it_was_photographed(model, data, tmp_path):
    render(model, tmp_path / "3.png", data=data, camera="3")
    photograph = read_png(data / "images" / "3.png")
    assert abs(read_png(tmp_path / "3.png").astype(int) - photograph).max() <= 1  # rounding


def test_without_a_name_the_first_test_view_is_taken(model, data, tmp_path):
    render(model, tmp_path / "view.png", data=data)
    photograph = read_png(data / "images" / "0.png")
    assert abs(read_png(tmp_path / "view.png").astype(int) - photograph).max() <= 1


def test_a_view_is_shown_as_the_camera_exposed_it(model, data, tmp_path):
    camera = tiny_data.cameras()[3]
    stored = Appearance(["3"], [device_of(camera)], np.array([[1.0, 1.0, 0.0]]), np.array([[-1.0, 0.0]]))
    stored.write(tmp_path / "appearance.json")
    for name, gains in (("3", [2, 2, 1]), ("4", [1, 1, 1])):  # a view that is not in the file has the mean exposure
        for out, file in (("as_taken.png", tmp_path / "appearance.json"), ("model.png", None)):
            render_model(model, tmp_path / out, data, name, appearance=file)
        shown, plain = (srgb_to_linear(read_png(tmp_path / f"{out}.png") / 255) for out in ("as_taken", "model"))
        expected = np.clip(plain * gains * np.exp2(-radii_squared(camera))[..., None], 0, 1)
        assert np.abs(shown - expected).max() < 0.02 < np.abs(shown - plain).max()
    render_model(model, tmp_path / "plain.png", data)
    stored = Appearance(["0"], [], np.array([[1.0, 1.0, 1.0]]), np.zeros((0, 2)))
    stored.write(tmp_path / "first.json")
    render_model(model, tmp_path / "first.png", data, appearance=tmp_path / "first.json")  # the view of no name
    shown, plain = (srgb_to_linear(read_png(tmp_path / f"{out}.png") / 255) for out in ("first", "plain"))
    assert np.abs(shown - np.clip(2 * plain, 0, 1)).max() < 0.02 < np.abs(shown - plain).max()
    with pytest.raises(DataError, match="--appearance: is for photographs, but the model holds linear radiance; leave"):
        linear = PictureOptions(linear=True)
        render_model(model, tmp_path / "3.exr", data, "3", options=linear, appearance=tmp_path / "first.json")
    with pytest.raises(DataError, match="none.json: cannot be read"):
        render_model(model, tmp_path / "3.png", data, "3", appearance=tmp_path / "none.json")


def test_a_camera_file_gives_the_picture_of_the_view_it_was_written_from(model, data, tmp_path):
    camera = tiny_data.cameras()[3]
    write_camera(tmp_path / "camera.json", camera)
    render(model, tmp_path / "3.png", camera=str(tmp_path / "camera.json"))
    photograph = read_png(data / "images" / "3.png")
    assert abs(read_png(tmp_path / "3.png").astype(int) - photograph).max() <= 1
    render(model, tmp_path / "s.png", camera=str(tmp_path / "camera.json"), downscale=4)
    assert read_png(tmp_path / "s.png").shape == (9, 12, 3)


def test_an_exr_holds_premultiplied_linear_colour_with_alpha_and_depth(model, data, tmp_path):
    render(model, tmp_path / "3.exr", data=data, camera="3", background="white")
    channels = read_exr(tmp_path / "3.exr")
    assert set(channels) == {"RGBA", "depth.Z"}
    expected = tiny_data.picture(tiny_data.truth(), tiny_data.cameras()[3])  # over black, whatever was asked
    assert expected.depth is not None
    np.testing.assert_allclose(channels["RGBA"][..., :3], srgb_to_linear(expected.color), atol=1e-6)
    np.testing.assert_allclose(channels["RGBA"][..., 3], expected.alpha, atol=1e-6)
    np.testing.assert_allclose(channels["depth.Z"], expected.depth, atol=1e-4)
    centre = channels["depth.Z"][18, 24]
    assert 2 < centre < 4  # the camera is 3 away from the middle


def test_an_exr_holds_the_aovs_that_are_asked_for(model, data, tmp_path):
    names = "alpha, depth,median_depth,normal,index,count,dog_share"
    render(model, tmp_path / "3.exr", data=data, camera="3", aovs=names)
    channels = read_exr(tmp_path / "3.exr")
    planes, clearness = reference_aovs.aovs(tiny_data.truth(), tiny_data.cameras()[3])
    expected = {"depth.Z": planes["depth"], "median_depth.Z": planes["median_depth"], "index.I": planes["index"],
                "count.I": planes["count"], "dog_share.Y": planes["dog_share"],
                **{f"normal.{axis}": planes["normal"][..., k] for k, axis in enumerate("XYZ")}}  # fmt: skip
    assert set(channels) == {"RGBA", *expected}
    clear = (clearness > 1e-3) & ((planes["alpha"] == 0) | (planes["alpha"] > 0.02))
    assert clear.mean() > 0.8
    for name, plane in expected.items():
        assert channels[name].dtype == np.float32
        np.testing.assert_allclose(channels[name][clear], plane[clear], atol=5e-3, err_msg=name)
    render(model, tmp_path / "bare.exr", data=data, camera="3", aovs="")
    assert set(read_exr(tmp_path / "bare.exr")) == {"RGBA"}


@pytest.mark.parametrize(
    ("name", "aovs", "message"),
    [
        ("v.exr", "depth,albedo", '--aovs: unknown AOV "albedo"; available are alpha, depth'),
        ("v.exr", "depth,depth", '--aovs: the AOV "depth" is there twice; name it once'),
        ("v.exr", "depth; normal", '--aovs: unknown AOV "depth; normal"; available are alpha, depth'),
        ("v.png", "depth", "--aovs: .*v.png cannot hold them; name a file that ends in .exr"),
    ],
)
def test_aovs_that_cannot_be_written_are_refused(model, tmp_path, name, aovs, message):
    with pytest.raises(DataError, match=message):
        render(model, tmp_path / name, aovs=aovs)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "depth"), [("v.exr", True), ("v.png", False)])
def test_depth_is_blended_for_files_that_hold_it_only(model, tmp_path, monkeypatch, name, depth):
    asked = []

    def recorded(params, camera, options, *others, **named):
        asked.append(options.depth)
        return render_picture(params, camera, options, *others, **named)

    monkeypatch.setattr("mi_dogsplat.render.picture.render_picture", recorded)
    render(model, tmp_path / name)
    assert asked == [depth]


def test_an_npz_holds_the_picture_over_black_as_arrays(model, data, tmp_path):
    render(model, tmp_path / "3.npz", data=data, camera="3", background="white")
    expected = tiny_data.picture(tiny_data.truth(), tiny_data.cameras()[3])
    with np.load(tmp_path / "3.npz") as arrays:
        assert set(arrays) == {"color", "alpha", "depth"}
        for name, values in arrays.items():
            np.testing.assert_array_equal(values, getattr(expected, name))
    with pytest.raises(DataError, match="only written for models"):
        render_scene(scene_file(tmp_path, SPHERE + SENSOR), tmp_path / "s.npz")


def test_an_npz_of_a_linear_model_holds_its_radiance_as_an_exr_does(model, data, tmp_path):
    for name in ("3.npz", "3.exr"):
        render_model(model, tmp_path / name, data, "3", options=PictureOptions(linear=True, white=0.1))
    radiance = read_exr(tmp_path / "3.exr")["RGBA"][..., :3]
    with np.load(tmp_path / "3.npz") as arrays:
        np.testing.assert_allclose(arrays["color"], radiance, rtol=1e-5, atol=1e-6)


def test_a_white_that_the_model_does_not_go_by_is_refused(model, tmp_path):
    with pytest.raises(DataError, match="--white: is for linear radiance, but the model has sRGB colours"):
        render_model(model, tmp_path / "view.png", options=PictureOptions(white=3.0))


def test_the_background_of_a_png_is_chosen_and_white_for_data_with_alpha(model, tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", n=2, alpha=True)
    for background, corner in (("auto", 255), ("white", 255), ("black", 0)):
        render(model, tmp_path / "v.png", data=data, background=background)
        assert abs(int(read_png(tmp_path / "v.png")[0, 0].mean()) - corner) < 5
    render(model, tmp_path / "v.png")
    assert read_png(tmp_path / "v.png")[0, 0].max() == 0


def test_a_view_is_told_by_its_image_too(model, data, tmp_path, monkeypatch):
    render(model, tmp_path / "name.exr", data=data, camera="3")
    monkeypatch.chdir(data)
    for k, told in enumerate(("3.png", "3.JPG", "images/3.png", str(data / "images" / "3.png"))):
        render(model, tmp_path / f"{k}.exr", data=data, camera=told)
        assert (tmp_path / f"{k}.exr").read_bytes() == (tmp_path / "name.exr").read_bytes()
    monkeypatch.chdir(data.parent)
    for given, told in ((data.name, "images/3.png"), (f"{data.name}/transforms.json", f"{data.name}/images/3.png")):
        render(model, tmp_path / "from_above.exr", data=given, camera=told)
        assert (tmp_path / "from_above.exr").read_bytes() == (tmp_path / "name.exr").read_bytes()


def test_a_view_is_rendered_where_the_photographs_do_not_fit_into_memory(model, data, tmp_path, monkeypatch):
    monkeypatch.setattr("mi_dogsplat.datasets.view_images.available_memory", lambda: 1)  # byte
    render(model, tmp_path / "v.png", data, "3")
    assert read_png(tmp_path / "v.png").shape[:2] == (36, 48)


def test_an_unknown_view_is_answered_with_close_names(model, data, tmp_path):
    with pytest.raises(DataError, match='"33" is not a view of .* it has 8, such as 3$'):
        render(model, tmp_path / "v.png", data=data, camera="33")
    with pytest.raises(DataError, match="it has 8, such as 0, 1, 2, 3, 4$"):
        render(model, tmp_path / "v.png", data=data, camera="DSC_0815")
    with pytest.raises(DataError, match='--camera: "3" is not a .json file; add --data'):
        render(model, tmp_path / "v.png", camera="3")


def test_a_camera_file_and_data_are_not_both_looked_at(model, data, tmp_path):
    with pytest.raises(DataError, match="--data: is for views by name, but --camera names a file; leave one"):
        render(model, tmp_path / "v.png", data=data, camera="camera.json")


@pytest.mark.parametrize("name", ["v.jpg", "v", "v.ply"])
def test_an_unknown_picture_format_is_refused_before_anything_else(tmp_path, name):
    with pytest.raises(DataError, match=r"ends in .png, .exr, .npz"):
        render(tmp_path / "missing.ply", tmp_path / name)


def test_a_place_that_cannot_be_written_is_named(model, tmp_path):
    (tmp_path / "file").write_text("")
    for name in ("v.png", "v.exr"):
        out = tmp_path / "file" / name
        with pytest.raises(DataError, match="cannot be written"):
            render(model, out)
        with pytest.raises(DataError, match="cannot be written"):
            render_scene(scene_file(tmp_path, SPHERE + SENSOR), out)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(DataError, match="is a folder"):
        render(model, tmp_path / "folder.png")


def test_without_primitives_there_is_background_without_depth():
    picture = picture_of(Splats.empty(1), 1.0, aovs=("depth",))(tiny_data.cameras()[0])
    assert picture.depth is not None
    assert picture.color.min() == 1 and picture.alpha.max() == 0 and picture.depth.max() == 0


# --- Mitsuba scenes ---


def test_where_nothing_can_be_written_is_said_before_a_scene_is_drawn(tmp_path, monkeypatch):
    def drawn(*_, **__):
        raise AssertionError("the scene is drawn")

    monkeypatch.setattr("mitsuba.render", drawn)
    path = scene_file(tmp_path, SPHERE + SENSOR)
    before = sorted(tmp_path.iterdir())
    for out in (path / "s.png", path / "new" / "s.exr"):  # in a file that is no folder
        with pytest.raises(DataError, match=rf"^{out}: cannot be written"):
            render_scene(path, out)
    assert sorted(tmp_path.iterdir()) == before


def test_a_scene_is_written_linear_as_exr_and_encoded_as_png(tmp_path):
    path = scene_file(tmp_path, SPHERE + SENSOR)
    render_scene(path, tmp_path / "s.exr")
    render_scene(path, tmp_path / "s.png")
    linear = read_exr(tmp_path / "s.exr")["RGBA"]
    assert linear.shape == (16, 20, 4) and 0.3 < linear[8, 10, 0] < 0.7  # albedo 0.5 under a white sky
    encoded = read_png(tmp_path / "s.png")
    expected = 255 * np.array(mi.math.linear_to_srgb(mi.Float(linear[..., :3].astype(np.float32).ravel())))
    assert encoded.shape == (16, 20, 3)
    assert abs(encoded.ravel() - expected).max() < 2


FILMS = {"luminance": {"Y"}, "rgb": {"R", "G", "B"}, "xyz": {"X", "Y", "Z"}}


@pytest.mark.parametrize("pixels", FILMS)
def test_a_scene_keeps_the_channels_of_its_film(tmp_path, pixels):
    render_scene(scene_file(tmp_path, SPHERE + SENSOR.replace('"rgba"/>', f'"{pixels}"/>')), tmp_path / "s.exr")
    with OpenEXR.File(str(tmp_path / "s.exr"), separate_channels=True) as file:
        found = {name: channel.pixels for name, channel in file.channels().items()}
    assert set(found) == FILMS[pixels]
    for plane in found.values():
        assert plane.dtype == np.float32 and plane.shape == (16, 20) and 0.3 < plane[8, 10] < 0.7


def test_a_scene_with_a_dog_shape_shows_the_model(model, tmp_path):
    shape = f'<shape type="dog"><string name="filename" value="{model}"/></shape>'
    integrator = '<integrator type="dogsplat"><string name="aovs" value="depth"/></integrator>'
    path = scene_file(tmp_path, integrator + shape + SENSOR)
    render_scene(path, tmp_path / "s.exr")
    channels = read_exr(tmp_path / "s.exr")
    assert set(channels) == {"RGBA", "depth.Z"}
    render_scene(path, tmp_path / "s.png")  # the AOV stays out of it
    assert read_png(tmp_path / "s.png")[8, 10].max() > 20


@pytest.mark.parametrize("integrator", ["path", "dogsplat"])
def test_splats_that_the_integrator_leaves_out_are_warned_of(model, tmp_path, capfd, integrator):
    shape = f'<shape type="dog"><string name="filename" value="{model}"/></shape>'
    render_scene(scene_file(tmp_path, f'<integrator type="{integrator}"/>{shape}{SENSOR}'), tmp_path / "s.png")
    told = "scene.xml: 1 dog shape not seen; use the integrator dogsplat or dogpath" in "".join(capfd.readouterr())
    assert told == (integrator == "path")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (SPHERE, "has no sensor"),
        (SENSOR, "has no integrator"),
        ('<integrator type="dogsplat"/>' + SENSOR, 'no shape of type "dog"'),
        (
            '<integrator type="moment"><integrator type="dogsplat"/></integrator>' + SENSOR,
            "cannot be nested in another integrator",
        ),
        ('<integrator type="walk"/>', 'Plugin "walk" not found'),
        ('<shape type="dog"><string name="filename" value="/no.ply"/></shape>', "/no.ply: cannot be read"),
        ("<sensor", "[Pp]arsing"),
    ],
)
def test_what_mitsuba_says_about_a_scene_becomes_one_line(tmp_path, content, message):
    with pytest.raises(DataError, match=message) as caught:
        render_scene(scene_file(tmp_path, content), tmp_path / "s.png")
    line = str(caught.value)
    assert "\n" not in line and "Traceback" not in line and "scene.xml" in line
    assert not (tmp_path / "s.png").exists()


def test_a_scene_is_not_rendered_for_a_format_that_has_no_room_for_it(tmp_path):
    with pytest.raises(DataError, match="s.npz: arrays are only written for models"):
        render_scene(scene_file(tmp_path, "what no scene holds"), tmp_path / "s.npz")


def test_a_scene_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DataError, match=r"no\.xml: no such file"):
        render_scene(tmp_path / "no.xml", tmp_path / "s.png")


def test_ctrl_c_while_a_scene_is_rendered_is_no_fault_of_the_scene(tmp_path):
    """Dr.Jit says it in an error of its own."""
    write_ply(tmp_path / "m.ply", tiny_data.truth())
    (tmp_path / "s.xml").write_text(
        '<scene version="3.0.0"><integrator type="dogsplat"/><shape type="dog"><string name="filename" value="m.ply"/>'
        '</shape><sensor type="perspective"><film type="hdrfilm"><integer name="width" value="8"/>'
        '<integer name="height" value="6"/></film></sensor></scene>'
    )

    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_scene(tmp_path / "s.xml", tmp_path / "s.png", 2, stop)
    assert not (tmp_path / "s.png").exists()
