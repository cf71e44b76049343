"""How near the mesh of a model is to the surfaces of the scene that its photographs were rendered from.

    dogsplat capture scenes/demo_truth.xml -o DATA --views 96 --size 400 400 --spp 32
    dogsplat train DATA -o RUN --preset 3dgs --steps 3000 --max-primitives 60000

Points of the scene are what the training cameras see of it; points of the mesh are evenly spread over it. Both ways the
distance to the nearest point of the other is told, in units of the scene: what is no surface of the scene makes the
first large, and what is missing in the mesh the second. Points of the scene are about a hundredth apart.
"""

from __future__ import annotations

import argparse
import time
from itertools import product
from pathlib import Path

import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.meshing.mesh import Mesh
from mi_dogsplat.meshing.mesh_config import MeshConfig
from mi_dogsplat.meshing.surface import surface_of
from mi_dogsplat.meshing.surface_views import points_of
from mi_dogsplat.render.vantages import vantage_cameras
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.drawing import Drawing, drawn_as
from mi_dogsplat.support.variants import set_variant
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

SCENE_POINTS, MESH_POINTS = 100_000, 300_000
COLUMNS = "views         voxel  triangles  seconds   mesh to scene: mean  median  95 %   scene to mesh: mean   95 %"


def scene_depth(scene: mi.Scene, camera: Camera) -> np.ndarray:
    """[H, W] depth along the optical axis, 0 where a ray meets nothing."""
    column, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    local = np.stack([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, np.ones_like(row)], -1)
    rays = np.ascontiguousarray((local.reshape(-1, 3) @ camera.c2w[:3, :3].T).T, np.float32)  # [3, H W]
    found = scene.ray_intersect(mi.Ray3f(mi.Point3f(*camera.position.tolist()), mi.Vector3f(rays)))
    return np.where(found.is_valid().numpy(), found.t.numpy(), 0).reshape(row.shape)


def scene_points(scene: mi.Scene, cameras: list[Camera]) -> np.ndarray:
    """[P, 3] of its surfaces, as the cameras see them."""
    points = np.concatenate([points_of(camera, scene_depth(scene, camera)) for camera in cameras])
    return points[:: max(1, len(points) // SCENE_POINTS)]


def mesh_points(mesh: Mesh, rng: np.random.Generator) -> np.ndarray:
    """[P, 3], evenly over its area."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face, place = rng.choice(len(areas), MESH_POINTS, p=areas / areas.sum()), rng.uniform(size=(MESH_POINTS, 2))
    place = np.where(place.sum(axis=1, keepdims=True) > 1, 1 - place, place)
    return a[face] + place[:, :1] * (b - a)[face] + place[:, 1:] * (c - a)[face]


def main(argv: list[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks surfaces", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--voxels", nargs="+", type=float, default=[0.04, 0.02, 0.01])
    parser.add_argument("--faces", nargs="*", type=int, default=[], help="also meshes simplified to so many triangles")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(argv)
    set_variant(args.variant)
    scene, read = mi.load_file(str(args.scene)), read_model(args.model)
    assert isinstance(scene, mi.Scene)
    cameras, drawn = [view.camera for view in load_dataset(args.data).train], drawn_as(Drawing(), read.drawing)
    truth = scene_points(scene, cameras)
    of_scene, rng, config = cKDTree(truth), np.random.default_rng(0), MeshConfig()
    own = vantage_cameras(read.splats, config.views, config.size, 0, config.inside, read.drawing.up)
    print(COLUMNS)
    for views, name in ((cameras, "training"), (own, "its own")):
        for voxel, faces in product(args.voxels, (None, *args.faces)):
            start = time.perf_counter()
            mesh, _ = surface_of(read.splats, views, drawn, MeshConfig(voxel=voxel, faces=faces))
            seconds, points = time.perf_counter() - start, mesh_points(mesh, rng)
            to_scene, to_mesh = of_scene.query(points)[0], cKDTree(points).query(truth)[0]
            row = f"{len(views):4d} {name:9s}{voxel:6g}{len(mesh.faces):11,d}{seconds:9.0f}"
            row += f"{to_scene.mean():22.4f}{np.median(to_scene):8.4f}{np.quantile(to_scene, 0.95):8.4f}"
            print(row + f"{to_mesh.mean():21.4f}{np.quantile(to_mesh, 0.95):8.4f}", flush=True)
