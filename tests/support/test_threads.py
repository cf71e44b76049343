"""Threads of Dr.Jit: no more than cores, and two while Mitsuba loads a scene."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import drjit as dr
import numpy as np
import OpenEXR
import pytest
from mi_dogsplat.support import threads
from mi_dogsplat.support.variants import set_variant

ROOT = Path(__file__).parents[2]
SKY = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
SENSOR = """<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="4"/>
<integer name="height" value="3"/></film></sensor>"""
LOADING = """
import sys
from pathlib import Path
import mi_dogsplat, drjit as dr, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
from mi_dogsplat.datasets.scene_file import load_scene
from mi_dogsplat.inspection.features import splat_scene
from mi_dogsplat.render.render_files import render_scene
from mi_dogsplat.requests.answer import Answerer
from mi_dogsplat.requests.request import read_request
folder = Path(sys.argv[1])
dr.set_thread_count(1)
for load in (lambda: load_scene(folder / "scene.xml"), lambda: splat_scene(folder / "scene.xml"),
             lambda: render_scene(folder / "scene.xml", folder / "out.png", 1),
             lambda: list(Answerer().answer(read_request({"scene": str(folder / "scene.json"), "samples": 1})))):
    load()
    print(dr.thread_count(), flush=True)
"""


@pytest.fixture(autouse=True)
def _as_many_as_before() -> Iterator[None]:
    before = dr.thread_count()
    yield
    dr.set_thread_count(before)


@pytest.mark.parametrize(("started", "cores", "expected"), [(64, 3, 3), (2, 1, 1), (3, 3, 3), (2, 8, 2)])
def test_a_variant_has_no_more_threads_than_cores(monkeypatch, started, cores, expected):
    monkeypatch.setattr(threads, "usable_cores", lambda: cores)
    dr.set_thread_count(started)
    set_variant("llvm_ad_rgb")
    assert dr.thread_count() == expected


@pytest.mark.parametrize("before", [1, 2, 5])
def test_a_scene_is_loaded_with_two_threads_at_least_and_as_many_as_before_go_on(before):
    dr.set_thread_count(before)
    with pytest.raises(RuntimeError), threads.threads_to_load():
        assert dr.thread_count() == max(2, before)
        raise RuntimeError
    assert dr.thread_count() == before


def test_a_scene_with_openexr_is_loaded_where_there_is_a_single_core(tmp_path):
    """In a process of its own, which Mitsuba would have wait for ever."""
    sky = {channel: np.full((4, 8), 0.5, np.float32) for channel in "RGB"}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, sky).write(str(tmp_path / "sky.exr"))
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0"><integrator type="path"/>{SENSOR}{SKY}</scene>')
    film = {"type": "hdrfilm", "width": 4, "height": 3, "pixel_format": "rgba"}
    described = {"sky": {"type": "envmap", "filename": "sky.exr"}, "sensor": {"type": "perspective", "film": film}}
    (tmp_path / "scene.json").write_text(json.dumps(described))
    command = [sys.executable, "-c", LOADING, str(tmp_path)]
    done = subprocess.run(command, timeout=300, cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.split() == ["1"] * 4, done.stderr
