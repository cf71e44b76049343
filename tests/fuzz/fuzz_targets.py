"""Every reader of foreign files, each with good files to damage. ``fuzz.py`` runs them by the ten thousands.

The invariant: a valid object, or ``DataError`` on one line that names the file. Else nothing: no other exception, no
hang, no crash, and no more memory than stands in proportion to the file.
"""

import importlib.util
import io
import json
import struct
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import foreign_model
import numpy as np
from cut_models import with_cuts, with_second_cuts
from dataset_folders import colmap_folder, transforms_folder
from dng_files import write_dng
from icc_profiles import DISPLAY_P3, SRGB_CURVE, profile
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.capture import SETTINGS
from mi_dogsplat.datasets.colmap_files import read_cameras, read_frames, read_images, read_points
from mi_dogsplat.datasets.depth_files import read_depth
from mi_dogsplat.datasets.given_cameras import listed_shots
from mi_dogsplat.datasets.images import image_size, read_image
from mi_dogsplat.datasets.point_ply import read_point_ply, write_point_ply
from mi_dogsplat.datasets.scans.apps import read_scan
from mi_dogsplat.formats.compressed_ply import encode
from mi_dogsplat.formats.gltf_container import glb
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.inspection.run import describe_run
from mi_dogsplat.poses.raw_files import develop, read_header
from mi_dogsplat.report.write import write_report
from mi_dogsplat.runs.checkpoint import load_checkpoint, save_checkpoint
from mi_dogsplat.scene.camera_file import read_camera
from mi_dogsplat.scene.cameras import OPENCV_FROM_OPENGL
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.row_groups import SECOND_CUTS
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.resumable import require_same
from mi_dogsplat.training.events import DogActivated, Pruned, row_of
from phone_scans import write_polycam, write_record3d, write_stray_files
from PIL import ExifTags, Image
from ply_files import (
    curvature_columns,
    cut_columns,
    dog_columns,
    random_splats,
    shift_columns,
    slope_columns,
    to_bytes,
    vertex_columns,
)
from shifted_models import with_shifts
from sloped_models import with_curvatures, with_slopes

SECONDS = 5.0  # of the processor; more for one small file is a hang


@dataclass
class Target:
    """A reader: ``read`` gets the path of the damaged file; ``name`` is the file's, in a folder of its own."""

    name: str
    seeds: list[bytes]
    read: Callable[[Path], object]
    folder: Path

    def check(self, data: bytes) -> str:
        """Read ``data``; returns ``read`` or ``refused``. Raises whatever breaks the invariant."""
        path = self.folder / self.name
        path.write_bytes(data)
        start = time.process_time()
        try:
            self.read(path)
            outcome = "read"
        except DataError as error:
            message = str(error)
            named = str(self.folder) in message or message.startswith(str(error.path)[:20])  # an image anywhere
            assert named, f"does not name the file: {message}"
            assert len(message.splitlines()) == 1 and len(message) < 2000, f"not one line: {message!r}"
            outcome = "refused"
        seconds = time.process_time() - start
        assert seconds < SECONDS, f"took {seconds:.1f} s"
        return outcome


BY_A_LIBRARY = (".usd", ".usdc", ".usdz", ".heic", ".dng")
"""Binary OpenUSD, which Pixar's library reads: a wrong byte may take it half a minute, or end the process; trust.md.
And HEIF, of libheif, and raw photographs, of LibRaw."""


