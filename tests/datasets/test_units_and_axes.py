"""What is up in a data set, and how long its unit is: as it says, as its cameras stood, and by a known length."""

import json

import numpy as np
import pytest
import tiny_data
from dataset_folders import colmap_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.lengths import Standpoint, length_in_units, standpoints_of
from mi_dogsplat.datasets.world import World, metres_of_unit, read_world, up_as_held, world_of, write_world
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.support.errors import DataError

SIZES = ("PINHOLE", (20, 20, 10.5, 7.5)), ("SIMPLE_RADIAL", (20, 10.5, 7.5, 0.1))


@pytest.fixture(params=SIZES, ids=lambda lens: lens[0])
def colmap(request, tmp_path):
    """Nine points 0.5 apart at a distance of 5, which the first image is known to see; with and without a lens."""
    points = colmap_folder(tmp_path, camera=request.param[0], params=request.param[1])
    return tmp_path, points


def marks(folder, points, names=("img_00", "img_09")) -> dict[str, list[str]]:
    """Each point as it is marked in these images; pixels of the photographs, with their lens."""
    found = {}
    views = {view.name: view for view in load_dataset(folder).views}
    for name in names:
        view = views[name]
        pixels = view.camera.project(points)[0]
        if view.straight:
            rays = (pixels - (view.camera.cx, view.camera.cy)) / (view.camera.fx, view.camera.fy)
            source = view.straight.source
            pixels = view.straight.lens.distort(rays) * (source.fx, source.fy) + (source.cx, source.cy)
        found[name] = [f"{name}.png:{x:.4f},{y:.4f}" for x, y in pixels]
    return found


def length(folder, *ends) -> float:
    return length_in_units(ends, standpoints_of(load_dataset(folder)))


def test_two_images_and_points_marked_in_one_or_two(colmap):
    folder, points = colmap
    marked = marks(folder, points)
    apart = np.linalg.norm(points[0] - points[8])
    assert length(folder, "img_02.png", "img_07") == pytest.approx(0.5)
    first, last = ("+".join(marked[name][i] for name in marked) for i in (0, 8))
    assert length(folder, first, last) == pytest.approx(apart, rel=1e-3)
    # by depth: those of its neighbours, as the only one within reach is itself
    assert length(folder, marked["img_00"][0], marked["img_00"][8]) == pytest.approx(apart, rel=0.01)
    camera = load_dataset(folder).views[0].camera.position
    assert length(folder, "img_03", last) == pytest.approx(np.linalg.norm(points[8] - (-0.3, 0, 0)), rel=1e-3), camera


@pytest.mark.parametrize("downscale", [1, 2])
def test_a_unit_is_measured_at_the_full_size_of_the_images(colmap, downscale):
    folder, points = colmap
    marked = marks(folder, points)
    first, last = ("+".join(marked[name][i] for name in marked) for i in (0, 8))
    unit = metres_of_unit(folder, (first, last, "2"))
    assert unit == pytest.approx(2 / np.linalg.norm(points[0] - points[8]), rel=1e-3)
    load_dataset(folder, downscale)  # whose size is another


@pytest.mark.parametrize(("ends", "problem"), [
    (("img_99", "img_01"), 'no image "img_99" has a pose; name two of them, like img_0'),
    (("img_01:3", "img_02"), 'no image "img_01:3" has a pose'),
    (("img_01.png:3,4+img_77:1,2", "img_02"), 'no image "img_77" has a pose'),
    (("img_01", "img_01.png"), '"img_01" and "img_01.png" are the same place'),
    (("img_05:3,4", "img_02"), 'no point of structure from motion lies near "img_05:3,4"; mark it in a second image'),
    (("img_01:10,8+img_02:1,8", "img_02"), 'marks of "img_01:10,8+img_02:1,8" do not belong to one point'),
    (("img_01:10,8+img_01:10,8", "img_02"), "see it from one direction; mark it in images further apart"),
])  # fmt: skip
def test_what_cannot_be_measured_is_told_in_one_line(tmp_path, ends, problem):
    colmap_folder(tmp_path)
    with pytest.raises(DataError, match=r"^--scale: [^\n]*" + problem.replace("+", r"\+").replace(".", r"\.")):
        length(tmp_path, *ends)


