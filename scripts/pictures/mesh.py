"""Makes docs/pictures/mesh.png: a model, and the mesh that ``dogsplat mesh`` makes of it, shaded and with its colours;
below it one of few triangles, and with a texture.

``python -m scripts.pictures.mesh``; the model is ../shared/data/models/playbot_lod2_sh2.ply ("PLAYBOT" by Stephane
Agullo, CC-BY-4.0).
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi
import numpy as np
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.meshing.mesh import Mesh
from mi_dogsplat.meshing.mesh_config import MeshConfig
from mi_dogsplat.meshing.mesh_files import write_obj, write_ply
from mi_dogsplat.meshing.surface import surface_of
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.render.picture import picture_of
from mi_dogsplat.render.vantages import vantage_cameras
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.drawing import Drawing, drawn_as
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.support.srgb import linear_to_srgb

from benchmarks.numerics.textures import shown

from .panels import write_rows

MODEL = Path(__file__).parents[3] / "shared" / "data" / "models" / "playbot_lod2_sh2.ply"
WIDTH, HEIGHT = 480, 360  # pixels of a picture
BACKGROUND = 0.08  # grey
CONFIG = MeshConfig(inside=0)
FACES, TEXTURE = 5000, 1024


def main() -> None:
    mi.set_variant("llvm_ad_rgb")
    read = read_model(MODEL)
    splats, drawn = read.splats, drawn_as(read.drawing, read.drawing)
    cameras = vantage_cameras(splats, CONFIG.views, CONFIG.size, 0, CONFIG.inside, read.drawing.up)
    whole, few, textured = (
        surface_of(splats, cameras, drawn, replace(CONFIG, faces=faces, texture=texture))[0]
        for faces, texture in ((None, None), (FACES, None), (FACES, TEXTURE))
    )
    camera = automatic_camera(splats, read.drawing.up).resized(WIDTH, HEIGHT)
    picture = picture_of(splats, BACKGROUND, drawn)(camera)
    grey, colored, few_grey, few_colored = (*looks(whole, camera), *looks(few, camera))
    write_rows("mesh.png", [
        [
            labelled(picture.color, f"{splats.n_splats:,} primitives"),
            labelled(grey, f"{len(whole.faces):,} triangles"),
            labelled(colored, "the colours of their vertices"),
        ],
        [
            labelled(few_grey, f"{len(few.faces):,} triangles"),
            labelled(few_colored, "the colours of their vertices"),
            labelled(with_texture(textured, camera), f"their texture of {TEXTURE}x{TEXTURE} pixels"),
        ],
    ])  # fmt: skip


def looks(mesh: Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """[H, W, 3] shaded, and in the colours of its vertices."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.ply"
        write_ply(path, mesh, Drawing())
        return shaded(path, camera), unlit(path, camera)


def with_texture(mesh: Mesh, camera: Camera) -> np.ndarray:
    """[H, W, 3]"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.obj"
        write_obj(path, mesh, Drawing())
        return unlit(path, camera)


def shaded(path: Path, camera: Camera) -> np.ndarray:
    """[H, W, 3] of a grey mesh in light from behind the camera and from all around."""
    around = {"type": "constant", "radiance": 0.35}
    direction = list(camera.c2w[:3, :3] @ (0.4, 0.5, 1))
    lamp = {"type": "directional", "direction": direction, "irradiance": 2.0}
    grey = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.6}}}
    sensor = camera_to_mitsuba(camera)
    sensor["film"]["pixel_format"] = "rgba"
    mesh = {"type": "ply", "filename": str(path), "bsdf": grey}
    integrator = {"type": "path", "max_depth": 2, "hide_emitters": True}
    scene = {"type": "scene", "integrator": integrator, "sensor": sensor, "mesh": mesh, "lamp": lamp, "around": around}
    film = np.array(mi.render(mi.load_dict(scene), spp=64))
    return linear_to_srgb(film[..., :3]) + BACKGROUND * (1 - film[..., 3:4])


def unlit(path: Path, camera: Camera) -> np.ndarray:
    """[H, W, 3] in its own colours, sRGB, without light."""
    film = shown(path, camera, 64)
    return film[..., :3] + BACKGROUND * (1 - film[..., 3:])


if __name__ == "__main__":
    main()
