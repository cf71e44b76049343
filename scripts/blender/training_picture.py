"""A scene of Blender's own, and the compact model that the panel "Train Splats" makes of it (docs/blender.md).

    .venv/bin/python -m scripts.blender.training_picture .venv-blender/bin/python WORK docs/pictures [STEPS]

Blender renders the views inside of the second Python, trains by the command ``dogsplat`` of the first, and renders the
scene and the model from where no view was. The panels are put side by side here: ``blender_training.webp``. What WORK
has already is not made again. It prints how many views there are, how long they and the training took, and PSNR.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
VIEWS, SIZE, STEPS = 60, 256, 3000
PRIMITIVES = {"target": "6000", "max_primitives": 40_000}
PICTURE = 400  # pixels, of the renders
ROWS = slice(80, 360)  # of them, in the panels: the others are empty
PLACES = {"front": (4.6, -5.6, 3.4), "back": (-4.0, 5.4, 2.2)}  # of cameras that are in no view
MIDDLE = (0.0, 0.0, 0.45)


def inside(job: dict) -> None:
    """In Blender: render, train, and write the panels and the figures into the folder of the job."""
    import bpy
    from in_blender import empty_studio

    scene, work = empty_studio(job["command"]), Path(job["work"])
    from blender_addon.training.data_set import is_complete

    build(scene)
    settings = scene.dogsplat_training
    settings.views, settings.size, settings.steps = VIEWS, (SIZE, SIZE), job["steps"]
    settings.elevations, settings.folder = (-10, 90), str(work)
    for name, value in PRIMITIVES.items():
        setattr(settings, name, value)
    bpy.ops.dogsplat.make_cameras()
    figures, file = {}, work / "figures.json"
    if not is_complete(work / "data"):
        start = time.monotonic()
        bpy.ops.dogsplat.render_views()
        figures["render_seconds"] = time.monotonic() - start
        file.write_text(json.dumps(figures))
    bpy.ops.dogsplat.train(resume=True)
    subject, result = settings.objects(), settings.result
    scene.render.film_transparent, scene.view_settings.view_transform = True, "Standard"
    scene.render.resolution_x = scene.render.resolution_y = PICTURE
    scene.cycles.transparent_max_bounces = scene.cycles.min_transparent_bounces = 1024
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    for name, place in PLACES.items():
        look_from(scene, place)
        for shown, is_model in (("scene", False), ("model", True)):
            result.hide_render = not is_model
            for obj in subject:
                obj.hide_render = is_model
            scene.cycles.samples = 24 if is_model else 128
            scene.render.filepath = str(work / f"{name}_{shown}.png")
            bpy.ops.render.render(write_still=True)


def look_from(scene, place) -> None:
    """Make a camera there that looks at the middle."""
    from surroundings import camera

    made = camera(scene, place)
    from mathutils import Vector

    made.rotation_euler = (Vector(MIDDLE) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    scene.render.resolution_x = scene.render.resolution_y = PICTURE
    scene.cycles.use_denoising = True


def build(scene) -> None:
    """Suzanne and other things on a round table, all selected, in the light of a lamp and a sky."""
    import bpy
    from surroundings import background, body, light, material, sphere

    principled = "ShaderNodeBsdfPrincipled"
    bpy.ops.mesh.primitive_cylinder_add(radius=2.3, depth=0.16, vertices=96, location=(0, 0, -0.08))
    body(bpy.context.object, textured("ShaderNodeTexWave", (0.33, 0.16, 0.07), (0.55, 0.31, 0.15), 1.6, 0.4))
    bpy.ops.mesh.primitive_monkey_add(size=1.5, location=(-0.1, 0.35, 0.74), rotation=(-0.62, 0, 0.35))
    suzanne = bpy.context.object
    suzanne.modifiers.new("Subdivision", "SUBSURF").render_levels = 2
    suzanne.modifiers[0].levels = 2
    suzanne.data.shade_smooth()
    body(suzanne, material(principled, Base_Color=(0.75, 0.2, 0.07, 1), Roughness=0.3))
    bpy.ops.mesh.primitive_torus_add(location=(1.25, -0.75, 0.16), major_radius=0.5, minor_radius=0.16)
    bpy.context.object.data.shade_smooth()
    body(bpy.context.object, material(principled, Base_Color=(0.9, 0.6, 0.2, 1), Metallic=1.0, Roughness=0.35))
    chequered = textured("ShaderNodeTexChecker", (0.8, 0.8, 0.8), (0.05, 0.15, 0.5), 7, 0.5)
    body(sphere(0.45, location=(-1.3, -0.9, 0.45)), chequered)
    bpy.ops.mesh.primitive_cube_add(size=0.75, location=(1.2, 0.95, 0.375), rotation=(0, 0, 0.5))
    bpy.context.object.modifiers.new("Bevel", "BEVEL").width = 0.06
    body(bpy.context.object, textured("ShaderNodeTexVoronoi", (0.02, 0.3, 0.25), (0.95, 0.85, 0.35), 6, 0.5))
    bpy.ops.mesh.primitive_cone_add(radius1=0.42, depth=1.1, vertices=48, location=(-1.25, 0.95, 0.55))
    body(bpy.context.object, textured("ShaderNodeTexNoise", (0.05, 0.25, 0.05), (0.5, 0.8, 0.2), 9, 0.6))
    background(scene, (0.75, 0.85, 1.0, 1)).inputs["Strength"].default_value = 0.7
    light(scene, "AREA", (3, -2.5, 5), (0.5, 0.35, 0), energy=500, size=2.0)
    bpy.ops.object.select_all(action="SELECT")
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = 64, True, 0


def textured(kind: str, low, high, scale: float, roughness: float):
    """A material of two colours between which a procedural texture changes."""
    from surroundings import link, material

    made = material("ShaderNodeBsdfPrincipled", Roughness=roughness)
    tree = made.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    ramp = link(tree, "ShaderNodeValToRGB", "Color", shader.inputs["Base Color"])
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (*low, 1), (*high, 1)
    values = {"ShaderNodeTexVoronoi": "Distance"}.get(kind, "Fac")
    texture = tree.nodes.new(kind)
    texture.inputs["Scale"].default_value = scale
    output = next(socket for socket in texture.outputs if socket.name in (values, "Factor"))
    tree.links.new(output, ramp.inputs[0])
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Object"], texture.inputs["Vector"])
    return made


def outside(python: str, work: Path, out: Path, steps: int) -> None:
    """Have it made, put the panels side by side, and print the figures."""
    from mi_dogsplat.render.panels import labelled
    from PIL import Image

    work.mkdir(parents=True, exist_ok=True)
    if not (work / "back_model.png").exists():
        job = {"work": str(work), "steps": steps, "command": f"{sys.executable} -m mi_dogsplat"}
        subprocess.run([python, str(Path(__file__)), "inside", json.dumps(job)], check=True)
    metrics = json.loads((work / "run" / "metrics.json").read_text())
    figures = json.loads((work / "figures.json").read_text())
    labels = {"scene": "Cycles", "model": f"{metrics['n']:,} splats, {metrics['bytes'] / 1e6:.1f} MB"}
    rows = []
    for name in PLACES:
        panels = {}
        for shown in labels:
            rgba = np.asarray(Image.open(work / f"{name}_{shown}.png").convert("RGBA")) / 255
            panels[shown] = rgba[..., :3] * rgba[..., 3:] + 1 - rgba[..., 3:]
        error = -10 * np.log10(np.mean((panels["scene"] - panels["model"]) ** 2))
        print(f"{name}: {error:.1f} dB at {PICTURE} x {PICTURE}, both by Cycles, over white")
        rows.append(np.concatenate([labelled(panels[shown][ROWS], text) for shown, text in labels.items()], axis=1))
    picture = Image.fromarray(np.round(255 * np.concatenate(rows)).astype(np.uint8))
    picture.save(out / "blender_training.webp", quality=80)
    print(f"{VIEWS + VIEWS // 6} views of {SIZE} x {SIZE} in {figures['render_seconds']:.0f} s")
    print(f"training {metrics['steps']:,} steps in {metrics['train_seconds']:.0f} s; test views {metrics['test']}")
    print(f"{metrics['n']:,} primitives, {metrics['n_dog']:,} of them DoG, {metrics['bytes']:,} bytes")


if __name__ == "__main__":
    if sys.argv[1] == "inside":
        inside(json.loads(sys.argv[2]))
    else:
        outside(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]) if len(sys.argv) > 4 else STEPS)