def test_points_at_several_depths_tell_none(tmp_path):
    folder = tmp_path / "sparse" / "0"
    points = colmap_folder(tmp_path)
    text = (folder / "points3D.txt").read_text()
    (folder / "points3D.txt").write_text(text.replace("1 -0.5 -0.5 5.0 ", "1 -1.01 -1.01 10.0 "))
    marked = marks(tmp_path, points[:1])["img_00"][0]
    near = text.replace("1 -0.5 -0.5 5.0 ", "1 -1.0 -1.0 9.8 ").replace("2 -0.5 0.0 5.0 ", "2 -0.5 -0.5 5.0 ")
    (folder / "points3D.txt").write_text(near)
    observed = (folder / "images.txt").read_text().splitlines()
    seen = observed[-1].split()
    seen[3:5] = [str(float(seen[0]) + 0.1), seen[1]]
    (folder / "images.txt").write_text("\n".join([*observed[:-1], " ".join(seen)]) + "\n")
    with pytest.raises(DataError, match="lie .* units away, so on several objects; mark it in a second image too"):
        length(tmp_path, marked, "img_01")


def test_the_file_comes_before_the_cameras(data, tmp_path):
    dataset = load_dataset(data)
    cameras = [view.camera for view in dataset.views]
    assert world_of(dataset, cameras) == World("z", None) == World(up_as_held(cameras))
    write_world(tmp_path, World("-y", 0.3))
    dataset.path = tmp_path
    assert world_of(dataset, cameras) == World("-y", 0.3) == read_world(tmp_path)


def test_images_are_named_as_they_were_before_poses_took_the_spaces_out_of_their_names():
    at = {f"IMG_{k}.png": Standpoint(np.array([0.0, k, 0]), lambda _: np.array([0.0, 0, 1])) for k in (1, 4)}
    assert length_in_units(("IMG 1.jpg", "IMG_4.png"), at) == length_in_units(("IMG 1", "IMG 4.tif"), at) == 3
    at["_7.png"] = at["IMG_1.png"]  # nor may a name begin with #
    assert length_in_units(("#7.png", "IMG 4"), at) == length_in_units(("#7", "IMG 4"), at) == 3
    with pytest.raises(DataError, match='no image "IMG 2.jpg" has a pose'):
        length_in_units(("IMG 1.jpg", "IMG 2.jpg"), at)


def test_a_plus_may_stand_in_the_name_of_an_image_that_is_marked():
    """Two cameras, at x = 0 and 2, see the points (0, 0, 5) and (1, 0, 5)."""

    def at(x: float) -> Standpoint:
        def ray(pixel: np.ndarray) -> np.ndarray:
            direction = np.append(pixel / 100, 1)
            return direction / np.linalg.norm(direction)

        return Standpoint(np.array([x, 0.0, 0.0]), ray)

    for left, right in (("IMG1+2.jpg", "b"), ("10.00.00+01", "10.00.10+01"), ("3:4,5", "a+1,2")):
        ends = (f"{left}:0,0+{right}:-40,0", f"{right}:-20,0+{left}:20,0")
        assert length_in_units(ends, {left: at(0), right: at(2)}) == pytest.approx(1)


def test_marks_on_one_ray_are_refused_though_the_product_of_unit_vectors_may_exceed_1():
    rays = np.random.default_rng(0).normal(size=(40, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    assert max(float(ray @ ray) for ray in rays) > 1
    for ray in rays:
        at = {name: Standpoint(np.zeros(3), lambda _, ray=ray: ray) for name in ("a", "b")}
        with pytest.raises(DataError, match="see it from one direction"):
            length_in_units(("a:1,1+b:1,1", "b"), at)


def test_cameras_held_anyhow_say_nothing():
    rng = np.random.default_rng(0)

    def camera() -> Camera:
        return Camera(affine(np.linalg.qr(rng.normal(size=(3, 3)))[0]), 20, 20, 10, 10, 20, 20)

    assert up_as_held([camera() for _ in range(30)]) is None
    assert up_as_held(tiny_data.cameras()) == "z"


@pytest.mark.parametrize("content", [
    [], {"up": "down"}, {"scale": 0}, {"scale": "long"}, {"scale": True}, {"scale": 10**400}, {"unit": 2},
])  # fmt: skip
def test_a_file_that_makes_no_sense_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "world.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=r'world.json: .*; write \{"up": "-y", "scale": 1.0\}'):
        read_world(tmp_path)
