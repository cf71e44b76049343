"""``dogsplat`` and ``volprim_rf_basic`` on the same Gaussians: the tables and the picture of docs/ellipsoids.md.

One Gaussian alone at several distances and sizes; how exactly Mitsuba meets it; then two models, at pixel centres and
averaged over pixels, with the difference taken apart rule by rule (``ray_model.py``). All over black and in sRGB, as
the primitives are.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat import to_dog, to_ellipsoids
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.mitsuba_cameras import camera_from_mitsuba, camera_to_mitsuba
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.pictures import heat_map, write_png
from mi_dogsplat.support.variants import set_variant

from .ray_model import (
    DOGSPLAT,
    RESTART,
    SENSOR_NEAR,
    VOLPRIM,
    Rules,
    entries,
    ray_directions,
    render_points,
)

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "pictures" / "ellipsoids.png"
POINTS = 500  # pixels at which rules are told apart
RAYS, DEPTH = 30, 30  # whose shells are counted, and how many of each
HEAT = 0.25  # error that the picture shows as white


def at_centres(integrator: mi.Integrator, scene: mi.Scene, camera: Camera) -> np.ndarray:
    """[H, W, 3] what ``volprim_rf_basic`` finds on the rays through the pixel centres."""
    index = dr.arange(mi.UInt32, camera.width * camera.height)
    y = index // camera.width
    centre = mi.Point2f(mi.Float(index - y * camera.width) + 0.5, mi.Float(y) + 0.5)
    size: Any = mi.ScalarVector2f(camera.width, camera.height)
    sensor = scene.sensors()[0]
    ray, _ = sensor.sample_ray(0, 0, centre / size, 0)
    sampler = sensor.sampler()
    sampler.seed(0, dr.width(index))
    colors = integrator.sample(dr.ADMode.Primal, scene, sampler, ray, None, None, True)[0]  # type: ignore
    return np.stack([channel.numpy() for channel in colors], -1).reshape(camera.height, camera.width, 3)


def scenes(splats: Splats, camera: Camera, unit: float = 1.0) -> tuple[mi.Scene, mi.Scene]:
    """(dogsplat, volprim_rf_basic); the film of both receives blended sRGB values. ``unit``: of the near planes."""
    sensor = camera_to_mitsuba(camera, SENSOR_NEAR * unit, 1e4 * unit)
    kinds: list[tuple[dict[str, Any], dict[str, Any]]] = [
        ({"type": "dogsplat", "near_clip": 0.2 * unit}, to_dog(splats)),
        ({"type": "volprim_rf_basic"}, to_ellipsoids(splats)),
    ]
    ours, theirs = (mi.load_dict({"type": "scene", "shape": shape, "sensor": sensor,
                                  "integrator": {**integrator, "srgb_primitives": False}})
                    for integrator, shape in kinds)
    return ours, theirs


def pictures(splats: Splats, camera: Camera, spp: int = 1, unit: float = 1.0) -> tuple[np.ndarray, ...]:
    """dogsplat, volprim_rf_basic at pixel centres, and the same averaged over pixels; [H, W, 3] each."""
    ours, theirs = scenes(splats, camera, unit)
    traced = at_centres(theirs.integrator(), theirs, camera)
    splatted, averaged = mi.render(ours).numpy(), mi.render(theirs, spp=spp).numpy()
    return tuple(np.clip(image, 0, 1) for image in (splatted, traced, averaged))


def alone(distance: float, sigma: float, pixels: float) -> tuple[Splats, Camera]:
    """One Gaussian of opacity .88 on the optical axis; its σ covers ``pixels``, the picture four of them each way."""
    width = int(min(8 * pixels + 8, 256)) | 1  # odd: one pixel centre is the middle
    focal = pixels * distance / sigma
    splats = Splats(np.array([[0, 0, distance]]), np.full((1, 3), np.log(sigma)), np.array([[0, 0, 0, 1]]),
                    np.array([2.0]), np.array([[[1.6, 0.8, 0.2]]]))
    return splats, Camera(np.eye(4), focal, focal, width / 2, width / 2, width, width)


def one_gaussian() -> None:
    print("| distance / σ | σ on screen, px | largest difference | PSNR | exact arithmetic | and no low-pass |")
    print("|---|---|---|---|---|---|")
    for ratio in (4, 16, 64, 256, 1024):
        for size in (0.5, 2, 8, 32):
            splats, camera = alone(4.0, 4.0 / ratio, size)
            ours, traced, _ = pictures(splats, camera)
            y, x = np.mgrid[: camera.height, : camera.width] + 0.5
            points = np.stack([x.ravel(), y.ravel()], 1)
            exact, unfiltered = (render_points(splats, camera, points, rules).reshape(ours.shape)
                                 for rules in (VOLPRIM, Rules(no_low_pass=True)))
            print(f"| {ratio} | {size} | {np.abs(ours - traced).max():.4f} | {psnr(ours, traced):.1f} | "
                  f"{psnr(ours, exact):.1f} | {psnr(unfiltered, exact):.1f} |", flush=True)


def entry_errors() -> None:
    """How far from its shell Mitsuba finds a sphere, in σ; the rays pass the centre at up to 2.9 σ."""
    sigmas = [2.0**-k for k in (2, 4, 5, 6, 7, 8)]
    print("\n| distance | " + " | ".join(f"σ = 1/{round(1 / sigma)}" for sigma in sigmas) + " |")
    print("|---" * (1 + len(sigmas)) + "|")
    passing = np.linspace(0, 2.9, 201)  # σ
    for distance in (1.0, 4.0, 16.0, 64.0):
        cells = []
        for sigma in sigmas:
            scene: Any = mi.load_dict({"type": "scene", "shape": to_ellipsoids(alone(distance, sigma, 1)[0])})
            origin = mi.Point3f(mi.Float((passing * sigma).astype(np.float32)), 0, 0)
            found = scene.ray_intersect_preliminary(mi.Ray3f(origin, mi.Vector3f(0, 0, 1))).t.numpy()
            met = np.isfinite(found)
            error = np.abs(found - (distance - sigma * np.sqrt(9 - passing**2)))[met] / sigma
            cells.append(f"{error.max(initial=0):.5f}" + ("" if met.all() else f", {1 - met.mean():.0%} missed"))
        print(f"| {distance:g} | " + " | ".join(cells) + " |", flush=True)


def scene_units() -> None:
    print("\n| size of the scene | dogsplat, largest difference from size 1 | volprim_rf_basic |\n|---|---|---|")
    reference = pictures(*alone(4.0, 0.25, 8))
    for unit in (1e-4, 1e-3, 1e-2, 1e-1, 1, 10, 100, 1000):
        images = pictures(*alone(4.0 * unit, 0.25 * unit, 8), unit=unit)
        ours, traced = (np.abs(image - same).max() for image, same in zip(images[:2], reference[:2], strict=True))
        print(f"| {unit:g} | {ours:.1e} | {traced:.1e} |", flush=True)


def models() -> dict[str, tuple[Splats, Camera]]:
    still_life: Any = mi.load_file(str(ROOT / "scenes" / "still_life.xml"))
    found = {"the still life": (read_ply(ROOT / "scenes" / "still_life.ply"),
                                camera_from_mitsuba(still_life.sensors()[0]).resized(400, 300))}
    published = ROOT.parent / "shared" / "data" / "models" / "playbot_lod2_sh2.ply"
    if published.exists():
        splats = read_ply(published)
        found["playbot"] = splats, automatic_camera(splats).resized(400, 300)
    return found


def hits(splats: Splats, camera: Camera) -> None:
    """Which shells Mitsuba's rays meet, going on behind each as ``volprim_rf_basic`` does, and which they should."""
    points = np.random.default_rng(1).uniform(0.3, 0.7, (RAYS, 2)) * (camera.width, camera.height)
    entry = entries(splats, camera, points)  # [rays, N]
    scene = scenes(splats, camera)[1]
    start = np.repeat(camera.position[:, None], RAYS, 1).astype(np.float32)
    ray: Any = mi.Ray3f(mi.Point3f(start), mi.Vector3f(ray_directions(camera, points).T.astype(np.float32)))
    met: list[list[int]] = [[] for _ in range(RAYS)]
    for _ in range(2 * DEPTH):
        si: Any = scene.ray_intersect(ray)
        for k in np.flatnonzero(si.is_valid().numpy()):
            met[k].append(int(si.prim_index.numpy()[k]))
        ray.o = si.p + ray.d * RESTART
    expected = [set(np.argsort(row)[:DEPTH]) & set(np.flatnonzero(np.isfinite(row))) for row in entry]
    n_expected = sum(len(those) for those in expected)
    found = sum(len(those & set(these)) for those, these in zip(expected, met, strict=True))
    twice = sum(len(these) - len(set(these)) for these in met)
    wrong = sum(len(set(these) - set(np.flatnonzero(np.isfinite(row)))) for these, row in zip(met, entry, strict=True))
    print(f"the first {DEPTH} shells of {RAYS} rays: {n_expected}, {found} of them found; "
          f"{twice} hits of one hit before, {wrong} of one that the ray misses")


