"""Mitsuba's variants, each in a process of its own; some work, the others say which to use."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.runs.run import train
from mi_dogsplat.support import variants
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.llvm import find_llvm
from mi_dogsplat.training.config import TrainConfig

from benchmarks.processors.targets import can_build, library

ROOT = Path(__file__).parents[2]
LIBRARY = """
import json, sys
import numpy as np
import mi_dogsplat
import drjit as dr
import mitsuba as mi


def scene_dict():
    rng = np.random.default_rng(0)
    n = 40
    tensors = {"means": rng.uniform([-1, -1, 2], [1, 1, 4], (n, 3)), "log_scales": rng.uniform(-3, -1, (n, 3)),
               "quats": rng.normal(size=(n, 4)), "logit_opacities": rng.normal(size=n),
               "sh_coeffs": rng.normal(size=(n, 4, 3))}
    dog = {"type": "dog", **{k: mi.TensorXf(v.astype(np.float32)) for k, v in tensors.items()}}
    film = {"type": "hdrfilm", "width": 24, "height": 16, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    wall = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0.8, 0, 3.5]).rotate([0, 1, 0], 180),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [0.2, 0.5, 0.9]}}}
    return {"type": "scene", "integrator": {"type": "dogsplat", "nested": {"type": "path"}}, "dog": dog,
            "wall": wall, "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.7, 0.4, 0.3]}},
            "sensor": {"type": "perspective", "fov": 50.0, "film": film}}


def picture(spp=1):
    scene = mi.load_dict(scene_dict())
    params = mi.traverse(scene)
    dr.enable_grad(params["dog.means"])
    params.update()
    image = mi.render(scene, params, spp=spp)
    dr.backward(dr.sum(image, axis=None))
    return np.array(image).tolist(), float(np.abs(dr.grad(params["dog.means"]).numpy()).sum())


def answer(**values):
    print("answer:", json.dumps(values))  # Mitsuba logs to this stream as well
"""


def run(code: str) -> dict:
    done = subprocess.run([sys.executable, "-W", "error", "-c", LIBRARY + code], capture_output=True, text=True,
                          cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.split("answer:")[1].splitlines()[0])


@pytest.fixture(scope="module")
def rgb() -> np.ndarray:
    return np.array(run('mi.set_variant("llvm_ad_rgb"); answer(image=picture()[0])')["image"])


def test_several_variants_in_one_process_render_the_same_whatever_came_before(rgb):
    got = run('''
images, gradients = [], []
for variant in ("llvm_ad_rgb", "llvm_ad_mono", "scalar_rgb", "llvm_ad_rgb", "llvm_ad_spectral", "llvm_ad_rgb"):
    mi.set_variant(variant)
    if variant == "llvm_ad_rgb":
        image, gradient = picture()
        images.append(image)
        gradients.append(gradient)
answer(images=images, gradients=gradients)
''')
    for image in got["images"]:
        np.testing.assert_array_equal(image, rgb)
    assert len(set(got["gradients"])) == 1 and got["gradients"][0] > 1


@pytest.mark.skipif("llvm_ad_mono" not in mi.variants(), reason="this Mitsuba was built without llvm_ad_mono")
@pytest.mark.parametrize("spp", [1, 4])
def test_a_variant_of_luminance_shows_the_luminance_of_the_splats(spp):
    """Emitters become grey when they are loaded: with them the images are close only."""
    code = """
def alone(spp):
    plain = scene_dict()
    del plain["wall"], plain["sky"]
    return np.array(mi.render(mi.load_dict(plain), spp=spp)).tolist()

mi.set_variant("llvm_ad_rgb")
colored, whole = alone(SPP), picture(SPP)[0]
mi.set_variant("llvm_ad_mono")
grey, (all_grey, gradient) = alone(SPP), picture(SPP)
answer(colored=colored, grey=grey, whole=whole, all_grey=all_grey, gradient=gradient)
""".replace("SPP", str(spp))
    got = run(code)
    weights = [0.212671, 0.715160, 0.072169]
    grey = np.array(got["grey"])
    np.testing.assert_allclose(grey[..., 0], np.array(got["colored"]) @ weights, atol=1e-5)
    np.testing.assert_array_equal(grey[..., 0], grey[..., -1])
    assert np.abs(np.array(got["all_grey"])[..., 0] - np.array(got["whole"]) @ weights).mean() < 0.03
    assert got["gradient"] > 1


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_spectral", "llvm_ad_mono_polarized"])
@pytest.mark.parametrize("name", ["dogsplat", "dog", "to_dog"])
def test_the_other_variants_say_which_to_use(variant, name):
    if variant not in mi.variants():
        pytest.skip(f"this Mitsuba was built without {variant}")
    in_memory = "mi_dogsplat.to_dog(mi_dogsplat.Splats.empty(0))"
    call = in_memory if name == "to_dog" else f'mi.load_dict({{"type": "{name}"}})'
    got = run(f'''
mi.set_variant("{variant}")
try:
    {call}
    answer(problem="none")
except RuntimeError as error:
    answer(problem=str(error))
''')
    assert f"{name}: not available in the variant {variant}; use llvm_ad_rgb or cuda_ad_rgb" in got["problem"]


def test_what_computes_says_that_no_variant_is_set_and_that_a_scalar_one_is():
    """Before they look at what they are given, which is not there; but a model says whether its export computes, and
    only a scene needs a variant to be described."""
    got = run("""
