"""``dogsplat mesh``: the surface of a model of known shape and colours; bad input in a line."""

import io
import shutil
from dataclasses import replace

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import write_ply
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.datasets.world import World, write_world
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.formats.gltf_container import Container, matrix_of
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.packing import LUF
from mi_dogsplat.formats.placed import placing
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.meshing.make import make_mesh
from mi_dogsplat.meshing.mesh_config import MeshConfig
from mi_dogsplat.meshing.surface import surface_of
from mi_dogsplat.render.framing import robust_sphere
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.render.vantages import vantage_cameras
from mi_dogsplat.runs.inputs import note_inputs
from mi_dogsplat.scene.appearance import APPEARANCE, Appearance, device_of, photographed, radii_squared
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.drawing import Drawing, DrawnAs
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig
from PIL import Image
from splat_scenes import make_splats, rounded

RADIUS, CENTRE = 0.7, np.array([0.2, -0.1, 0.3])
FAST = ["--views", "12", "--size", "80", "60", "--inside", "0"]


def ball(n=3000, colors=None) -> Splats:
    """Opaque discs on a sphere, red above and blue below."""
    k = np.arange(n) + 0.5
    z, angle = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    normals = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], 1)
    half = np.sqrt((1 + z) / 2)  # turns z to the normal
    quats = np.column_stack([-normals[:, 1] / (2 * half), normals[:, 0] / (2 * half), np.zeros(n), half])
    if colors is None:
        colors = np.where(z[:, None] > 0, [1, 0.1, 0], [0, 0.2, 1])
    return rounded(make_splats(CENTRE + RADIUS * normals, (0.03, 0.03, 1e-3), 0.95, colors, quats=quats))


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.ply"
    write_ply(path, ball())
    return path


def vertices_of(path) -> tuple[np.ndarray, np.ndarray]:
    """Positions and colours of an .obj."""
    rows = np.array([line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], float)
    return rows[:, :3], rows[:, 3:]


def meshed(capsys, model, out, *flags) -> str:
    """What the command says."""
    status, said, error = run(capsys, "mesh", model, "-o", out, *FAST, *flags)
    assert status == 0, error
    return said


def test_a_ball_is_a_ball_with_its_colours(model, tmp_path, capsys):
    out = tmp_path / "surface.obj"
    said = meshed(capsys, model, out, "--voxel", "0.04")
    positions, colors = vertices_of(out)
    distances = np.linalg.norm(positions - CENTRE, axis=1)
    np.testing.assert_allclose(distances.mean(), RADIUS, atol=0.02)  # half a voxel
    assert abs(distances - RADIUS).max() < 2 * 0.03  # deviations of a disc, whose depth is that of its centre
    z = positions[:, 2] - CENTRE[2]
    assert z.min() < -0.65 and z.max() > 0.65
    np.testing.assert_allclose(colors[z > 0.15].mean(axis=0), [1, 0.1, 0], atol=0.05)
    np.testing.assert_allclose(colors[z < -0.15].mean(axis=0), [0, 0.2, 1], atol=0.05)
    n = sum(line.startswith("f ") for line in out.read_text().splitlines())
    assert said.splitlines()[-1] == f"{out}: {n:,} triangles from 12 views; a voxel is 0.04"


def test_a_ball_of_few_triangles_is_that_ball(model, tmp_path, capsys):
    out, off = tmp_path / "surface.obj", []
    for flags in ((), ("--faces", "300")):
        meshed(capsys, model, out, "--voxel", "0.06", *flags)
        positions, colors = vertices_of(out)
        off.append(abs(np.linalg.norm(positions - CENTRE, axis=1) - RADIUS).max())
    assert sum(line.startswith("f ") for line in out.read_text().splitlines()) <= 300
    assert off[1] < off[0] + 0.02
    z = positions[:, 2] - CENTRE[2]
    np.testing.assert_allclose(colors[z > 0.2].mean(axis=0), [1, 0.1, 0], atol=0.05)
    np.testing.assert_allclose(colors[z < -0.2].mean(axis=0), [0, 0.2, 1], atol=0.05)