def make_targets(root: Path | None = None) -> dict[str, Target]:
    """All targets by name, in folders below ``root`` (default: a temporary one in memory)."""
    shared = "/dev/shm" if Path("/dev/shm").is_dir() else None
    root = root or Path(tempfile.mkdtemp(prefix="dogsplat fuzz ü ", dir=shared))
    targets = {}

    def add(target: str, name: str, seeds: list[bytes], read: Callable[[Path], object]) -> Path:
        folder = root / target
        folder.mkdir()
        targets[target] = Target(name, seeds, read, folder)
        return folder

    add("ply", "model.ply", ply_seeds(), read_ply)
    for name, seeds in model_seeds(root).items():
        add(name, f"model.{name}" if name != "unknown" else "model", seeds, read_model)
    folder = add("sog_meta", "meta.json", [], read_model)
    with zipfile.ZipFile(io.BytesIO(model_seeds(root)["sog"][0])) as bundle:
        bundle.extractall(folder)
    targets["sog_meta"].seeds = [(folder / "meta.json").read_bytes()]
    add("point_ply", "points.ply", point_ply_seeds(), read_point_ply)
    model = root / "colmap" / "sparse" / "0"
    colmap_folder(root / "colmap", text=False)
    binary = {path.name: path.read_bytes() for path in model.glob("*.bin")}
    colmap_folder(root / "colmap")
    text = {path.name: path.read_bytes() for path in model.glob("*.txt")}
    binary["frames.bin"] = struct.pack("<QII7dIiIQ", 1, 1, 1, 1, *(0,) * 6, 1, 0, 7, 1)
    text["frames.txt"] = b"1 1 1 0 0 0 0 0 0 1 CAMERA 7 1\n"
    readers = {"cameras": read_cameras, "images": read_images, "points3D": read_points, "frames": read_frames}
    for name, content in (binary | text).items():
        add(f"colmap_{name.replace('.', '_')}", name, [content], readers[name.split(".")[0]])
    add("colmap_dataset", "images.txt", [text["images.txt"]], lambda path: load_dataset(path.parents[0]))
    colmap_folder(root / "colmap_dataset", model=".")
    folder = add("transforms", "transforms.json", [], lambda path: load_dataset(path))
    transforms_folder(folder)
    targets["transforms"].seeds = transforms_seeds(folder)
    add("camera", "camera.json", [json.dumps(camera()).encode()], read_camera)
    add("camera_list", "list.json", [json.dumps([camera(), {"name": "b", **camera()}]).encode()],
        lambda path: listed_shots(path, 1.0, 1))  # fmt: skip
    settings = {"scene": "a.xml", "scene_sha256": "0" * 64, "path": "orbit", "views": 4, "size": [64, 64], "seed": 0}
    add("capture", SETTINGS, [json.dumps(settings).encode()], lambda path: require_same(path, settings))
    for name, content in RUN.items():
        stem = name.split(".")[0].replace("test/", "")
        folder = add(f"run_{stem}", name, [content], _look_at_run)
        (folder / "test").mkdir()
        for other, whole in RUN.items():
            (folder / other).write_bytes(whole)
    add("checkpoint", "state.npz", checkpoint_seeds(root), load_checkpoint)
    add("checkpoint_array", "step.npy", array_seeds(), _read_as_member)
    add("image", "photo.png", image_seeds(), lambda path: (image_size(path), read_image(path)))
    for ending, seed in depth_seeds().items():
        add(f"depth_{ending}", f"depth.{ending}", [seed], lambda path: read_depth(path, coarse=True))
    for name, (folder, file) in scan_folders(root).items():
        seeds = [(folder / file).read_bytes()]
        targets[f"scan_{name}"] = Target(file, seeds, partial(_read_scan, folder), folder)
    if importlib.util.find_spec("pillow_heif"):
        add("heic", "photo.heic", heif_seeds(root), lambda path: (image_size(path), read_image(path)))
    if importlib.util.find_spec("rawpy"):
        light = np.random.default_rng(0).uniform(0, 1, (24, 32, 3))
        seeds = [write_dng(root / "seed.dng", light, orientation=turn).read_bytes() for turn in (1, 6)]
        add("dng", "photo.dng", seeds, _developed)
    return targets


def scan_folders(root: Path) -> dict[str, tuple[Path, str]]:
    """Scans, and a file of each that tells cameras, by names."""
    write_polycam(root / "polycam", n=3)
    write_record3d(root / "record3d", n=4)
    for name in ("odometry", "camera_matrix"):
        write_stray_files(root / name, 3)
        (root / name / "rgb.mp4").touch()
    camera = next((root / "polycam").rglob("corrected_cameras/*.json"))
    told = {"polycam": camera, "record3d": root / "record3d" / "metadata.json"}
    told |= {name: root / name / f"{name}.csv" for name in ("odometry", "camera_matrix")}
    return {name: (root / name, path.relative_to(root / name).as_posix()) for name, path in told.items()}


def _read_scan(folder: Path, _: Path) -> None:
    read_scan(folder)


def depth_seeds() -> dict[str, bytes]:
    """Depth maps, by the endings of their files."""
    depths = np.linspace(1, 3, 12).reshape(3, 4)
    array, picture = io.BytesIO(), io.BytesIO()
    np.save(array, depths)
    Image.fromarray((1000 * depths).astype(np.uint16)).save(picture, "png")
    return {"npy": array.getvalue(), "png": picture.getvalue()}


def _developed(path: Path) -> None:
    with warnings.catch_warnings():  # of threads in a process that was forked, where there are none yet
        warnings.filterwarnings("ignore", "rawpy is being used in a process", RuntimeWarning)
        develop(path, read_header(path).balance)


def _look_at_run(path: Path) -> None:
    folder = path.parent.parent if path.parent.name == "test" else path.parent
    describe_run(folder)
    write_report(folder)


