"""Where down was, as files say it: written here tag by tag, as phones and drones do."""

import io
import struct

import numpy as np
import pytest
from apple_notes import apple_note
from heif_files import picture, write_heif
from mi_dogsplat.datasets.images import open_image
from mi_dogsplat.poses.exif import read_exif
from mi_dogsplat.poses.photographs import prepare
from mi_dogsplat.poses.world import place
from mi_dogsplat.scene.cameras import inverse_rigid
from PIL import ExifTags, Image, ImageOps

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")
ORIENTATION, EXIF, NOTE, LENS, ELEVATION = 0x0112, 0x8769, 0x927C, 0xA434, 0x9405
# How a phone is held, level: gravity along its axes (right and top of the screen, out of it; Core Motion), and the
# orientation that it writes (Apple, "UIImage.Orientation"): portrait, turned left, turned right, upside down.
HOLDS = {(0, -1, 0): 6, (-1, 0, 0): 1, (1, 0, 0): 3, (0, 1, 0): 8}


def saved(orientation: int = 1, inner: dict | None = None, xmp: str | None = None) -> Image.Image:
    """A JPEG with these tags, opened again."""
    exif, file = Image.Exif(), io.BytesIO()
    exif[ORIENTATION] = orientation
    exif.get_ifd(EXIF).update(inner or {})
    Image.new("RGB", (8, 6)).save(file, "JPEG", exif=exif, **({} if xmp is None else {"xmp": xmp.encode()}))
    return Image.open(file)


def looking_down(degrees: float) -> list[float]:
    """Where down is for a level camera that looks below the horizon: x right, y down, z ahead."""
    return [0, np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]


@pytest.mark.parametrize(("gravity", "orientation"), HOLDS.items())
@pytest.mark.parametrize(("degrees", "order"), [(0, ">"), (30, "<"), (-20, ">")])
def test_a_phone_held_level_has_down_below_its_picture_however_it_is_turned(gravity, orientation, degrees, order):
    level, ahead = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    acceleration = np.array(gravity) * level + (0, 0, -ahead)  # the camera at the back looks along -z
    found = read_exif(saved(orientation, {NOTE: apple_note(0.98 * acceleration, order=order)})).down
    assert found == pytest.approx(looking_down(degrees), abs=2e-4)


@pytest.mark.parametrize(("gravity", "orientation"), HOLDS.items())
def test_heif_comes_upright_and_its_gravity_is_turned_all_the_same(tmp_path, gravity, orientation):
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    exif.get_ifd(EXIF)[NOTE] = apple_note(gravity)
    with open_image(write_heif(tmp_path / "a.heic", picture(), exif=exif.tobytes())) as image:
        found = read_exif(image)
    assert found.turn is None and found.down == pytest.approx(looking_down(0), abs=1e-9)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_down_turns_with_the_pixels_as_pillow_turns_them(orientation):
    inner = {NOTE: apple_note((0.3, -0.8, 0.5))}
    down = read_exif(saved(1, inner)).down
    assert down is not None
    x, y, z = down
    rows, columns = np.indices((6, 8))
    picture = Image.fromarray((x * columns + y * rows).astype(np.float32))  # it rises towards down
    picture.getexif()[ORIENTATION] = orientation
    by_row, by_column = np.gradient(np.asarray(ImageOps.exif_transpose(picture)))
    expected = by_column.mean(), by_row.mean(), z
    assert read_exif(saved(orientation, inner)).down == pytest.approx(expected, abs=1e-5)


LEVEL = apple_note((0, -1, 0))


@pytest.mark.parametrize("inner", [
    {NOTE: apple_note((0, -1, 0), front=True)}, {NOTE: LEVEL, LENS: "iPhone Front camera"},
    {NOTE: apple_note((0, -0.6, 0))}, {NOTE: apple_note((0, -1.4, 0))},
    {NOTE: apple_note((0, -1, 0), kind=5)}, {NOTE: apple_note((0, -1, 0), count=1)},
    {NOTE: LEVEL.replace(struct.pack(">i", 10_000), bytes(4))}, {NOTE: LEVEL.replace(b"MM", b"??")},
    {NOTE: LEVEL.replace(b"Apple", b"Other")}, {NOTE: LEVEL[:40]}, {NOTE: b"Apple iOS\0"}, {NOTE: b"Nikon"}, {},
])  # fmt: skip
def test_nothing_is_taken_of_the_front_camera_a_shaken_phone_or_what_is_broken(inner):
    assert read_exif(saved(6, inner)).down is None