def test_a_ball_of_few_triangles_has_its_colours_in_a_texture(model, tmp_path, capsys):
    out = tmp_path / "surface.glb"
    meshed(capsys, model, out, "--voxel", "0.06", "--faces", "300", "--texture", "128")
    file = Container.open(out)
    attributes = file.content["meshes"][0]["primitives"][0]["attributes"]
    points, uv = (file.accessor(attributes[name]) for name in ("POSITION", "TEXCOORD_0"))
    picture = np.asarray(Image.open(io.BytesIO(file.view(file.content["images"][0]["bufferView"]))))
    assert picture.shape == (128, 128, 3)
    column, row = np.clip((128 * uv).astype(int), 0, 127).T
    z = points[:, 2] - CENTRE[2]
    np.testing.assert_allclose(picture[row, column][z > 0.2].mean(axis=0) / 255, [1, 0.1, 0], atol=0.07)
    np.testing.assert_allclose(picture[row, column][z < -0.2].mean(axis=0) / 255, [0, 0.2, 1], atol=0.07)


def test_the_voxel_follows_the_size_of_the_model(model, tmp_path, capsys):
    said = meshed(capsys, model, tmp_path / "surface.ply")
    assert said.endswith(f"a voxel is {robust_sphere(ball())[1] / 128:.4g}\n")


def test_the_views_of_data_are_fused(tmp_path, capsys):
    """A camera sees a half: the rest of the ball has no mesh."""
    write_ply(tmp_path / "model.ply", ball())
    data = tiny_data.write_tiny_data(tmp_path / "data", n=2)  # one to train, one to test
    for image in (data / "images").iterdir():  # of which the cameras alone are asked for
        image.write_bytes(image.read_bytes()[:-200])
    out = tmp_path / "surface.obj"
    flags = ["mesh", tmp_path / "model.ply", "-o", out, "--data", data, "--voxel", "0.04"]
    status, said, error = run(capsys, *flags)
    assert status == 0 and "from 1 view;" in said, error
    positions = vertices_of(out)[0] - CENTRE
    toward = (3 * np.array([-1, 0, -0.3]) - CENTRE) / np.linalg.norm(3 * np.array([-1, 0, -0.3]) - CENTRE)
    assert (positions @ toward).min() > -0.3
    assert (positions @ toward).max() > 0.6


