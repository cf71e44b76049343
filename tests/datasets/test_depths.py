"""Depth maps: their files, whose they are, and their units."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from mi_dogsplat.datasets.dataset import Dataset, Observations, View
from mi_dogsplat.datasets.depth_files import read_depth
from mi_dogsplat.datasets.depths import LEAST_POINTS, Depths, without_depth
from mi_dogsplat.datasets.lens import Lens, undistortion
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.errors import DataError
from PIL import Image

DEPTHS = np.array([[1.5, 2.25, 0], [0.125, 7, 3.5]], np.float32)


def write_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def written(folder: Path, kind: str) -> Path:
    """``DEPTHS`` as a file, with what is not known in some other way."""
    path = folder / f"a.{kind.split()[0]}"
    unknown = np.where(DEPTHS > 0, DEPTHS, {"exr": np.inf, "npy": np.nan}.get(path.suffix[1:], 0))
    if path.suffix == ".exr":
        write_exr(path, {kind.split()[1]: unknown.astype(np.float32), "other": unknown.astype(np.float32) + 1})
    elif path.suffix == ".npy":
        whole = kind.endswith("millimetres")
        np.save(path, (1000 * DEPTHS).astype(np.uint16) if whole else unknown[..., None].astype(np.float64))
    else:
        floats = kind.endswith("floats")
        Image.fromarray(unknown.astype(np.float32) if floats else (1000 * DEPTHS).astype(np.uint16)).save(path)
    return path


KINDS = ("exr depth.Z", "exr Z", "exr Y", "npy floats", "npy millimetres", "png millimetres", "tif millimetres")


@pytest.mark.parametrize("kind", [*KINDS, "tiff floats"])
def test_files_of_all_kinds_hold_the_same_depths(tmp_path, kind):
    depth = read_depth(written(tmp_path, kind))
    assert depth.dtype == np.float32 and depth.shape == DEPTHS.shape
    np.testing.assert_allclose(depth, DEPTHS, rtol=1e-6)


def test_the_only_channel_is_depth_whatever_its_name_and_negative_depths_are_unknown(tmp_path):
    write_exr(tmp_path / "a.exr", {"distance": -DEPTHS})
    assert not read_depth(tmp_path / "a.exr").any()


def bad_file(folder: Path, kind: str) -> Path:
    path = folder / kind
    if kind == "8 bits.png":
        Image.fromarray(np.ones((2, 2), np.uint8)).save(path)
    elif kind == "colours.png":
        Image.fromarray(np.ones((2, 2, 3), np.uint8)).save(path)
    elif kind == "shape.npy":
        np.save(path, np.ones((2, 2, 2)))
    elif kind == "objects.npy":
        np.save(path, np.array([None]), allow_pickle=True)
    elif kind == "no type.npy":
        np.save(path, np.ones((2, 2), np.float32))
        path.write_bytes(path.read_bytes().replace(b"<f4", b"<f0"))
    elif kind == "words.npy":
        np.save(path, np.array([["a"]]))
    elif kind == "names.exr":
        write_exr(path, {"a": DEPTHS, "b": DEPTHS})
    else:
        path.write_bytes(b"nothing of the kind")
    return path


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("8 bits.png", "has 8 bits, and depth needs one channel of 16 bits; write it as PNG of 16 bits"),
        ("colours.png", "has 3 channels, and depth needs one channel of 16 bits"),
        ("shape.npy", r"holds an array of shape \(2, 2, 2\); depth needs \[height, width\]"),
        ("objects.npy", "cannot be read as a NumPy array"),
        ("words.npy", "holds no array of real numbers"),
        ("no type.npy", "cannot be read as a NumPy array .*<f0"),
        ("names.exr", "has no channel depth.Z, Z, depth, Y, but a, b; name the channel of depth so"),
        ("no.png", "cannot be read as an image"),
        ("no.npy", "cannot be read as a NumPy array"),
        ("no.exr", "cannot be read as OpenEXR"),
    ],
)
def test_a_bad_file_is_one_line(tmp_path, kind, said):
    with pytest.raises(DataError, match=said) as error:
        read_depth(bad_file(tmp_path, kind))
    assert "\n" not in str(error.value) and kind in str(error.value)


def data_of(*views: View, observations: dict[str, Observations] | None = None, points=()) -> Dataset:
    xyz = np.array(points, np.float32).reshape(-1, 3)
    return Dataset(Path("data"), list(views), [], xyz, 0 * xyz, False, observations or {})


def view_of(width: int, height: int, name: str = "a") -> View:
    camera = Camera(np.eye(4), 10.0, 10.0, width / 2, height / 2, width, height)
    return View(name, camera, np.zeros((height, width, 3), np.float32))


def test_a_map_of_another_size_gives_each_pixel_the_nearest_value(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(1.0, 13).reshape(3, 4))
    data = data_of(view_of(8, 6))
    depth = Depths(tmp_path, data).of(data.train[0])
    assert depth is not None
    np.testing.assert_array_equal(depth, np.arange(1, 13).reshape(3, 4).repeat(2, 0).repeat(2, 1))
    small = Depths(tmp_path, data).of(view_of(1, 1))  # 3x4 shrunk by 3, of which a column is cut off
    np.testing.assert_array_equal(small, [[6]])  # the middle of the 3x3 that are left


def test_an_upright_map_of_a_photograph_that_lies_is_refused(tmp_path):
    data = data_of(view_of(8, 6))
    np.save(tmp_path / "a.npy", np.ones((4, 3)))
    with pytest.raises(DataError, match=r"is 3x4, turned by 90° against its image, 8x6; turn it to match the pixels"):
        Depths(tmp_path, data).of(data.train[0])


def test_the_lens_of_the_photograph_is_taken_out_of_its_map(tmp_path):
    source = view_of(64, 48).camera
    straight = undistortion(replace(source, fx=40.0, fy=40.0), Lens((0.2,)))
    columns = np.tile(np.arange(1.0, 65), (48, 1))  # each pixel tells its column
    np.save(tmp_path / "a.npy", columns)
    camera = straight.camera
    image = np.zeros((camera.height, camera.width, 3), np.float32)
    view = View("a", camera, image, straight)
    depth = Depths(tmp_path, data_of(view)).of(view)
    expected = straight.image(columns[..., None].astype(np.float32))[..., 0]
    inside = slice(2, -2), slice(2, -2)  # of what splines make of the border
    assert depth is not None and np.abs(depth - expected)[inside].max() < 0.51 < np.ptp(expected, axis=0)[2:-2].max()


def test_maps_are_scaled_to_the_sparse_points_that_the_views_see(tmp_path):
    rng, (width, height) = np.random.default_rng(0), (40, 30)
    view = view_of(width, height)
    depth = rng.uniform(1, 2, (height, width))
    pixels = rng.uniform(0, 1, (LEAST_POINTS, 2)) * (width, height)
    at = pixels.astype(int)
    z = 3.7 * depth[at[:, 1], at[:, 0]]
    z[:5] *= 9  # points that are wrong
    points = np.column_stack([(pixels - (width / 2, height / 2)) / 10 * z[:, None], z])
    np.save(tmp_path / "a.npy", depth)
    np.save(tmp_path / "b.npy", depth)
    few = Observations(pixels[1:], np.arange(LEAST_POINTS)[1:])
    seen = {"a": Observations(pixels, np.arange(LEAST_POINTS)), "b": few}
    data = data_of(view, view_of(width, height, "b"), view_of(width, height, "c"), observations=seen, points=points)
    depths = Depths(tmp_path, data)
    found = depths.of(view)
    assert found is not None
    np.testing.assert_allclose(found, 3.7 * depth, rtol=1e-5)
    assert depths.of(data.train[1]) is None  # one point less than it needs
    assert depths.of(data.train[2]) is None  # no map
    half = replace(view, camera=view.camera.downscaled(2))
    np.testing.assert_allclose(np.asarray(depths.of(half)), 3.7 * depth[1::2, 1::2], rtol=1e-5)


def room(n_views: int, n_points: int) -> tuple[Dataset, list[np.ndarray]]:
    """Views that see points of a slanted wall, a tenth of which are wrong, and the true depths of these views."""
    rng, (width, height) = np.random.default_rng(0), (40, 30)
    views = [view_of(width, height, name) for name in "abcdefgh"[:n_views]]
    depths, points, seen = [], [], {}
    for k, view in enumerate(views):
        column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        depth = 2 + 0.05 * column + 0.02 * (k + 1) * row
        pixels = np.column_stack([rng.integers(0, width, n_points), rng.integers(0, height, n_points)]) + 0.5
        z = depth[pixels[:, 1].astype(int), pixels[:, 0].astype(int)]
        z[: n_points // 10] *= rng.uniform(2, 9, n_points // 10)
        seen[view.name] = Observations(pixels, k * n_points + np.arange(n_points))
        points.extend(view.camera.unproject(pixels, z))
        depths.append(depth)
    return data_of(*views, observations=seen, points=points), depths


def write_inverse(path: Path, depth: np.ndarray, offset: float, bits: int) -> None:
    """Relative inverse depth as networks give it: from 0, where it is farthest, to 1."""
    inverse = 1 / depth + offset
    whole = np.rint((inverse - inverse.min()) / np.ptp(inverse) * (2**bits - 1)).astype(f"uint{bits}")
    if path.suffix == ".npy":
        np.save(path, inverse)
    elif path.stem == "b":  # as Depth Anything writes grey
        Image.fromarray(np.repeat(whole[..., None], 3, axis=2)).save(path)
    else:
        Image.fromarray(whole).save(path)


@pytest.mark.parametrize(("kind", "tolerance"), [("8.png", 0.03), ("16.png", 1e-3), ("16.npy", 1e-3)])
def test_relative_inverse_depth_of_networks_becomes_depth_by_the_points(tmp_path, kind, tolerance):
    data, truth = room(3, 60)
    bits, ending = kind.split(".")
    for k, (view, depth) in enumerate(zip(data.train, truth, strict=True)):
        stem = f"{view.name}.{ending}"
        write_inverse(tmp_path / (stem if bits == "8" or k != 1 else f"b.jpg.{ending}"), depth, 0.3 * k, int(bits))
    depths = Depths(tmp_path, data)
    for view, depth in zip(data.train, truth, strict=True):
        found = np.asarray(depths.of(view))
        known = found > 0
        assert found.dtype == np.float32 and known.mean() > 0.99  # the farthest pixel is 0 in whole numbers
        np.testing.assert_allclose(found[known], depth[known], rtol=tolerance)
    (line,) = depths.notes()
    said = f"{tmp_path}: the maps hold inverse depth, by the sparse points of 3 views; the median error at these is"
    assert re.fullmatch(rf"{re.escape(said)} 0\.\d %", line)


def test_views_whose_maps_cannot_be_scaled_or_fit_nothing_are_named_in_a_line(tmp_path):
    data, truth = room(4, 60)
    rng = np.random.default_rng(1)
    for view, depth in zip(data.train, truth, strict=True):
        np.save(tmp_path / f"{view.name}.npy", depth / 2 if view.name != "c" else rng.uniform(0.1, 9, depth.shape))
    seen = data.observations["d"]
    data.observations["d"] = Observations(seen.pixels[: LEAST_POINTS - 1], seen.points[: LEAST_POINTS - 1])
    depths = Depths(tmp_path, data)
    assert [depths.of(view) is not None for view in data.train] == [True, True, False, False]
    assert depths.notes() == [
        f"{tmp_path}: the maps hold depth, by the sparse points of 2 views; the median error at these is 0.0 %",
        f"{tmp_path}: 2 of 4 depth maps are not used, such as that of c (1 with fewer than 20 sparse points, 1 off by "
        "more than 20 % at half of them); these views are learned from their colours alone",
    ]


def test_maps_that_may_be_either_or_that_fit_no_view_are_refused(tmp_path):
    data, truth = room(2, 200)
    rng = np.random.default_rng(1)
    for view in data.train:
        np.save(tmp_path / f"{view.name}.npy", rng.uniform(1, 2, truth[0].shape))
    with pytest.raises(DataError, match="holds neither depth nor inverse depth: its values have a rank corr"):
        Depths(tmp_path, data)
    for view, depth in zip(data.train, truth, strict=True):
        np.save(tmp_path / f"{view.name}.npy", np.exp(3 * depth))
    said = r"cannot be scaled: each map is off by more than 20 % at half of its points; check that these are the depth"
    with pytest.raises(DataError, match=said):
        Depths(tmp_path, data)


def test_eight_bits_are_refused_where_they_hold_depth_or_colours(tmp_path):
    data, truth = room(1, 60)
    whole = np.rint(255 * truth[0] / truth[0].max()).astype(np.uint8)
    Image.fromarray(whole).save(tmp_path / "a.png")
    with pytest.raises(DataError, match=r"a\.png: has 8 bits, and depth needs one channel of 16 bits"):
        Depths(tmp_path, data).of(data.train[0])
    Image.fromarray(np.stack([whole, 255 - whole, whole], axis=2)).save(tmp_path / "a.png")
    with pytest.raises(DataError, match=r"a\.png: has 3 channels, and depth needs one channel of 16 bits"):
        Depths(tmp_path, data)
    picture = Image.fromarray(255 - whole)
    picture.putpalette(np.random.default_rng(0).integers(0, 256, 768).tolist())
    picture.save(tmp_path / "a.png")
    with pytest.raises(DataError, match=r"a\.png: has 3 channels, and depth needs one channel of 16 bits"):
        Depths(tmp_path, data)


def test_maps_of_which_none_can_be_scaled_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((4, 4)))
    few = Observations(np.ones((LEAST_POINTS - 1, 2)), np.zeros(LEAST_POINTS - 1, int))
    data = data_of(view_of(4, 4), observations={"a": few}, points=[[0, 0, 1]])
    with pytest.raises(DataError, match=f"no view with a depth map sees {LEAST_POINTS} sparse points"):
        Depths(tmp_path, data)


def in_a_view(view: View, depth: np.ndarray, times: np.ndarray | float) -> np.ndarray:
    """[P, 3] where every seventh pixel of a view sees something, so many ``times`` [P] as far away."""
    rows, columns = np.divmod(np.arange(0, depth.size, 7), view.camera.width)
    return view.camera.unproject(np.column_stack([columns, rows]) + 0.5, times * depth[rows, columns])


FEET = 0.3048


@pytest.mark.parametrize(
    ("factor", "refused"), [(1, False), (1000, True), (0.1, True), (FEET, True), (0.75, True), (0.85, False)]
)
def test_maps_in_another_unit_than_the_poses_are_refused_where_nothing_scales_them(tmp_path, factor, refused):
    view = view_of(40, 30)
    depth = np.random.default_rng(0).uniform(1, 2, (30, 40))
    behind = [[0, 0, -1], [0, 0, 0]]  # and points that the view does not see
    np.save(tmp_path / "a.npy", depth / factor)
    data = data_of(view, points=[*in_a_view(view, depth, 1.0), *behind])
    if not refused:
        assert Depths(tmp_path, data).of(view) is not None
        return
    said = f"in another unit than the poses: points are about {factor:.3g} times as far away"
    with pytest.raises(DataError, match=re.escape(said)):
        Depths(tmp_path, data)


def test_points_that_are_hidden_tell_no_other_unit(tmp_path):
    """They are farther than the map says, and never nearer: so less than 1 needs no more room than a map's error."""
    view, rng = view_of(40, 30), np.random.default_rng(0)
    depth = rng.uniform(1, 2, (30, 40))
    hidden = np.where(rng.random(172) < 0.7, rng.uniform(1, 4, 172), 1) * np.exp(rng.normal(0, 0.1, 172))
    data = data_of(view, points=in_a_view(view, depth, hidden))
    for too_far in (1, 1.2):
        np.save(tmp_path / "a.npy", too_far * depth)
        assert Depths(tmp_path, data).of(view) is not None


