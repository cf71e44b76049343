"""A captured object in a scene of Blender's own: by Mitsuba, and beside it by Cycles with quads (docs/blender.md).

    .venv/bin/python -m scripts.blender.scene_picture .venv-blender/bin/python WORK docs/pictures [FRAMES]

Blender renders inside of the second Python, with the command ``dogsplat`` of the first; the pictures are put side by
side here: ``blender_scene.webp``, and with FRAMES, in which camera and lamp move, ``blender_scene_film.webp``. Frames
that the folder WORK has already are not made again.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "scenes" / "still_life_in_place.ply"
ENGINES = {"DOGSPLAT": "DoG Splat (Mitsuba)", "CYCLES": "Cycles, quads"}
STILL, FILM = (480, 360), (240, 180)
SAMPLES = {"still": {"DOGSPLAT": 128, "CYCLES": 12}, "film": {"DOGSPLAT": 32, "CYCLES": 6}}  # of Cycles denoised
BALL = 0.42


def inside(job: dict) -> None:
    """In Blender: build the scene and render frames into the folder of the job."""
    import bpy
    from in_blender import empty_studio

    scene = empty_studio(job["command"])
    build(scene, job)
    scene.render.engine = job["engine"]
    scene.render.image_settings.file_format = "PNG"
    for frame in range(1, job["frames"] + 1):
        path = Path(job["out"]) / f"{job['engine']}_{job['frames']}_{frame:03d}.png"
        if path.exists():
            continue
        scene.frame_set(frame)
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)


def build(scene, job: dict) -> None:
    """A model on a chequered table, between a mirror, glass and brass, under a lamp and a blue sky."""
    import bpy
    from surroundings import background, body, camera, light, link, material, plane, sphere

    bpy.ops.import_scene.dogsplat(filepath=str(MODEL))
    wood = material("ShaderNodeBsdfPrincipled", Roughness=0.35)
    shader = next(node for node in wood.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    texture = link(wood.node_tree, "ShaderNodeTexImage", "Color", shader.inputs["Base Color"])
    texture.image = chequered()
    body(plane(9, location=(0, 0.5, -0.16)), wood)
    body(sphere(BALL, location=(-1.55, -0.75, BALL - 0.16)), material("ShaderNodeBsdfGlossy", Roughness=0.0))
    glass = material("ShaderNodeBsdfPrincipled", Roughness=0.0, Transmission_Weight=1.0, IOR=1.45)
    body(sphere(BALL, location=(1.15, -1.45, BALL - 0.16)), glass)
    standing = {"location": (1.9, 0.5, 0.35), "rotation": (1.4, 0, 0.9)}
    bpy.ops.mesh.primitive_torus_add(**standing, major_radius=0.4, minor_radius=0.12)
    bpy.context.object.data.shade_smooth()
    brass = {"Base_Color": (0.9, 0.6, 0.2, 1), "Metallic": 1.0, "Roughness": 0.25}
    body(bpy.context.object, material("ShaderNodeBsdfPrincipled", **brass))
    background(scene, (0.25, 0.32, 0.42, 1))
    lamp = light(scene, "AREA", energy=260, size=1.2)
    seen = camera(scene, (0, 0, 0))
    frames = max(job["frames"] - 1, 1)
    for frame in range(1, job["frames"] + 1):
        turn = math.radians(-16 + 32 * (frame - 1) / frames * (job["frames"] > 1))
        aim(seen, (5.6 * math.sin(turn), -5.6 * math.cos(turn), 2.5), (0, 0, 0.15))
        around = math.radians(215 + 60 * (frame - 1) / frames * (job["frames"] > 1))
        aim(lamp, (4 * math.cos(around), 4 * math.sin(around) + 2, 4.2), (0, 0, 0))
        for obj in (seen, lamp):
            for name in ("location", "rotation_euler"):
                obj.keyframe_insert(name, frame=frame)
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    scene.dogsplat.samples = scene.cycles.samples = job["samples"]
    scene.cycles.transparent_max_bounces = scene.cycles.min_transparent_bounces = 1024
    scene.cycles.use_denoising = True


def aim(obj, place, target) -> None:
    """Put a camera or lamp somewhere and turn it to a point."""
    from mathutils import Vector

    obj.location = place
    obj.rotation_euler = (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()


def chequered():
    """An image of two kinds of wood."""
    import bpy

    side, squares = 512, 18
    y, x = np.mgrid[:side, :side] * squares // side
    pixels = np.ones((side, side, 4), np.float32)
    pixels[..., :3] = np.where(((x + y) % 2)[..., None], (0.62, 0.46, 0.31), (0.44, 0.29, 0.18))
    made = bpy.data.images.new("wood", side, side)
    made.pixels.foreach_set(pixels.ravel())
    return made


def outside(python: str, work: Path, out: Path, frames: int) -> None:
    """Render by both engines, and put the frames side by side."""
    from mi_dogsplat.render.panels import labelled
    from PIL import Image

    work.mkdir(parents=True, exist_ok=True)
    for engine in ENGINES:
        size, samples = (FILM, SAMPLES["film"][engine]) if frames > 1 else (STILL, SAMPLES["still"][engine])
        job = {"engine": engine, "frames": frames, "out": str(work), "size": size, "samples": samples}
        job["command"] = f"{sys.executable} -m mi_dogsplat"
        subprocess.run([python, str(Path(__file__)), "inside", json.dumps(job)], check=True)
    pictures = []
    for frame in range(1, frames + 1):
        files = {work / f"{engine}_{frames}_{frame:03d}.png": label for engine, label in ENGINES.items()}
        panels = [labelled(np.asarray(Image.open(f).convert("RGB")) / 255, label) for f, label in files.items()]
        pictures.append(Image.fromarray(np.round(255 * np.concatenate(panels, axis=1)).astype(np.uint8)))
    name = "blender_scene_film.webp" if frames > 1 else "blender_scene.webp"
    more = {"append_images": [*pictures[1:], *pictures[-2:0:-1]], "duration": 120} if frames > 1 else {}
    pictures[0].save(out / name, quality=80, save_all=frames > 1, **more)
    print(out / name)


if __name__ == "__main__":
    if sys.argv[1] == "inside":
        inside(json.loads(sys.argv[2]))
    else:
        outside(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]) if len(sys.argv) > 4 else 1)
