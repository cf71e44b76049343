"""Balls that fall onto a captured object, by a surface mesh of it (docs/blender.md): ``blender_surface.webp``.

    .venv/bin/python -m scripts.blender.falling_balls .venv-blender/bin/python WORK docs/pictures

Blender moves the balls as rigid bodies and renders by the engine DoG Splat (Mitsuba) inside of the second Python, with
the command ``dogsplat`` of the first. Left is what is rendered, right what the balls meet. Frames that the folder WORK
has already are not made again.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "scenes" / "still_life_in_place.ply"
SIZE, SAMPLES = (320, 240), 32
END, STRIDE = 54, 2  # frames that are simulated, at 24 a second, and one of how many is shown, in slow motion
KINDS = {"splats": "splats, by Mitsuba", "mesh": "their surface mesh"}
BALLS = {  # where each falls from, its radius and colour
    (-0.15, -0.3, 1.6): (0.13, (0.9, 0.25, 0.1, 1)),
    (0.35, 0.1, 2.0): (0.11, (0.1, 0.45, 0.8, 1)),
    (-0.75, 0.15, 2.3): (0.12, (0.95, 0.75, 0.1, 1)),
    (0.1, -0.75, 1.2): (0.09, (0.2, 0.65, 0.3, 1)),
}


def inside(job: dict) -> None:
    """In Blender: build the scene, let the balls fall, and render frames into the folder of the job."""
    import bpy
    from in_blender import empty_studio

    scene = empty_studio(job["command"])
    bpy.ops.import_scene.dogsplat(filepath=str(MODEL))
    splats = bpy.context.object
    bpy.ops.dogsplat.surface_mesh(voxel=0.02, largest=True, body=True)
    mesh = bpy.context.object
    build(scene, mesh)
    scene.render.engine, scene.render.image_settings.file_format = "DOGSPLAT", "PNG"
    for frame in range(1, END + 1):
        scene.frame_set(frame)  # each in turn: a simulation knows no leaps
        for kind in KINDS if frame % STRIDE == 0 else ():
            splats.hide_render, mesh.hide_render = kind == "mesh", kind == "splats"
            path = Path(job["out"]) / f"{kind}_{frame:03d}.png"
            if not path.exists():
                scene.render.filepath = str(path)
                bpy.ops.render.render(write_still=True)


def build(scene, mesh) -> None:
    """A table, balls above it, a lamp and a blue sky; and a grey material for the surface mesh."""
    import bpy
    from scene_picture import aim
    from surroundings import background, body, camera, light, material, plane, sphere

    body(mesh, material("ShaderNodeBsdfDiffuse", Color=(0.35, 0.35, 0.35, 1)))
    table = plane(9, location=(0, 0.5, -0.16))
    body(table, material("ShaderNodeBsdfPrincipled", Base_Color=(0.5, 0.36, 0.24, 1), Roughness=0.5))
    rigid(table, "PASSIVE", "BOX")
    for place, (radius, color) in BALLS.items():
        ball = sphere(radius, location=place)
        ball.data.shade_smooth()
        body(ball, material("ShaderNodeBsdfPrincipled", Base_Color=color, Roughness=0.25))
        rigid(ball, "ACTIVE", "SPHERE")
        ball.rigid_body.restitution = 0.4
    background(scene, (0.3, 0.37, 0.45, 1))
    aim(light(scene, "AREA", energy=260, size=1.2), (-2.5, -2.6, 4.2), (0, 0, 0))
    aim(camera(scene, (0, 0, 0)), (1.6, -4.9, 2.8), (0, 0, 0.35))
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.dogsplat.samples, scene.dogsplat.mesh_shadows, scene.frame_end = SAMPLES, True, END
    bpy.context.view_layer.update()


def rigid(obj, kind: str, shape: str) -> None:
    """A rigid body of Blender's."""
    import bpy

    with bpy.context.temp_override(object=obj, active_object=obj, selected_objects=[obj]):
        bpy.ops.rigidbody.object_add(type=kind)
    obj.rigid_body.collision_shape = shape


def outside(python: str, work: Path, out: Path) -> None:
    """Render, and put the frames side by side."""
    from mi_dogsplat.render.panels import labelled
    from PIL import Image

    work.mkdir(parents=True, exist_ok=True)
    job = {"out": str(work), "command": f"{sys.executable} -m mi_dogsplat"}
    subprocess.run([python, str(Path(__file__)), "inside", json.dumps(job)], check=True)
    pictures = []
    for frame in range(STRIDE, END + 1, STRIDE):
        files = {work / f"{kind}_{frame:03d}.png": label for kind, label in KINDS.items()}
        panels = [labelled(np.asarray(Image.open(f).convert("RGB")) / 255, label) for f, label in files.items()]
        pictures.append(Image.fromarray(np.round(255 * np.concatenate(panels, axis=1)).astype(np.uint8)))
    name = out / "blender_surface.webp"
    pictures[0].save(name, quality=60, save_all=True, append_images=pictures[1:], duration=1500 * STRIDE // 24, loop=0)
    print(name)


if __name__ == "__main__":
    if sys.argv[1] == "inside":
        inside(json.loads(sys.argv[2]))
    else:
        outside(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