def test_rooms_behind_the_one_that_a_view_shows_tell_no_other_unit(tmp_path):
    """As in the scan of a flat: most points in the direction of a view are behind its walls."""
    view = view_of(40, 30)
    depth = np.random.default_rng(0).uniform(1, 2, (30, 40))
    rooms = [in_a_view(view, depth, times) for times in (1, 4, 5, 6, 7)]
    np.save(tmp_path / "a.npy", depth)
    assert Depths(tmp_path, data_of(view, points=np.concatenate(rooms))).of(view) is not None
    np.save(tmp_path / "a.npy", depth / 1000)
    with pytest.raises(DataError, match="points are about 1e\\+03 times as far away"):
        Depths(tmp_path, data_of(view, points=np.concatenate(rooms)))


def test_inverse_depth_is_refused_where_nobody_knows_what_a_view_sees(tmp_path):
    view = view_of(40, 30)
    depth = np.random.default_rng(0).uniform(1, 2, (30, 40))
    np.save(tmp_path / "a.npy", 2 / depth)  # 2 at 1, 1 at 2: in the mean the unit would be right
    with pytest.raises(DataError, match=r"seems to hold inverse depth: .* of -1\.00 .*; convert it to depth, or"):
        Depths(tmp_path, data_of(view, points=in_a_view(view, depth, 1.0)))


def test_folders_without_maps_and_maps_that_know_nothing_are_refused(tmp_path):
    data = data_of(view_of(4, 4), view_of(4, 4, "b"))
    with pytest.raises(DataError, match="no such folder; give a folder with a depth map per image"):
        Depths(tmp_path / "none", data)
    with pytest.raises(DataError, match=r"no depth map for any of the images; name them like the images, as a\.png"):
        Depths(tmp_path, data)
    np.save(tmp_path / "a.npy", np.zeros((4, 4)))
    with pytest.raises(DataError, match=r"a\.npy: knows no depth: all of it is 0, negative or not finite"):
        Depths(tmp_path, data).of(data.train[0])
    said = f"{tmp_path}: no depth map for 1 of 2 images, such as b; they are learned from their colours alone"
    assert without_depth(tmp_path, ["a", "b"]) == [said]
    assert without_depth(tmp_path, ["a"]) == without_depth(None, ["b"]) == []
    write_exr(tmp_path / "a.exr", {"Z": DEPTHS})
    with pytest.raises(DataError, match='would be a second depth map of "a"'):
        Depths(tmp_path, data)
