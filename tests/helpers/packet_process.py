"""A picture and its gradients, here or in a process that compiles for another processor."""

import subprocess
import sys
from pathlib import Path

import drjit as dr
import mi_dogsplat  # noqa: F401  (before drjit: chooses the LLVM)
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.drjit_internals import llvm_packet
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from read_together import read_gradients
from splat_scenes import random_splats, rounded, tilted_camera

ROOT = Path(__file__).parents[2]
CODE = """
import sys
import mi_dogsplat  # before mitsuba: chooses the LLVM
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
sys.path.append("tests/helpers")
import packet_process
packet_process.write(sys.argv[1])
"""


def picture_and_gradients(isect_memory: float | None = None) -> dict[str, np.ndarray]:
    """``planes`` and the derivatives of a random sum of them by every parameter, of a model that is half DoG."""
    splats, camera = rounded(random_splats(400, seed=4, degree=1, dog_share=0.5)), tilted_camera(230, 150)
    params = upload(splats)
    dr.enable_grad(list(params.values()))  # all but indices, which have none
    names = [name for name, value in params.items() if dr.grad_enabled(value)]
    frame = rasterize(params, DeviceCamera.upload(camera), RasterOptions(1, isect_memory=isect_memory))
    planes, rng = [*frame.colors, frame.T], np.random.default_rng(0)
    result = {"planes": np.stack([plane.numpy() for plane in planes])}
    for plane in planes:
        dr.set_grad(plane, mi.Float(rng.normal(size=dr.width(plane)).astype(np.float32)))
    dr.enqueue(dr.ADMode.Backward, planes)
    dr.traverse(dr.ADMode.Backward)
    return result | read_gradients(params, names)


def write(path: str) -> None:
    """The same in a process of its own, ten times on four threads, once in bands: ``same_bits`` says whether all
    gradients agree."""
    dr.set_thread_count(4)
    first = picture_and_gradients()
    others = [picture_and_gradients(memory) for memory in (*[None] * 8, 0.0)]
    same = all(np.array_equal(first[name], other[name]) for other in others for name in first)
    said = {"same_bits": same, "packet": llvm_packet(), "in_turn": lanes_add_in_turn(mi.variant())}
    np.savez(path, allow_pickle=False, **first, **{name: np.array(value) for name, value in said.items()})


def in_process(environment: dict[str, str], folder: Path) -> dict[str, np.ndarray]:
    """What ``write`` writes."""
    path = folder / "result.npz"
    command = [sys.executable, "-c", CODE, str(path)]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(np.load(path))