@pytest.mark.parametrize(("xmp", "down"), [
    ('<rdf:Description drone-dji:GimbalPitchDegree="-90.00" drone-dji:GimbalRollDegree="+0.00"/>', [0, 0, 1]),
    ('<x drone-dji:GimbalRollDegree="+0.00" drone-dji:GimbalPitchDegree="-30.0"/>', looking_down(30)),
    ("<drone-dji:GimbalPitchDegree>+10.5</drone-dji:GimbalPitchDegree>", looking_down(-10.5)),
    ('<x drone-dji:GimbalPitchDegree="-30.0" drone-dji:GimbalRollDegree="+90.0"/>', [np.sqrt(0.75), 0, 0.5]),
    ('<x drone-dji:GimbalYawDegree="+10"/>', None),
])  # fmt: skip
def test_a_drone_says_how_its_camera_was_turned(xmp, down):
    found = read_exif(saved(xmp=xmp)).down
    assert found is None if down is None else found == pytest.approx(down, abs=1e-9)


def test_the_elevation_of_exif_is_of_the_picture_as_it_is_shown():
    found = read_exif(saved(6, {ELEVATION: -25.0})).down
    assert found == pytest.approx(looking_down(25), abs=1e-6) and ExifTags.Base.CameraElevationAngle == ELEVATION
    assert read_exif(saved(6, {ELEVATION: -90.0})).down == pytest.approx((0, 0, 1), abs=1e-6)
    assert read_exif(saved(6, {ELEVATION: 180.0})).down is read_exif(saved(6, {ELEVATION: -180.0})).down is None


def test_it_stays_with_the_photograph(tmp_path):
    exif = Image.Exif()
    exif[ORIENTATION] = 6
    exif.get_ifd(EXIF)[NOTE] = apple_note((0, -1, 0))
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg", exif=exif)
    (photograph,) = prepare({"a.jpg": tmp_path / "a.jpg"}, tmp_path / "out", lambda done, n: None)
    assert photograph.down == pytest.approx((0, 1, 0), abs=1e-9)


def cameras_and_downs(noise: float = 0.0):
    """A model of pycolmap's whose cameras are rolled by half a radian, and where down was for each of them."""
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=6, num_points3D=50)
    model, rng = pycolmap.synthesize_dataset(options), np.random.default_rng(0)
    up, downs = np.array([0.48, 0.6, 0.64]), {}
    for image in model.images.values():
        w2c = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
        down = w2c[:3, :3] @ -up + noise * rng.normal(size=3)
        downs[image.name] = down / np.linalg.norm(down)
    return model, downs


def directions(model, downs) -> np.ndarray:
    """Down as the cameras have it, in the world of the model."""
    w2c = {image.name: np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]]) for image in model.images.values()}
    poses = {name: inverse_rigid(matrix) for name, matrix in w2c.items()}
    return np.array([poses[name][:3, :3] @ down for name, down in downs.items()])


def test_what_images_say_comes_before_how_they_were_held_and_one_that_was_shaken_does_not_count():
    model, downs = cameras_and_downs()
    downs[sorted(downs)[0]] = np.array([1.0, 0, 0])
    placed = place(pycolmap, model, None, downs)
    assert np.median(directions(model, downs) @ [0, 1, 0]) == pytest.approx(1, abs=1e-4)
    assert placed.up_from == "as 6 images say where down is; they agree to 0.0 degrees" and placed.world.up == "-y"


def test_images_that_disagree_or_are_few_do_not_count():
    model, downs = cameras_and_downs(noise=2.0)
    assert "6 images say where down is, but disagree" in place(pycolmap, model, None, downs).up_from
    for n, said in (2, "no image says where down is"), (3, "as 3 images say where down is"):
        model, downs = cameras_and_downs()
        assert said in place(pycolmap, model, None, dict(list(downs.items())[:n])).up_from


@pytest.mark.parametrize("degrees, said", [(9, "6 images say where down is; they agree to 9.0 degrees"),
                                           (11, "6 images say where down is, but disagree")])  # fmt: skip
def test_most_of_the_images_agree_to_ten_degrees(degrees, said):
    model, downs = cameras_and_downs()
    place(pycolmap, model, None, downs)  # down is y now
    around, across = np.radians(60 * np.arange(6)), np.sin(np.radians([5, degrees, degrees] * 2))
    world = np.stack([across * np.cos(around), np.sqrt(1 - across**2), across * np.sin(around)], -1)
    images = model.images.values()
    off = {image.name: image.cam_from_world().rotation * down for image, down in zip(images, world, strict=True)}
    assert said in place(pycolmap, model, None, off).up_from
    if degrees < 10:
        np.testing.assert_allclose(directions(model, off).mean(axis=0), [0, world[:, 1].mean(), 0], atol=1e-6)