def ply_seeds() -> list[bytes]:
    seeds = []
    for file_format in ("binary_little_endian", "binary_big_endian", "ascii"):
        for sh_degree in (0, 1):
            splats = with_curvatures(with_slopes(random_splats(5, sh_degree)), every=3)
            splats = with_shifts(with_second_cuts(with_cuts(splats), first=1))
            dog = {"index": splats.dog_index, **dog_columns(splats)}
            elements = {"vertex": vertex_columns(splats), "dog": dog, "slopes": slope_columns(splats)}
            elements |= {"curvatures": curvature_columns(splats)}
            elements |= {"cuts": cut_columns(splats), "second_cuts": cut_columns(splats, SECOND_CUTS)}
            elements |= {"shifts": shift_columns(splats)}
            seeds.append(to_bytes(elements, file_format, {"index": "uint"}))
        plain = random_splats(4, 0, ())
        seeds.append(to_bytes({"vertex": vertex_columns(plain)}, file_format, {"x": "double", "opacity": "double"}))
    return seeds


def model_seeds(root: Path) -> dict[str, list[bytes]]:
    """Files of small models by the end of their names, as they are written and as others write them."""
    seeds: dict[str, list[bytes]] = {"unknown": []}
    for suffix in FORMATS:
        path = root / f"seed{suffix}"
        seeds[suffix[1:]] = []
        for sh_degree in (0, 1):
            for version in (3, 4) if suffix == ".spz" else (3,):
                model = Model(random_splats(5, sh_degree, ()), Drawing(True, 0.1, False, "-y", 2.0))
                write_model(path, model, version)
                seeds[suffix[1:]].append(path.read_bytes())
        if suffix not in (".splat", *BY_A_LIBRARY):  # the first has no first bytes of its own
            seeds["unknown"] += seeds[suffix[1:]][:1]
    for path in foreign_model.FOLDER.iterdir():
        if path.suffix != ".sog":  # large
            seeds[path.name.split(".", 1)[1]].append(path.read_bytes())
    with_rows = with_curvatures(with_slopes(random_splats(300, 0, (9, 10, 299)), 7), 8)
    with_rows = with_shifts(with_second_cuts(with_cuts(with_rows, 5), 6), 9)
    seeds["compressed.ply"].append(encode(with_rows))
    seeds["glb"].append(gltf_of_spz(seeds["spz"][0]))
    del seeds["ply"]  # a target of its own
    return seeds


def gltf_of_spz(data: bytes) -> bytes:
    """A .glb whose primitive is compressed as SPZ, in a node that moves it."""
    inner = {"KHR_gaussian_splatting_compression_spz_2": {"bufferView": 0}}
    primitive = {"attributes": {}, "mode": 0, "extensions": {"KHR_gaussian_splatting": {"extensions": inner}}}
    content = {"asset": {"version": "2.0"}, "meshes": [{"primitives": [primitive]}]}
    content |= {"nodes": [{"mesh": 0, "rotation": [0, 0, 1, 0], "scale": [2, 2, 2]}, {"children": [0]}]}
    content |= {"buffers": [{"byteLength": len(data)}], "bufferViews": [{"buffer": 0, "byteLength": len(data)}]}
    return glb(content, data)


def point_ply_seeds() -> list[bytes]:
    columns = {axis: np.arange(6.0) for axis in "xyz"} | {color: np.arange(6) for color in ("red", "green", "blue")}
    types = {color: "uchar" for color in ("red", "green", "blue")}
    forms = ("binary_little_endian", "binary_big_endian", "ascii")
    return [to_bytes({"vertex": columns}, form, types) for form in forms] + [to_bytes({"vertex": columns}, "ascii")]


def camera() -> dict:
    pose = np.eye(4)
    pose[2, 3] = 4
    return {"w2c": pose.tolist(), "fx": 500, "fy": 500, "cx": 320, "cy": 240, "width": 640, "height": 480}


def transforms_seeds(folder: Path) -> list[bytes]:
    plain = json.loads((folder / "transforms.json").read_text())
    for i, frame in enumerate(plain["frames"]):
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ OPENCV_FROM_OPENGL).tolist()
        frame["transform_matrix"][0][3] = 0.1 * i
    write_point_ply(folder / "points.ply", np.array([[0.05, 0.05, 5.0], [0.1, 0.0, 4.0]]), np.full((2, 3), 0.5))
    sized = plain | {"w": 21, "h": 15, "fl_x": 20.0, "fl_y": 20.0, "cx": 10.5, "cy": 7.5}
    lens = sized | {"camera_model": "OPENCV", "k1": 0.01, "k2": 0.0, "p1": 0.001, "p2": 0.0}
    fisheye = sized | {"camera_model": "OPENCV_FISHEYE", "k1": 0.01, "k2": 0.0, "k3": 0.0, "k4": 0.0}
    split = sized | {"ply_file_path": "points.ply", "test_filenames": ["./images/r_1"]}
    return [json.dumps(content).encode() for content in (plain, sized, lens, fisheye, split)]


