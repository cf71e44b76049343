"""How near the colours of a mesh are to test photographs: one for each vertex, and in a texture; of the model, and of
the training photographs.

    dogsplat capture scenes/demo_truth.xml -o DATA --views 96 --size 400 400 --spp 32
    dogsplat train DATA -o RUN --preset 3dgs --steps 3000 --max-primitives 60000

A mesh is written as ``dogsplat mesh`` does, and Mitsuba draws it from there without any light. PSNR is over pixels that
the mesh and the photograph both cover, so it says nothing of what the mesh lacks.
"""

from __future__ import annotations

import argparse
import time
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.meshing.make import make_mesh
from mi_dogsplat.meshing.mesh_config import MeshConfig
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.support.variants import set_variant

SPP = 16
COVERED = 0.99  # alpha of a photograph
COLUMNS = "triangles  colours             of             kB  seconds   PSNR"


def main(argv: list[str]) -> None:
    """A row for each mesh."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks textures", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--faces", nargs="+", type=int, default=[5000, 20_000])
    parser.add_argument("--sizes", nargs="+", type=int, default=[1024, 2048], help="of textures, pixels")
    parser.add_argument("--downscale", type=int, default=1)
    args = parser.parse_args(argv)
    set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)  # it warns of colours in bytes
    views = load_dataset(args.data, args.downscale).test
    few = [
        MeshConfig(faces=n, texture=size, photographs=taken)
        for n, size, taken in product(args.faces, (None, *args.sizes), (False, True))
    ]
    print(COLUMNS)
    with TemporaryDirectory() as folder:
        for k, config in enumerate((MeshConfig(), *few)):
            out = Path(folder) / f"{k}.{'ply' if config.texture is None else 'obj'}"
            start = time.perf_counter()
            made = make_mesh(args.model, out, config, args.data, PictureOptions(downscale=args.downscale))
            seconds, files = time.perf_counter() - start, [*out.parent.glob(f"{out.stem}*")]
            colours = f"texture {config.texture}x{config.texture}" if config.texture else "of vertices"
            size = sum(file.stat().st_size for file in files) / 1000
            source = "photographs" if config.photographs else "the model"
            row = f"{made.n_faces:9,d}  {colours:18s}  {source:11s}{size:8,.0f}{seconds:9.0f}"
            print(f"{row}{np.mean([nearness(out, view) for view in views]):7.2f}", flush=True)


def shown(path: Path, camera: Camera, spp: int = SPP) -> np.ndarray:
    """[H, W, 4] the colours of a mesh, in sRGB and premultiplied, and how much of a pixel it covers."""
    if path.suffix == ".ply":
        colors = {"type": "mesh_attribute", "name": "vertex_color", "scale": 1 / 255}
    else:
        colors = {"type": "bitmap", "filename": str(path.with_name(f"{path.stem}_texture.jpg")), "raw": True}
    sensor = camera_to_mitsuba(camera)
    sensor["film"] |= {"pixel_format": "rgba", "rfilter": {"type": "box"}}
    bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colors}}
    mesh = {"type": path.suffix[1:], "filename": str(path), "bsdf": bsdf}
    integrator = {"type": "aov", "aovs": "color:albedo", "alpha": {"type": "direct"}}
    scene = {"type": "scene", "integrator": integrator, "sensor": sensor, "mesh": mesh}
    film = np.array(mi.render(mi.load_dict(scene), spp=spp))
    return film[..., [-3, -2, -1, 3]]


def nearness(path: Path, view: View) -> float:
    """PSNR of what is drawn of a mesh, over the pixels that it and the photograph cover."""
    drawn, photograph = shown(path, view.camera), view.image
    there = drawn[..., 3] > COVERED
    if photograph.shape[2] == 4:
        there &= photograph[..., 3] > COVERED
    return psnr(drawn[..., :3], photograph[..., :3], there)
