"""The Blender add-on, tested inside of Blender: each test below is one of ``tests/blender/check_*.py``.

Those run under a Python that has ``bpy``, or in Blender itself, in a process of their own, which keeps Blender's
libraries away from the rest of the suite. Which ones: ``DOGSPLAT_BLENDER_PYTHONS`` (as in PATH; a program called
``blender`` is Blender, whose Python needs pytest), else ``.venv-blender`` (``make blender``) and those of other
versions beside it (``make blenders``).
"""

import ast
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.drawing import DrawnAs
from mi_dogsplat.scene.ply import read_ply, write_ply
from mi_dogsplat.scene.radiance import brightened
from own_axes_models import KINDS, SHIFTED
from splat_scenes import make_splats, random_splats, rounded, square_camera, tilted_camera

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data"
FILES = sorted((ROOT / "tests" / "blender").glob("check_*.py"))
CHECKS = [
    f"{file.stem}::{node.name}"
    for file in FILES
    for node in ast.parse(file.read_text(encoding="utf-8")).body
    if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
]
DEFAULT = ROOT / ".venv-blender" / "bin" / "python"
OTHERS = sorted(ROOT.glob(".venv-blender-*/bin/python"))
NAMED = os.environ.get("DOGSPLAT_BLENDER_PYTHONS")
PYTHONS = [DEFAULT, *OTHERS] if NAMED is None else [Path(p) for p in NAMED.split(os.pathsep) if p]
TOWARDS = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -2.5], [0, 0, 0, 1.0]])  # of a camera, by 2.5
DOWNSCALE = 4  # of the photographs: EEVEE runs in software here


def reference(folder: Path, name: str, splats, camera: Camera, parallel: bool = False) -> None:
    """A model, a camera and the picture that our integrator makes of them.

    Of parallel rays focal lengths are in pixels per unit, and there is no near clip.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / f"{name}.ply", splats)
    write_camera(folder / f"{name}.json", camera)
    options = RasterOptions(sh_degree=splats.sh_degree, depth=True)
    drawn = DrawnAs(near_clip=0.0) if parallel else DrawnAs()
    picture = render_picture(upload(splats), camera, options, drawn=drawn, perspective=not parallel)
    np.savez(folder / f"{name}.npz", color=picture.color, alpha=picture.alpha, depth=np.asarray(picture.depth))


def train_fox(out: Path, preset: str) -> Path:
    """A model of the fox, sharp enough to look at after half a minute."""
    settings = f"--preset {preset} --steps 300 --downscale {DOWNSCALE} --max-primitives 20000".split()
    command = [sys.executable, "-m", "mi_dogsplat", "train", str(SHARED / "fox"), "-o", str(out), *settings]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return out / "point_cloud.ply"


@pytest.fixture(scope="session")
def references(tmp_path_factory) -> Path:
    """What the checks compare Blender's pictures with."""
    folder = tmp_path_factory.mktemp("blender")
    camera = tilted_camera(96, 64, 90.0, cx=40.0, cy=36.0)  # pixels not square, principal point off the middle
    dog = rounded(random_splats(150, seed=3))
    reference(folder, "dog", dog, camera)
    reference(folder, "plain", dog.plain(), camera)
    every = dog
    for kind in (*KINDS, SHIFTED):
        reference(folder, kind.word, kind.having(dog, every=3), camera)
        every = kind.having(every, every=3)
    for name in ("every.ply", "every.compressed.ply"):
        write_model(folder / name, every)
    for suffix in (".spz", ".glb", ".usdz", ".sog", ".splat", ".compressed.ply"):
        write_model(folder / f"plain{suffix}", Model(dog.plain(), Drawing(antialiased=True)))
    write_model(folder / "says.ply", Model(dog, Drawing(True, 0.05, False, "-y", 2.0)))
    mixed = dog.with_sh_degrees(np.arange(150) % 4)
    write_ply(folder / "rows.ply", mixed, "rows")
    write_ply(folder / "padded.ply", mixed)
    linear = Model(brightened(dog, 3.0), Drawing(linear=True, white=2.5))
    write_model(folder / "linear.ply", linear)
    write_model(folder / "linear.spz", replace(linear, splats=brightened(dog.plain(), 40.0)))
    np.savez(folder / "linear_spz.npz", sh_coeffs=read_model(folder / "linear.spz").splats.sh_coeffs)
    picture = render_picture(upload(linear.splats), camera, RasterOptions(sh_degree=3), drawn=DrawnAs(linear=True))
    np.savez(folder / "linear.npz", radiance=np.asarray(picture.radiance))
    np.savez(folder / "spz.npz", **vars(read_model(folder / "plain.spz").splats))
    reference(folder, "square", dog, square_camera(96, 64, 90.0))
    wide = tilted_camera(96, 64, 24.0, cx=40.0, cy=36.0)
    wide = replace(wide, w2c=TOWARDS @ wide.w2c)  # among the splats
    reference(folder, "parallel", dog, wide, parallel=True)
    reference(folder, "parallel_plain", dog.plain(), wide, parallel=True)
    around = make_splats([(0.2, 0.1, -1.5), (8, 0.5, -4), (-4, 2, 30)], 1e-4, 0.5, np.eye(3))
    write_ply(folder / "around.ply", rounded(around))
    reference(folder, "square_parallel", dog, square_camera(96, 64, 24.0), parallel=True)
    if SHARED.is_dir():
        playbot = read_ply(SHARED / "models" / "playbot_lod2_sh2.ply")
        reference(folder, "playbot", playbot, automatic_camera(playbot).downscaled(DOWNSCALE))
        view = load_dataset(SHARED / "fox", DOWNSCALE).test[0]
        (folder / "fox_view").write_text(view.name)
        for name, preset in (("fox", "3dgs"), ("fox_dog", "ours")):
            trained = os.environ.get(f"DOGSPLAT_{name.upper()}")  # a longer training of one's own
            reference(folder, name, read_ply(trained or train_fox(folder / preset, preset)), view.camera)
    return folder