METRICS = {"psnr": 25.0, "ssim": 0.9, "flip": 0.1, "l1": 0.02}
ROWS: list[dict] = [{"step": 0, "seconds": 0.1, "n": 60, "n_dog": 0} | row_of([Pruned(60, 40, "first check", 0.1)])]
ROWS += [{"step": 10 * i, "seconds": i, "n": 40, "n_dog": i, "l1": 0.1 / i, "loss": 0.2 / i} for i in range(1, 8)]
ROWS += [{"step": 80, "seconds": 8.5, "n": 40, "n_dog": 9, "test_psnr": 25.0} | row_of([DogActivated(9)])]
RUN = {
    "config.json": json.dumps({"data": "data/fox", "preset": "ours", "steps": 80, "seed": 0, "model": None}).encode(),
    "history.jsonl": "".join(json.dumps(row) + "\n" for row in ROWS).encode(),
    "metrics.json": json.dumps(
        {"test": METRICS, "train": METRICS, "views": {"a": METRICS, "b": METRICS, "c": METRICS}, "render_ms": 3.0}
        | {"n": 40, "n_dog": 9, "bytes": 12345, "train_seconds": 8.5, "peak_memory_mb": 300.0, "steps": 80, "seed": 0}
        | {"variant": "llvm_ad_rgb", "versions": {"mitsuba": "3.9.1"}}
    ).encode(),
    "test/dog_profile.json": json.dumps(
        {"view": "a", "row": 3, "without": "the same model"}
        | {side: {"error": [0.1, 0.2, 0.3, 0.1], "metrics": METRICS} for side in ("with_dog", "without_dog")}
    ).encode(),
    "recipe.json": json.dumps({"label": "V1", "recipe": {"steps": 3}}).encode(),
}


def checkpoint_seeds(root: Path) -> list[bytes]:
    path = root / "seed.npz"
    state = {"optimizer.means": np.arange(12, dtype=np.float32), "step": np.array(3), "order": np.arange(4)}
    save_checkpoint(path, state | {"rng": np.array('{"state": 1}'), "dog_activated": np.array(True)})
    return [path.read_bytes()]


def array_seeds() -> list[bytes]:
    """Members of a checkpoint."""
    seeds = []
    for array in (np.arange(12, dtype=np.float32), np.array(3), np.array('{"state": 1}'), np.zeros((2, 3), bool)):
        file = io.BytesIO()
        np.save(file, array)
        seeds.append(file.getvalue())
    return seeds


def _read_as_member(path: Path) -> None:
    """Load a checkpoint that holds the damaged array with the right check sum."""
    checkpoint = path.with_suffix(".npz")
    with zipfile.ZipFile(checkpoint, "w") as archive:
        archive.write(path, "step.npy")
    load_checkpoint(checkpoint)


def heif_seeds(root: Path) -> list[bytes]:
    """As phones write them: turned, in tiles, with a profile."""
    from heif_files import picture, write_heif

    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    said = [{"exif": exif.tobytes()}, {"tile_size": 64}, {"icc_profile": profile(DISPLAY_P3, SRGB_CURVE)}]
    return [write_heif(root / "seed.heic", picture(), **more).read_bytes() for more in said]


def image_seeds() -> list[bytes]:
    rng = np.random.default_rng(0)
    color = Image.fromarray(rng.integers(0, 256, (6, 8, 4), np.uint8), "RGBA")
    kinds = [("PNG", color), ("PNG", color.convert("RGB")), ("PNG", color.convert("P")), ("PNG", color.convert("1"))]
    kinds += [("PNG", Image.fromarray(rng.integers(0, 65536, (6, 8), np.uint16))), ("JPEG", color.convert("RGB"))]
    kinds += [("WEBP", color), ("TIFF", color.convert("RGB")), ("BMP", color.convert("RGB"))]
    kinds += [("GIF", color.convert("P"))]
    seeds = []
    for kind, image in kinds:
        file = io.BytesIO()
        image.save(file, kind)
        seeds.append(file.getvalue())
    progressive = io.BytesIO()
    color.convert("RGB").save(progressive, "JPEG", progressive=True)
    return [*seeds, progressive.getvalue()]