import os, tempfile
from mi_dogsplat.check.run import check
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.editing.clean import clean_model
from mi_dogsplat.editing.simplify import simplify_model
from mi_dogsplat.export.write import export_model
from mi_dogsplat.film.make import make_film
from mi_dogsplat.inspection.describe_features import describe_features
from mi_dogsplat.inspection.info import describe
from mi_dogsplat.render.render_files import render_model, render_scene
from mi_dogsplat.requests import serve
from mi_dogsplat.runs.evaluation import evaluate_model
from mi_dogsplat.runs.run import train
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.viewer.server import serve as view

model, scene = os.path.abspath("scenes/still_life.ply"), os.path.abspath("scenes/still_life.xml")
os.chdir(tempfile.mkdtemp())
arrays = {
    "train": lambda: train(TrainConfig("photos"), "run"),
    "render_model": lambda: render_model("model.ply", "view.png"),
    "evaluate_model": lambda: evaluate_model("model.ply", "photos"),
    "capture": lambda: capture("scene.xml", "captured", CaptureConfig()),
    "make_film": lambda: make_film("model.ply", "film.mp4"),
    "simplify_model": lambda: simplify_model("model.ply", "fewer.ply"),
    "clean_model": lambda: clean_model("model.ply", "clean.ply", data="photos"),
    "export_model": lambda: export_model(model, "small.spz"),
    "view": lambda: view("model.ply"),
    "serve": lambda: serve.serve([], print),
    "check": lambda: check("checked"),
    "describe_features": lambda: describe_features("model.ply"),
}
scenes = {
    "render_scene": lambda: render_scene("scene.xml", "scene.png"),
    "describe": lambda: describe(scene),
    "to_dog": lambda: mi_dogsplat.to_dog("model.ply"),
    "to_ellipsoids": lambda: mi_dogsplat.to_ellipsoids("model.ply"),
}

def said(call):
    try:
        call()
    except ValueError as error:
        return str(error)
    except Exception as error:
        return repr(error)

without = {name: said(call) for name, call in (arrays | scenes).items()}
mi.set_variant("scalar_rgb")
answer(without=without, scalar={name: said(call) for name, call in arrays.items()}, left=os.listdir())
""")
    remedy = 'call mi_dogsplat.support.variants.set_variant("auto") first, or mi.set_variant("llvm_ad_rgb")'
    assert got["without"] == dict.fromkeys(got["without"], f"Mitsuba: no variant is set; {remedy}")
    problem = f"Mitsuba: the variant scalar_rgb computes no arrays; {remedy}"
    assert got["scalar"] == dict.fromkeys(got["scalar"], problem)
    assert got["left"] == []


def test_a_training_in_another_variant_than_its_settings_name_is_refused(tmp_path):
    """Whoever asks for a GPU shall not wait for a CPU."""
    line = f'--variant: cuda_ad_mono is asked for, and {mi.variant()} is set; call mi.set_variant("cuda_ad_mono")'
    with pytest.raises(DataError, match=re.escape(line)):
        train(TrainConfig("photos", variant="cuda_ad_mono"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_processor_that_dr_jit_cannot_compile_for_is_one_line(monkeypatch):
    if find_llvm() is None:
        pytest.skip("without an LLVM that is what is said")
    monkeypatch.setattr(variants.dr, "has_backend", lambda backend: False)
    with pytest.raises(DataError, match="^--variant: Dr.Jit cannot compile for this processor with .*; use .* FMA"):
        variants.set_variant("llvm_ad_rgb")


def test_a_processor_without_fma_is_one_line_of_ours_after_dr_jits_own(tmp_path):
    """A library that is LLVM but for what it says of the processor: one from 2011."""
    if find_llvm() is None or not can_build():
        pytest.skip("needs Linux on x86-64 with a usable LLVM and a C compiler: it makes a library that wraps it")
    older = library(tmp_path, "sandybridge", "sse4.2 avx")
    command = [sys.executable, "-m", "mi_dogsplat", "render", "scenes/still_life.ply", "-o", str(tmp_path / "a.png")]
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": str(older)}
    done = subprocess.run([*command, "--variant", "llvm_ad_rgb"], env=environment, cwd=ROOT, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    assert done.stderr.splitlines()[-1].startswith("dogsplat: --variant: Dr.Jit cannot compile for this processor")