def thickened(splats: Splats, camera: Camera) -> Splats:
    """At most 2,000 of the primitives, and no axis below 1/20 of the distance: Mitsuba meets these exactly."""
    some = np.random.default_rng(0).permutation(splats.n_splats)[:2000]
    thick = splats.select(np.sort(some))
    distance = np.linalg.norm(thick.means - camera.position, axis=1)
    thick.log_scales = np.maximum(thick.log_scales, np.log(distance / 20)[:, None]).astype(np.float32)
    return thick


def ladder(splats: Splats, camera: Camera) -> None:
    """What each rule does alone, and together with those before it; and how exact the model of the rules is."""
    pixels = np.random.default_rng(0).permutation(camera.width * camera.height)[:POINTS]
    x, y = pixels % camera.width, pixels // camera.width
    points = np.stack([x, y], 1) + 0.5

    def model(rules: Rules, of: Splats = splats) -> np.ndarray:
        return np.clip(render_points(of, camera, points, rules), 0, 1)[None]  # [1, P, 3]

    for name, shown in ("as it is", splats), ("2,000 thickened primitives", thickened(splats, camera)):
        ours, traced, _ = pictures(shown, camera)
        to_ours, to_traced = (psnr(model(rules, shown), image[None, y, x])
                              for rules, image in ((DOGSPLAT, ours), (VOLPRIM, traced)))
        print(f"{name}: PSNR of the float64 model to dogsplat {to_ours:.1f}, to volprim_rf_basic {to_traced:.1f}")
    print("| rule of volprim_rf_basic | alone | all so far |\n|---|---|---|")
    start, so_far = model(DOGSPLAT), DOGSPLAT
    for field in fields(Rules):
        so_far = replace(so_far, **{field.name: True})
        by_itself = replace(DOGSPLAT, **{field.name: True})
        print(f"| {field.name} | {psnr(start, model(by_itself)):.1f} | {psnr(start, model(so_far)):.1f} |", flush=True)


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks ellipsoids", description=__doc__)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--picture", action="store_true", help="draw the picture alone, without the tables")
    args = parser.parse_args(argv)
    set_variant(args.variant)
    if not args.picture:
        one_gaussian()
        entry_errors()
        scene_units()
    panels = []
    for name, (splats, camera) in models().items():
        ours, traced, averaged = pictures(splats, camera, 64)
        print(f"\n{name}, {splats.n_splats:,} primitives: PSNR {psnr(ours, traced):.2f} at pixel centres, "
              f"{psnr(ours, averaged):.2f} averaged over pixels")
        error = heat_map(np.clip(np.abs(ours - averaged).mean(2) / HEAT, 0, 1))
        texts = {"dogsplat": ours, "volprim_rf_basic, 64 samples": averaged, f"difference, white from {HEAT} on": error}
        panels.append(np.concatenate([labelled(shown, text) for text, shown in texts.items()], axis=1))
        if not args.picture:
            hits(splats, camera)
            ladder(splats, camera)
    write_png(PICTURE, np.concatenate(panels))
    print(f"\n{PICTURE}")