def pytest_of(python: Path) -> list[str]:
    """The command that runs pytest in there."""
    if python.name != "blender":
        return [str(python), "-m", "pytest"]
    inside = str(ROOT / "tests" / "blender" / "inside.py")
    return [str(python), "--background", "--factory-startup", "--python-exit-code", "1", "--python", inside, "--"]


def run_checks(python: Path, references: Path, report: Path) -> dict[str, list[ET.Element]]:
    """The JUnit records of every check, one per set of its parameters, by name."""
    environment = {
        **os.environ,
        "DOGSPLAT_REFERENCES": str(references),
        "DOGSPLAT_SHARED": str(SHARED),
        "DOGSPLAT_COMMAND": json.dumps([sys.executable, "-m", "mi_dogsplat"]),
        "PYTHONPATH": str(ROOT),
    }
    for name in [name for name in environment if name.startswith("PYTEST_")]:
        del environment[name]
    command = [
        *pytest_of(python),
        "-q",
        "-p",
        "no:cacheprovider",
        f"--confcutdir={ROOT / 'tests' / 'blender'}",
        "-o",
        "python_files=check_*.py",
        "-o",
        "junit_family=xunit1",
        f"--junitxml={report}",
        *map(str, FILES),
    ]
    run = subprocess.run(command, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if not report.exists() or run.returncode > 1:  # of checks that ran it is 0 or 1
        raise RuntimeError(f"{python} stopped:\n{run.stdout[-4000:]}\n{run.stderr[-2000:]}")
    found = defaultdict(list)
    for case in ET.parse(report).iter("testcase"):
        name = case.get("name", "").split("[")[0]
        found[f"{Path(case.get('file', '')).stem}::{name}"].append(case)
    return found


@pytest.fixture(scope="session")
def outcomes(references, tmp_path_factory) -> Callable[[Path], dict[str, list[ET.Element]]]:
    """``run_checks`` of a Python: each in the first test that asks for it, whose time limit it has to itself."""
    return cache(lambda python: run_checks(python, references, tmp_path_factory.mktemp("report") / "junit.xml"))


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("python", PYTHONS, ids=lambda p: p.parts[-3] if len(p.parts) > 2 else str(p))
def test_in_blender(python, check, request):
    if not python.exists():
        pytest.skip(f'there is no Python with bpy at {python}: run "make blender" (Python 3.11, 400 MB)')
    cases = request.getfixturevalue("outcomes")(python).get(check)
    assert cases, f"{check} did not run"
    troubles = [(case, t) for case in cases for t in [*case.findall("failure"), *case.findall("error")]]
    for case, trouble in troubles:
        pytest.fail(f"{case.get('name')}: {trouble.get('message')}\n{trouble.text}", pytrace=False)
    skipped = [s for case in cases if (s := case.find("skipped")) is not None]
    if len(skipped) == len(cases):
        pytest.skip(skipped[0].get("message"))
