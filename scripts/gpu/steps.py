"""What is run on a machine with a GPU, in which order, and how long each part may take."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from . import results
from .results import Result

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared"
CHECKS = Path(os.environ.get("CUDA_STANDIN", SHARED / "tools" / "cuda_standin")) / "checks"
LEFT_OUT = ("common", "frozen_minimal")  # what they share; and a defect of Dr.Jit itself
# what the demo captures, and how large
DEMO = (str(ROOT / "scenes" / "demo_truth.xml"), *"--alpha --elevations 12 65 --zoom 1.35 --points 8000".split())
DEMO_SIZE = tuple("--size 256 256 --spp 121".split())
BENCHMARKS = {
    "renderers": "The same splats in several renderers",
    "launches": "Stages of a step",
    "launches_everything": "Stages of a step with everything",
    "million": "A million primitives at 1600x1066",
    "device_memory": "Memory of the device",
    "wavefronts": "Light paths, by how many rays are traced together",
}
CANNOT_TELL, WITHOUT_OPTIX = 2, 3  # exit status of a check, and of the probe
# These load scenes throughout, and one of them ends its process where there is no OptiX.
SCENES = ("tests/plugin", *(f"tests/engine/test_{name}.py" for name in ("aovs", "background", "derivatives")))


@dataclass(frozen=True)
class Step:
    """A program and its limits.

    Attributes:
        limit: seconds after which it is asked to stop.
        least: seconds that are kept back for it; with less than half of them it is not worth starting.
        read: what it left, from its log.
        optix: it loads scenes, which needs OptiX.
        after: name of a step that has to have passed.
        aside: it runs beside the steps that follow, until one has to be alone.
        alone: what it measures depends on what else runs.
        asked: it is run only where it is asked for by its name.
        bounded: being stopped at its limit is no failure: what was done until then counts.
        untold: exit status that says in the last line why there is nothing to tell.
        keep: files that are copied beside the report.
        fresh: files of an earlier call that are removed before it starts: they would be told as its own.
    """

    name: str
    title: str
    command: list[str]
    limit: float
    least: float
    read: Callable[[Path], Result] = results.last_line
    environment: dict[str, str] = field(default_factory=dict)
    optix: bool = False
    after: str = ""
    aside: bool = False
    alone: bool = False
    asked: bool = False
    bounded: bool = False
    untold: int | None = None
    keep: tuple[Path, ...] = ()
    fresh: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Setup:
    """What the steps depend on.

    Attributes:
        work: folder for what they write.
        data: a set to train on; None: one is captured first.
        cores: of the processor.
        offline: nothing can be installed.
        quick: everything so small that it ends in minutes where the GPU is only emulated.
    """

    work: Path
    data: Path | None
    cores: int
    offline: bool
    quick: bool


PROBE = Step("probe", "Dr.Jit on the GPU", [sys.executable, "-m", "scripts.gpu.probe"], 90, 0)


def steps(setup: Setup, optix: bool) -> list[Step]:
    """What follows on the probe, which has told whether there is OptiX."""
    first = [_gsplat(setup), *_tests(setup), *_checks(setup), *_benchmarks(setup)]
    return [*first, *_training(setup, optix), *_comparison(setup)]


def _python(*words: object) -> list[str]:
    return [sys.executable, *map(str, words)]


def _gsplat(setup: Setup) -> Step:
    environment = {"TORCH_EXTENSIONS_DIR": str(setup.work / "torch"), "MAX_JOBS": str(max(1, setup.cores // 4))}
    command = _python("-m", "scripts.gpu.gsplat", *([] if setup.offline or setup.quick else ["--install"]))
    return Step("gsplat", "gsplat", command, 270, 0, environment=environment, aside=True, bounded=True, untold=2)


def _tests(setup: Setup) -> list[Step]:
    """Those of what computes on a device; first what needs no OptiX, where single tests that do are skipped."""
    folders = ("tests/engine", "tests/tracing", "tests/scores", "tests/training")
    arrays = [str(path.relative_to(ROOT)) for folder in folders for path in sorted((ROOT / folder).rglob("test_*.py"))]
    arrays, scenes = [path for path in arrays if path not in SCENES], list(SCENES)
    if setup.quick:
        arrays, scenes = ["tests/engine/test_tiles.py", "tests/engine/test_view.py"], ["tests/plugin/test_sensor.py"]
    processes = max(1, 3 * setup.cores // 4)  # gsplat is built beside them
    command = _python("-m", "pytest", "-v", "-p", "no:cacheprovider", "-p", "xdist.plugin", "-n", processes)
    command += ["--dist", "loadfile"]
    # only our plugins of pytest: the warnings of others, which a machine may have, are errors
    environment = {"DOGSPLAT_TEST_VARIANT": "cuda_ad_rgb", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    common = {"read": results.tests, "environment": environment, "bounded": True}
    return [
        Step("tests", "Tests", [*command, *arrays], 240, 60, **common),
        Step("scenes", "Tests that load scenes", [*command, *scenes], 150, 30, **common, optix=True),
    ]


def _checks(setup: Setup) -> list[Step]:
    """Checks of single defects, each a program that says by its exit status whether the defect is there."""
    names = sorted(path.stem for path in CHECKS.glob("*.py") if path.stem not in LEFT_OUT)
    if setup.quick:
        names = [name for name in names if name == "pairs_in_depth_order"]
    return [
        Step(f"check {name}", name, _python(CHECKS / f"{name}.py", "cuda_ad_rgb"), 60, 5, untold=CANNOT_TELL)
        for name in names
    ]


def _benchmarks(setup: Setup) -> list[Step]:
    """Speed beside other renderers and by stages, and memory."""
    return [
        _benchmark(setup, "renderers", 100, "--primitives", 500, "--width", 64, "--rounds", 1),
        _benchmark(setup, "launches", 40, "--primitives", 500, "--size", 64, 48),
        _benchmark(setup, "launches_everything", 40, "--primitives", 300, "--size", 64, 48),
        _benchmark(setup, "million", 60, "--primitives", 500, "--size", 64, 48, "--rounds", 1),
        _benchmark(setup, "device_memory", 60, "--primitives", 500, 1000, "--width", 64),
        replace(_benchmark(setup, "wavefronts", 60, "--width", 24, "--spp", 2, "--rounds", 1), optix=True),
    ]


def _benchmark(setup: Setup, name: str, limit: float, *small: object) -> Step:
    """One of ``python -m benchmarks``, which writes its rows to a file; ``small``: flags of a quick one."""
    file, of = setup.work / f"{name}.json", name.removesuffix("_everything")
    command = _python("-m", "benchmarks", of, "--variant", "cuda_ad_rgb", "--json", file)
    command += ["--everything"] if of != name else []
    command += map(str, small if setup.quick else ())
    common = {"alone": True, "bounded": True, "fresh": (file,)}
    return Step(name, BENCHMARKS[name], command, limit, 30, partial(results.figures, file), **common)


def _training(setup: Setup, optix: bool) -> list[Step]:
    """As long as there is time left; the same command goes on with it another time."""
    kind = "_quick" if setup.quick else ""  # neither goes on with the other's
    run, data = setup.work / f"run{kind}", setup.data or setup.work / f"data{kind}"
    if setup.quick:
        settings = ["--max-primitives", "300", "--target", "100", "--downscale", "4", "--steps", "20"]
    elif (data / "sparse").is_dir():  # photographs
        settings = ["--max-primitives", "100000", "--downscale", "2", "--steps", "30000"]
    else:
        settings = ["--max-primitives", "40000", "--target", "10000", "--steps", "30000"]
    command = _python("-m", "mi_dogsplat", "train", data, "-o", run, "--variant", "cuda_ad_rgb", *settings)
    command += ["--checkpoint-seconds", "30", *(["--resume"] if (run / "config.json").is_file() else [])]

    size = ("--views", 6, "--size", 64, 64, "--spp", 4) if setup.quick else DEMO_SIZE
    variant = "cuda_ad_rgb" if optix else "llvm_ad_rgb"
    capture = _python("-m", "mi_dogsplat", "capture", *DEMO, *size, "-o", data, "--variant", variant)
    return [
        *([] if setup.data else [Step("capture", "Data to train on", capture, 150, 30)]),
        Step(
            "training", "Training", command, 3600, 60, lambda log: results.training(run, log),
            after="" if setup.data else "capture", alone=True, bounded=True,
            keep=tuple(run / name for name in ("history.jsonl", "metrics.json", "report.html")),
        ),
    ]


def _comparison(setup: Setup) -> list[Step]:
    """3DGS with our step sizes and a tenth by the best preset, from one start, without a cap and in full size."""
    if setup.data is None or not (setup.data / "sparse").is_dir():
        return []
    out = setup.work / ("compared_quick" if setup.quick else "compared")
    size = ["--max-primitives", 300, "--downscale", 4, "--steps", 20] if setup.quick else ["--steps", 30000]
    command = _python("-m", "mi_dogsplat", "compare", setup.data, "-o", out, "--variant", "cuda_ad_rgb", *size)
    # what is measured on the way, and checkpoints, would be a part of the time
    command += ["--max-world-scale", "inf", "--test-every", "1000000", "--checkpoint-seconds", "1000000"]
    command += ["--only", "3dgs_equal", "ours_shifts"]
    keep = tuple(out / f"comparison.{end}" for end in ("md", "csv", "html"))
    read = partial(results.comparison, out)
    return [Step("comparison", "Comparison", command, 3600, 60, read, alone=True, asked=True, bounded=True, keep=keep)]