@pytest.mark.parametrize("how", [["--faces", "600", "--texture", "64"], []], ids=["texture", "vertices"])
def test_colours_are_those_of_the_photographs_where_their_masks_are_white(tmp_path, capsys, how):
    """Of a model in which all is red and blue, photographs show the left half green. The rest is grey or as beside."""
    write_ply(tmp_path / "model.ply", ball())
    data = tiny_data.write_tiny_data(tmp_path / "data", n=9)
    (tmp_path / "masks").mkdir()
    for image in (data / "images").iterdir():
        green = np.zeros((tiny_data.HEIGHT, tiny_data.WIDTH, 3))
        green[..., 1] = 0.8
        mask = np.ones(green.shape[:2])
        mask[:, tiny_data.WIDTH // 2 :] = 0
        green[mask == 0] = (1, 1, 0)
        write_png(image, green)
        write_png(tmp_path / "masks" / image.name, mask)
    out = tmp_path / "mesh.obj"
    flags = ["mesh", tmp_path / "model.ply", "-o", out, "--data", data, "--voxel", "0.05", *how]

    def greens(*more) -> np.ndarray:
        """Which colours are green, and which are neither green nor grey."""
        assert run(capsys, *flags, *more)[0] == 0
        colors = vertices_of(out)[1]
        if how:
            with Image.open(tmp_path / "mesh_texture.jpg") as texture:
                colors = np.asarray(texture).reshape(-1, 3) / 255
        green, grey = (np.abs(colors - other).max(axis=1) < 0.1 for other in ((0, 0.8, 0), (0.5, 0.5, 0.5)))
        return np.array([green.mean(), (~green & ~grey).mean()])

    assert greens()[0] == 0  # those of the model
    plain, masked = greens("--photographs"), greens("--photographs", "--masks", tmp_path / "masks")
    assert 0.1 < plain[0] < 0.9 and plain[1] > 0.05  # yellow
    assert masked[0] > 0.1 and masked[1] == 0


def test_exposures_that_a_run_has_learned_are_taken_out_of_its_photographs(model, tmp_path):
    shutil.copy(model, tmp_path / "model.ply")
    data, color = tiny_data.write_tiny_data(tmp_path / "data", n=9), (0.3, 0.5, 0.4)
    views = load_dataset(data).train
    gains = np.linspace(-2, 1, len(views))[:, None] + (0.1, 0, -0.1)
    learned = Appearance([v.name for v in views], [device_of(views[0].camera)], gains, np.array([[-0.3, -0.2]]))
    for view in views:
        numbers = learned.numbers(view.camera, view.name)
        plain = np.broadcast_to(color, (*radii_squared(view.camera).shape, 3))
        write_png(data / "images" / f"{view.name}.png", photographed(plain, radii_squared(view.camera), numbers))

    def off() -> np.ndarray:
        """How far the colours of the mesh are from that of the scene, where they are not the grey of what is unseen."""
        make_mesh(tmp_path / "model.ply", out, MeshConfig(voxel=0.05, photographs=True), data)
        colors = vertices_of(out)[1]
        return abs(colors[(abs(colors - 0.5) > 0.01).any(axis=1)] - color).max(axis=1)

    out = tmp_path / "mesh.obj"
    without = off()
    learned.write(tmp_path / APPEARANCE)
    assert np.median(without) > 0.05 and off().max() < 0.02


def test_a_mesh_of_the_photographs_of_a_run_with_masks_tells_to_give_them(model, tmp_path, capsys):
    data, masks = tiny_data.write_tiny_data(tmp_path / "data", n=3), tmp_path / "masks"
    run_model = tmp_path / "run" / "point_cloud.ply"
    run_model.parent.mkdir()
    shutil.copy(model, run_model)
    write_png(masks / "1.png", np.ones((tiny_data.HEIGHT, tiny_data.WIDTH)))
    note_inputs(TrainConfig(str(data), masks=str(masks)), run_model.parent)
    mesh = ["mesh", run_model, "-o", tmp_path / "mesh.ply", "--data", data, "--voxel", "0.1"]
    line = f"{run_model} was trained with masks; what they hide counts here unless you give --masks {masks}"
    assert line in run(capsys, *mesh, "--photographs")[1].splitlines()
    told = run(capsys, *mesh, "--photographs", "--masks", masks)[1]
    assert f"{masks}: no mask for 1 of 2 images, such as 2; all of their pixels count\n" in told and line not in told
    assert "masks" not in run(capsys, *mesh)[1]


def test_the_data_say_what_is_up_and_how_long_a_unit_is_where_the_model_does_not(model, tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", n=2)
    write_world(data, World("x", 2.0))
    make_mesh(model, tmp_path / "surface.glb", MeshConfig(voxel=0.06), data)
    (node,) = Container.open(tmp_path / "surface.glb").content["nodes"]
    np.testing.assert_allclose(matrix_of(node), placing(Drawing(up="x", scale=2.0), LUF), atol=1e-6)


def test_the_largest_part_alone_and_the_reach(tmp_path, capsys):
    small = ball(400)
    means = np.concatenate([ball().means, CENTRE + (1.6, 0, 0) + 0.3 * (small.means - CENTRE)])
    near = Splats(**{
        name: np.concatenate([getattr(ball(), name), getattr(small, name)])
        for name in ("log_scales", "quats", "logit_opacities", "sh_coeffs")
    }, means=means)  # fmt: skip
    write_ply(tmp_path / "two.ply", near)
    found = {}
    for name, flags in (("both", ["--connected", "2"]), ("one", ["--connected", "1"]), ("near", ["--reach", "0.7"])):
        meshed(capsys, tmp_path / "two.ply", tmp_path / "o.obj", "--voxel", "0.05", "--min-faces", "20", *flags)
        found[name] = (vertices_of(tmp_path / "o.obj")[0] - CENTRE)[:, 0].max()
    assert found["both"] > 1.7 and found["one"] < 0.8 and found["near"] < 1.3, found


def test_colours_of_linear_radiance_are_those_that_a_screen_shows(tmp_path, capsys):
    grey = ball(colors=np.full((3000, 3), 0.5))
    write_model(tmp_path / "m.ply", Model(brightened(grey, 4.0), Drawing(linear=True, white=4.0)))
    meshed(capsys, tmp_path / "m.ply", tmp_path / "o.obj", "--voxel", "0.1")
    np.testing.assert_allclose(np.median(vertices_of(tmp_path / "o.obj")[1], axis=0), 0.735, atol=0.01)  # sRGB of 0.5


def test_the_same_model_gives_the_same_bits():
    cameras = tiny_data.cameras(4)
    first, second = (surface_of(ball(), cameras, DrawnAs(), MeshConfig(voxel=0.06))[0] for _ in range(2))
    for name in ("vertices", "faces", "colors"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_bad_input_is_one_line_and_nothing_is_written(model, tmp_path, capsys):
    faint = tmp_path / "faint.ply"
    write_ply(faint, rounded(make_splats(np.random.default_rng(0).normal(size=(50, 3)), 0.1, 0.02)))
    cases = {
        "no known mesh format; name a file that ends in .ply, .obj, .glb": [model, "-o", tmp_path / "o.stl"],
        "--voxel: 1e-08 is too small: positions": [model, "-o", tmp_path / "o.ply", "--voxel", "1e-8"],
        "hides half of what is behind it": [faint, "-o", tmp_path / "o.ply"],
        "--voxel: 1e-05 is too small for a model that reaches": [
            model,
            "-o",
            tmp_path / "o.ply",
            "--voxel",
            "1e-5",
            "--reach",
            "100",
        ],
        "--min-faces: 999999 is too many": [model, "-o", tmp_path / "o.ply", "--voxel", "0.1", "--min-faces", "999999"],
        "--texture: needs few triangles; also give --faces": [model, "-o", tmp_path / "o.glb", "--texture", "512"],
        "o.ply: cannot hold a texture": [
            model,
            "-o",
            tmp_path / "o.ply",
            "--texture",
            "512",
            "--faces",
            "400",
        ],
        "is the model itself": [model, "-o", model],
        "there are no images to shrink": [model, "-o", tmp_path / "o.ply", "--downscale", "2"],
        "no such": [model, "-o", tmp_path / "o.ply", "--data", tmp_path / "nowhere"],
        "--photographs: needs photographs; name their data set": [model, "-o", tmp_path / "o.ply", "--photographs"],
        "--masks: are for the colours of photographs": [model, "-o", tmp_path / "o.ply", "--masks", tmp_path],
        "--size: 16 x 8 is out of range": [model, "-o", tmp_path / "o.ply", "--size", "16", "8"],
        "--size: 99 x 16385 is out of range": [model, "-o", tmp_path / "o.ply", "--size", "99", "16385"],
    }
    before = model.read_bytes()
    for expected, arguments in cases.items():
        flags = [] if {"--size", "--data"} & set(arguments) else FAST
        status, said, error = run(capsys, "mesh", *arguments, *flags)
        line = error.splitlines()[-1]  # of what is seen late, after a bar
        assert status == 2 and not said and line.startswith("dogsplat: ") and expected in line
    assert model.read_bytes() == before and not list(tmp_path.glob("o.*"))


@pytest.mark.parametrize("flag", ["--views 12", "--size 80 60", "--inside 0"])
def test_what_is_said_of_other_views_than_those_of_data_is_refused(model, tmp_path, capsys, flag):
    result = run(capsys, "mesh", model, "-o", tmp_path / "o.ply", "--data", tmp_path / "data", *flag.split())
    assert_one_line(result, f"{flag.split()[0]}: is not for --data", "leave it out")


def test_a_near_clip_that_is_asked_for_counts(model, tmp_path, capsys):
    """That of the file is for views from afar, and gives way to our own, which may be near."""
    written = Model(ball(), Drawing(near_clip=50.0))
    write_model(tmp_path / "far.ply", written)
    meshed(capsys, tmp_path / "far.ply", tmp_path / "o.obj", "--voxel", "0.1")
    result = run(capsys, "mesh", model, "-o", tmp_path / "none.obj", *FAST, "--near-clip", "50")
    assert result[0] == 2 and "no surface is found" in result[2] and not (tmp_path / "none.obj").exists()


def test_expected_depths_count_what_stands_before_the_surface():
    """A wall behind a veil that stops a quarter of the light."""
    k = np.linspace(-1, 1, 41)
    places = np.stack([*np.meshgrid(k, k), np.zeros((41, 41))], axis=-1).reshape(-1, 3)
    both = np.concatenate([places, places + (0, 0, 0.1)])
    opacities = np.repeat([0.98, 0.06], len(places))  # of several that overlap
    splats = rounded(make_splats(both, (0.05, 0.05, 1e-3), opacities, 0.5))
    camera = Camera(look_at(np.array([0, 0, 3.0]), np.zeros(3), "y"), 100.0, 100.0, 40.0, 30.0, 80, 60)
    heights = {}
    for depth in ("median", "expected"):
        mesh, _ = surface_of(splats, [camera], DrawnAs(), MeshConfig(depth=depth, voxel=0.05))
        heights[depth] = np.median(mesh.vertices[:, 2])
    params, options = upload(splats), RasterOptions(splats.sh_degree, depth=True)
    seen = render_picture(params, camera, options).depth
    assert seen is not None
    assert heights == pytest.approx({"median": 0, "expected": 3 - np.median(seen)}, abs=0.005)
    assert heights["expected"] > 0.015


@pytest.mark.parametrize("distance", [1e4, 1e6, 3e8])
def test_far_from_the_origin_voxels_are_as_large_as_float32_needs(distance):
    """All corners of a triangle are apart in a file, whose positions are float32 too."""
    splats = ball()
    splats = replace(splats, means=splats.means * np.float32(max(1, distance / 1e6)) + np.float32(distance))
    splats = replace(splats, log_scales=splats.log_scales + np.log(np.float32(max(1, distance / 1e6))))
    cameras = vantage_cameras(splats, 8, (160, 120), share_inside=0)
    mesh, voxel = surface_of(splats, cameras, DrawnAs())
    assert voxel >= 4 * np.spacing(np.float32(distance))
    corners = mesh.vertices.astype(np.float32)[mesh.faces]
    assert len(corners) > 100
    for k in range(3):
        assert (corners[:, k] != corners[:, k - 1]).any(axis=1).all()
    with pytest.raises(DataError, match="--voxel: .* is too small: positions in float32"):
        surface_of(splats, cameras, DrawnAs(), MeshConfig(voxel=float(np.spacing(np.float32(distance)))))


def test_too_many_voxels_for_the_memory_are_one_line(model, tmp_path, capsys, monkeypatch):
    """Told as soon as it is known, and not after all views."""
    monkeypatch.setattr("mi_dogsplat.meshing.seen_blocks.available_memory", lambda: 100_000)
    result = run(capsys, "mesh", model, "-o", tmp_path / "o.ply", "--voxel", "0.02", *FAST)
    assert_one_line(result, "--voxel: 0.02 makes", "use a larger one, or a smaller --reach")


def test_a_texture_too_large_for_the_memory_is_one_line(model, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("mi_dogsplat.meshing.texture.available_memory", lambda: 200_000_000)
    result = run(capsys, "mesh", model, "-o", tmp_path / "o.glb", "--faces", "400", "--texture", "1024", *FAST)
    assert_one_line(result, "--texture: 1024 takes 252 MB of memory", "use fewer pixels")


def test_a_voxel_much_finer_than_the_views_is_one_line(model, tmp_path, capsys):
    """It would make crumbs, for minutes. It is known after a look at all views, when there is a bar."""
    status, said, error = run(capsys, "mesh", model, "-o", tmp_path / "o.ply", "--voxel", "1e-4", *FAST)
    assert status == 2 and not said and not list(tmp_path.iterdir())
    expected = "dogsplat: --voxel: 0.0001 is finer than the views, whose pixels are 0.02 wide at the surface; "
    assert error.splitlines()[-1] == expected + "use 0.005 or more, or larger views"


def test_the_voxel_follows_views_that_are_coarse(model, tmp_path, capsys):
    """Where nobody asked for one."""
    data = tiny_data.write_tiny_data(tmp_path / "data", n=4)
    status, said, error = run(capsys, "mesh", model, "-o", tmp_path / "o.ply", "--data", data)
    assert status == 0, error
    fine = robust_sphere(ball())[1] / 128
    voxel = float(said.rpartition(" ")[2])
    assert voxel == pytest.approx(3 * fine, rel=1e-3)  # a pixel, 48 to a picture, shows 0.047 at the ball
    assert said.splitlines()[-1].startswith(f"{tmp_path / 'o.ply'}: ") and int(said.split()[1].replace(",", "")) > 5000


def test_progress_is_told_view_by_view(model, tmp_path):
    told = []
    config = MeshConfig(voxel=0.1, views=3, size=(40, 30), inside=0)
    made = make_mesh(model, tmp_path / "o.ply", config, show=lambda done, total: told.append((done, total)))
    assert told == [(k, 9) for k in range(1, 10)]
    assert made.n_views == 3 and made.n_faces > 100


def test_a_library_call_raises_a_value_error(model, tmp_path):
    with pytest.raises(DataError):
        make_mesh(model, tmp_path / "o.ply", MeshConfig(voxel=1e-8))
    with pytest.raises(ValueError, match="--voxel"):
        MeshConfig(voxel=-1)
