"""Pictures of docs/blender_details.md: the same model and camera by our integrator and by Blender's engines.

    .venv/bin/python scripts/blender/engine_pictures.py .venv-blender/bin/python MODEL.ply DATA 2 WORK docs/pictures

2 is the downscaling of the photographs; renders that the folder WORK has already are not made again. Started with the
word ``inside`` by the Python that has bpy, it renders with one engine.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
ENGINES = (
    ("CYCLES", "QUADS", "Cycles"),
    ("EEVEE", "QUADS", "EEVEE: no negative lobes"),
)
HEAT = 0.1  # mean difference of the channels that is shown as white


def inside(job: dict) -> None:
    """In Blender: import model and camera, set up the exact picture, render to ``job["out"]``."""
    import bpy
    from in_blender import exact_view, render_to

    exact_view(job["model"], job["camera"], job["show_as"])
    eevee = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"
    render_to(job["out"], eevee if job["engine"] == "EEVEE" else job["engine"])


def outside(python: str, model: str, data: str, downscale: int, work: Path, out: Path) -> None:
    """Render what is missing, write ``blender_dog.png``, print the figures."""
    sys.path.insert(0, str(ROOT))
    from mi_dogsplat.datasets import load_dataset
    from mi_dogsplat.render.panels import labelled
    from mi_dogsplat.scene.camera_file import write_camera
    from mi_dogsplat.support.pictures import heat_map

    from scripts.pictures.panels import write_rows

    work.mkdir(parents=True, exist_ok=True)
    camera, ours = work / "camera.json", work / "ours.png"
    if not ours.exists():
        write_camera(camera, load_dataset(data, downscale).test[0].camera)
        command = [sys.executable, "-m", "mi_dogsplat", "render", model, "--camera", str(camera), "-o", str(ours)]
        subprocess.run(command, check=True, cwd=ROOT)
    pictures = [("dogsplat", _read(ours))]
    for engine, show_as, label in ENGINES:
        target = work / f"{engine}_{show_as}.png"
        job = {"model": model, "camera": str(camera), "engine": engine, "show_as": show_as, "out": str(target)}
        if not target.exists():
            subprocess.run([python, __file__, "inside", json.dumps(job)], check=True, stdin=subprocess.DEVNULL)
        pictures.append((label, _read(target)))
    exact, differences = pictures[0][1], []
    for label, picture in pictures[1:]:
        error = picture - exact
        print(f"{label}: {-10 * np.log10(np.mean(error**2)):.2f} dB, {error.mean():+.5f} brighter")
        seen = heat_map(np.minimum(np.abs(error).mean(axis=-1) / HEAT, 1))
        differences.append((f"{label.partition(':')[0]}: difference, white from {HEAT} on", seen))
    row = [labelled(picture, label) for label, picture in pictures + differences]
    write_rows("blender_dog.png", [row], out)


def _read(path: Path) -> np.ndarray:
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB"), np.float64) / 255


if __name__ == "__main__":
    if sys.argv[1] == "inside":
        inside(json.loads(sys.argv[2]))
    else:
        outside(*sys.argv[1:4], int(sys.argv[4]), Path(sys.argv[5]), Path(sys.argv[6]))
